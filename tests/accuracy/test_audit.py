"""The study of the audit: what it plants, and how it counts."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from ispom.evaluation.audit.correction import Correction
from tests.accuracy import studies
from tests.accuracy.__main__ import main
from tests.accuracy.audit import REAL, SIMULATED, Found, pair_of, pairs_in, plants
from tests.accuracy.page import marks

FOUND = [
    Found("sim:a", "", "right pair", "", True),
    Found("sim:a", "clock +0.25 s", "clock", "offset", True, offset_error_s=0.004),
    Found("real", "axes", "axes", "mirrored", False, cannot_tell=True),
    Found("real", "", "right pair", "offset", False),
]


def test_what_is_planted_changes_the_errors() -> None:
    pair = pair_of("sim:flight 2", Path())
    right = pair.question.measures(Correction())
    kinds = set()
    for plant in plants(pair):
        wrong = replace(pair.question, estimate=plant.applied(pair.question.estimate)).measures(Correction())
        kinds.add(plant.kind)
        assert any((wrong.get(k) or 0) > 1.02 * (right[k] or 0) for k in ("ate_m", "ate_deg")), plant.name
    assert {"clock", "axes", "inverse", "quaternion order", "lever arm", "scale", "unit", "mirrored"} == kinds


def test_pairs_without_files_are_left_out(tmp_path: Path) -> None:
    assert pairs_in(tmp_path) == list(SIMULATED) and len(SIMULATED) + len(REAL) >= 20


def test_the_table_counts_by_kind(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(studies, "found", lambda module, task: [asdict(f) for f in FOUND])
    page = tmp_path / "page.md"
    begin, end = marks("audit")
    page.write_text(f"# Title\n\n{begin}\nold\n{end}\n\nend\n")
    assert main(["audit", "--data", str(tmp_path), "--only", SIMULATED[0], "--table", str(page)]) == 0
    assert "named first: 1 of 2" in " ".join(capsys.readouterr().out.split())
    text = page.read_text()
    assert "| clock |  | 1 of 1 |  | within 4.0 ms |" in text and "| axes | 0 of 1 |  | 1 |  |" in text
    assert "old" not in text and text.startswith("# Title") and text.endswith("end\n")
    assert "false alarm: 1 of 2" in text
