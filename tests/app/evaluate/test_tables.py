"""Tables and plots of several runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.io.trajectories import tum_text
from tests.evaluation.audit.made_paths import noisy, path


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """A truth and three runs, of which the last one covers half of it."""
    true = path(seconds=10)
    texts = {"truth.tum": true, "a_1.tum": noisy(true, 1), "b.tum": noisy(true, 2), "c.tum": noisy(true, 3)[:100]}
    for name, trajectory in texts.items():
        (tmp_path / name).write_text(tum_text(trajectory))  # type: ignore[arg-type]
    return [str(tmp_path / name) for name in texts]


def test_a_table_for_latex_has_the_coverage_beside_the_errors(files: list[str], tmp_path: Path) -> None:
    out = tmp_path / "table.tex"
    for _ in range(2):  # replaces its own
        assert main(["evaluate", *files, "--no-audit", "--latex", str(out)]) == 0
    text = out.read_text()
    assert text.startswith("%") and r"\toprule" in text and r"\end{tabular}" in text
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    head, first, _, last = rows
    assert {len(row.split("&")) for row in rows} == {6} and r"poses [\%]" in head
    assert first.startswith(r"a\_1.tum & 100 &") and last.startswith("c.tum & 50 &")
    (tmp_path / "mine.tex").write_text("mine")
    assert main(["evaluate", *files, "--latex", str(tmp_path / "mine.tex")]) == 2


def test_errors_of_runs_are_a_band(files: list[str], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    arguments = ["evaluate", *files, "--no-audit", "--plots", str(tmp_path / "plots"), "--plot-format", "svg"]
    assert main([*arguments, "--runs"]) == 0
    assert "</svg>" in (tmp_path / "plots" / "errors.svg").read_text()
