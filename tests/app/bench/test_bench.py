"""`ispom bench`: its rows, peers and refusals. No time is asserted."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.benchmark import child, measure, plan, tables, unit
from ispom_app.features.benchmark.plan import PEERS

from tests.alone import METHODS
from tests.app import helpers
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows in this process, with estimators that walk the true path, and a small speed unit."""
    monkeypatch.setattr(measure, "build", helpers.build)
    monkeypatch.setattr(unit.Unit, "measure", lambda self, times=7: self.samples_ms.append(10.0))

    def measured_elsewhere(module: str, task: dict, one_thread: bool = True) -> object:
        assert module == "ispom_app.features.benchmark.measure"
        return measure.answer(task)

    monkeypatch.setattr(child, "found", measured_elsewhere)


def drive(folder: Path) -> Path:
    """A data folder with a tiny KITTI 06."""
    made = make_drive(folder / "kitti")
    made.rename(made.with_name("06"))
    (folder / "kitti" / "poses" / "07.txt").rename(folder / "kitti" / "poses" / "06.txt")
    return folder


@pytest.mark.usefixtures("quick")
def test_rows_peers_and_what_is_absent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = tmp_path / "bench.json"
    sources = ["kitti-06", "kitti-00", "euroc"]
    arguments = ["--data", str(drive(tmp_path)), "--sources", *sources, "--runs", "2", "--no-blocks"]
    assert main(["bench", *arguments, "--json", str(written)]) == 0
    printed, report = capsys.readouterr().out, json.loads(written.read_text())
    for peer in PEERS["kitti-06", "stereo"]:
        assert peer.name in printed and peer.t_err_percent in printed
    assert printed.count("skipped") == 2 and report["skipped"] == ["kitti-00", "euroc"]
    assert [r["method"] for r in report["rows"]] == ["monocular", "monocular.paper", "stereo", "stereo.paper"]
    for row in report["rows"]:
        found = row["found"]
        assert found["poses"] == found["asked"] > 0 and found["lost"] == 0
        assert found["unit_ms"] == 10.0 and set(found["stages_ms"]) == {"track", "pose"}
        assert found["stages_ms"]["track"]["median"] == pytest.approx(4.0)
        assert 20 < found["peak_mb"] < 10_000


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--runs", "0"], "--runs"),
        (["--sources", "mars"], "mars"),
        (["--json", "nowhere/b.json"], "nowhere"),
    ],
)
def test_misuse_is_reported(arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *arguments]) == 2
    assert word in capsys.readouterr().err


def test_every_peer_is_listed_with_its_row() -> None:
    methods = {case.key: case.methods for case in plan.CASES}
    assert all(method in methods[key] for key, method in PEERS)


def test_a_row_in_a_process_of_its_own(tmp_path: Path) -> None:
    task = {"case": "kitti-06", "source": str(tmp_path), "pair": [], "runs": 1, "method": "stereo.paper"}
    assert "empty folder" in child.found("ispom_app.features.benchmark.measure", task)["error"]
    assert "failed, please report it" in child.found("ispom_app.features.benchmark.nothing", task)["error"]


def test_the_unit() -> None:
    own = unit.Unit()
    own.measure(1)
    assert own.ms > 0 and len(own._points) == unit.POINTS and own._a.shape[::-1] == unit.SIZE


def test_the_peak_counts_allocated_memory() -> None:
    """In a process of its own: what tests gave back before would be taken again, and the peak stay where it was."""
    script = "import numpy as np; from ispom_app.features.benchmark.measure import peak_mb; before = peak_mb()\n"
    script += "held = np.ones(30_000_000); print(peak_mb() - before)"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert math.isnan(float(found)) or float(found) >= 100


def test_the_window_has_the_configured_size() -> None:
    from ispom_app.features.benchmark import blocks

    from ispom.solvers.window import adjustment

    problem = blocks.bundle_window()
    assert len(problem.points) == 1000 and len(problem.rotations) == 10 and set(problem.cameras) == set(range(10))
    assert (np.diff(problem.owners) >= 0).all() and np.isfinite(problem.seen).all()
    found = adjustment.adjust(problem, 1 / 718)
    assert found.cost_after < 0.3 * found.cost_before and np.median(found.distances) < 1.5 / 718


def test_the_stretch_is_the_same_whatever_the_length(tmp_path: Path) -> None:
    case = plan.found_below(plan.CASES[2], drive(tmp_path))
    assert case is not None and case.key == "kitti-06"
    for frames in (2, 3):
        short = plan.Case("k", "K", METHODS, frames, case.source).open()
        assert short.kinds.count("video") == frames == short.kinds.count("stereo")


def test_numbers_that_are_not_there_are_dashes() -> None:
    assert tables._number(None, ".1f") == tables._number(float("nan"), ".1f") == "-"
