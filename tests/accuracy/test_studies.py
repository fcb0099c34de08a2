"""What all studies have in common."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console

from tests.accuracy import studies


@pytest.mark.parametrize(
    ("study", "recordings"), [("audit", "pairs_in"), ("sensors", "scenes_in"), ("judge", "recordings_in")]
)
def test_a_study_returns_its_rows(study: str, recordings: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(studies, recordings, lambda data: {"a": "b"})
    monkeypatch.setattr(studies, "rows_of", lambda *task: None)
    assert studies.STUDIES[study](Console(quiet=True), studies.Options(tmp_path)) == []
