"""Tables and plots of several runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.evaluation.coloured import along
from ispom_app.features.evaluation.evaluated import Evaluated

from ispom.errors import InputError
from ispom.evaluation.comparison import compare
from ispom.io.poses.dialect import TrajectoryFile
from ispom.io.trajectories import tum_text
from ispom.types import Trajectory
from tests.app.helpers import ran
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


def _item(folder: Path) -> Evaluated:
    """An estimate with an error of its own at each pose: it moves 0.1 m in 0.1 s, and the reference half as fast."""
    times_ns = (np.arange(300) * 10**8).astype(np.int64)
    line = np.linspace(0, 29.9, 300)[:, None] * [1.0, 0, 0]
    turns = np.tile(np.eye(3), (300, 1, 1))
    own = Trajectory(times_ns, turns, line, "rig")
    true = Trajectory(times_ns, turns, line / 2, "rig")
    files = [TrajectoryFile(folder / name, "TUM", t) for name, t in (("truth.tum", true), ("stereo.tum", own))]
    return Evaluated("stereo", files[1], compare(own, true, (own, true), "none"), files[0])


def test_quantities_along_a_path(tmp_path: Path) -> None:
    item = _item(tmp_path)
    assert along(item, "position-error")[1] == pytest.approx(np.linspace(0, 14.95, 300))
    assert along(item, "speed")[1] == pytest.approx(np.ones(300))
    scale = along(item, "scale")[1]
    assert np.isfinite(scale).any() and scale[np.isfinite(scale)] == pytest.approx(2)
    with pytest.raises(InputError, match="position-error"):
        along(item, "inliers")


def test_a_path_is_coloured_by_a_number_of_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    run, plots = tmp_path / "run", tmp_path / "plots"
    ran("sim:tiny", run, "--max-exposures", "40", "--methods", "stereo")
    arguments = ["evaluate", str(run / "truth.tum"), str(run / "stereo.tum"), "--no-audit", "--plot-format", "svg"]
    for name in ("inliers", "speed"):
        assert main([*arguments, "--plots", str(plots), "--colour-by", name]) == 0
        assert "</svg>" in (plots / "coloured.svg").read_text()
    capsys.readouterr()
    assert main([*arguments, "--plots", str(plots), "--colour-by", "nothing"]) == 2
    assert "inliers" in capsys.readouterr().err
    assert main([*arguments, "--colour-by", "speed"]) == 2


def test_the_share_of_poses_stands_beside_each_error(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", *files, "--no-audit"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "[%]" in line and "KITTI" not in line]
    assert [row.replace("│", " ").split()[-3:] for row in rows] == [["100", "100", "50"]] * 2
