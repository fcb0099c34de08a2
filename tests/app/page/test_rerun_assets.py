"""The files of the Rerun viewer: as rerun-notebook has them, but for two places of the script; or one sentence."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from ispom_app.views.web import rerun_assets
from ispom_app.views.web.rerun_assets import files_in, viewer_files


def test_they_are_of_the_version_that_writes_the_recordings():
    assert version("rerun-notebook") == version("rerun-sdk")


def test_the_script_exports_the_class_and_has_the_page_fetch_the_rest() -> None:
    found = viewer_files()
    own = [line.strip() for line in (found.wasm.parent / "widget.js").read_text().splitlines()]
    served, known = [line.strip() for line in found.script.decode().splitlines()], set(own)
    added = [line for line in served if line not in known]
    assert added == ['return (await import("../web/rerun.js")).wasm();', "export { WebViewer };"]
    assert found.wasm.read_bytes()[:4] == b"\0asm" and len(own) - len(served) < 12


def test_nothing_of_a_notebook_is_imported() -> None:
    viewer_files()
    assert "rerun_notebook" not in sys.modules


def test_another_form_of_the_script_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "re_viewer_bg.wasm").write_bytes(b"\0asm")
    (tmp_path / "widget.js").write_text("var WebViewer = class {};\nexport { widget as default };\n")
    with pytest.raises(OSError, match="install the rerun-notebook") as caught:
        files_in(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_package_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_assets, "find_spec", lambda _: None)
    with pytest.raises(OSError, match="install rerun-notebook"):
        viewer_files()
