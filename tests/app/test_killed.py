"""A run that is killed at any moment is repaired up to there. Moments are of its files' growth, not of a clock."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import MARKER, is_incomplete
from ispom_app.engine.run_folder.table import read_table
from ispom_app.views.rerun.file_recording import FLUSH_EVERY
from ispom_app.views.rerun.rrd import is_finished

from ispom.io.trajectories import read_tum
from ispom.io.whole import PART, part_of
from tests.app import helpers
from tests.app.recorded import exposures_in
from tests.sequences.kitti_folder import make_drive

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no SIGKILL")
PAIRS = 60


def _rows(folder: Path) -> int:
    """Lines of steps.csv so far."""
    return next((p.read_bytes().count(b"\n") for p in (part_of(folder / "steps.csv"),) if p.exists()), 0)


def _recorded_bytes(folder: Path) -> int:
    part = part_of(folder / "run.rrd")
    return part.stat().st_size if part.exists() else 0


_RANDOM = np.random.default_rng(9)
_MIDDLE, _LATE, _KB = (int(_RANDOM.integers(*span)) for span in ((60, 160), (160, 280), (100, 600)))
MOMENTS: dict[str, Callable[[Path], bool]] = {
    "opening": lambda folder: (folder / MARKER).exists(),
    "recording opened": lambda folder: part_of(folder / "run.rrd").exists(),
    "first frame": lambda folder: _rows(folder) > 1,
    f"{_MIDDLE} rows": lambda folder: _rows(folder) > _MIDDLE,
    f"{_KB} kB recorded": lambda folder: _recorded_bytes(folder) > 1000 * _KB,
    f"{_LATE} rows": lambda folder: _rows(folder) > _LATE,
    "closing": lambda folder: (folder / "monocular.tum").exists(),
}


def _run(drive: str, out: str) -> None:
    from ispom_app.views.rerun import file_recording

    file_recording.WAIT_S = 60.0
    main(["run", drive, "--out", out], helpers.build)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(make_drive(tmp_path_factory.mktemp("kitti"), frames=PAIRS))


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_run_that_is_killed_is_repaired_up_to_there(moment: str, drive: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = multiprocessing.get_context("spawn").Process(target=_run, args=(drive, str(out)))
    process.start()
    try:
        helpers.wait_for(lambda: MOMENTS[moment](out) or not process.is_alive(), moment, 120.0)
    finally:
        process.kill()
        process.join()
    complete = not is_incomplete(out)
    rows = [row for name in ("steps.csv", part_of(out / "steps.csv").name) for row in read_table(out / name)]
    run = max((int(row["exposure"]) + 1 for row in rows), default=0)
    assert main(["repair", str(out)]) == 0
    assert is_incomplete(out) != complete and not [path for path in out.iterdir() if path.name.startswith(PART)]
    if rows:
        found = exposures_in(out / "run.rrd")
        assert is_finished(out / "run.rrd") and found <= set(range(2 * PAIRS))
        behind = FLUSH_EVERY + 1
        assert found >= set(range(run - behind)), "of the last flush, some entities' rows may be there"
        poses = {method: sum(row["method"] == method for row in rows) for method in ("monocular", "stereo")}
        for method, count in poses.items():
            assert count - 1 <= len(read_tum(out / f"{method}.tum")) <= count + 1 if count else True
