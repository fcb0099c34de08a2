"""Unpacking the Rerun viewer: from the wheel's module alone, and with a sentence where that fails."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.page import rerun_assets


def test_why_it_cannot_be_unpacked_is_told_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_assets, "SERVE", "raise SystemExit('libX.so.1: cannot open shared object file')")
    with pytest.raises(OSError, match=r"cannot be unpacked: .* exit code 1 \(libX\.so\.1: cannot open") as caught:
        rerun_assets.viewer_assets(tmp_path)
    assert "\n" not in str(caught.value)


def test_without_a_place_for_it_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_assets, "cache_folder", lambda _: None)
    with pytest.raises(OSError, match="make the home folder or the temporary one writable"):
        rerun_assets.viewer_assets()
