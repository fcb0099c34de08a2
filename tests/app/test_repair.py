"""`ispom repair`: what a killed run left is finished as far as it goes."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import MARKER
from ispom_app.views.rerun.rrd import is_finished

from ispom.ensemble import Ensemble
from ispom.io.trajectories import read_tum
from ispom.io.whole import part_of
from tests import doubles
from tests.app import helpers
from tests.app.helpers import ran
from tests.app.recorded import exposures_in
from tests.sequences.kitti_folder import make_drive

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no SIGKILL")


class Killed(doubles.FakeEstimator):
    def step(self, state, exposure, *asked):
        if exposure.time_ns == 400_000_000:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(state, exposure, *asked)


def _build_killed(config, methods, rig) -> Ensemble:
    return doubles.ensemble(methods, Killed)


def _run(drive: str, out: str) -> None:
    from ispom_app.views.rerun import file_recording

    file_recording.FLUSH_EVERY, file_recording.WAIT_S = 1, 60.0
    main(["run", drive, "--out", out], _build_killed)


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """The folder of a run that was killed at its fifth pair, the ninth of twelve frames."""
    arguments = str(make_drive(tmp_path / "kitti")), str(tmp_path / "recordings" / "out")
    process = multiprocessing.get_context("spawn").Process(target=_run, args=arguments)
    process.start()
    process.join(120)
    assert process.exitcode == -signal.SIGKILL
    return Path(arguments[1])


@pytest.mark.parametrize("place", [".", ".."])
def test_a_killed_run_keeps_its_recording_trajectories_and_metrics(
    place: str, killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert part_of(killed / "run.rrd").exists() and not (killed / "stereo.tum").exists()
    assert main(["repair", str(killed / place)]) == 0
    printed = capsys.readouterr().out
    assert is_finished(killed / "run.rrd") and exposures_in(killed / "run.rrd") == set(range(8))
    for method in ("monocular", "stereo"):
        trajectory = read_tum(killed / f"{method}.tum")
        assert len(trajectory) == 4 and f"{method}.tum: 4 poses" in printed
    methods = json.loads((killed / "metrics.json").read_text())["methods"]
    assert methods["stereo"]["poses"] == 4 and methods["stereo"]["ms_per_exposure"]["median"] == pytest.approx(5)
    assert (killed / MARKER).read_text().startswith("Repaired: 8 of 12")
    assert not [path for path in killed.iterdir() if path.name.startswith(".part-")]
    assert main(["repair", str(killed)]) == 0 and "nothing to repair" in capsys.readouterr().out


def test_a_recording_cut_within_a_message_is_finished(killed: Path) -> None:
    part = part_of(killed / "run.rrd")
    os.truncate(part, part.stat().st_size - 7)
    assert main(["repair", str(killed)]) == 0
    assert is_finished(killed / "run.rrd") and exposures_in(killed / "run.rrd") >= set(range(7))


def test_a_complete_run_stays_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    ran(make_drive(tmp_path / "kitti"), out, "--no-recording", builder=helpers.build)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert main(["repair", str(out)]) == 0 and "holds a complete run" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_folder_that_is_none_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["repair", str(tmp_path / "nowhere")]) == 2
    assert "is no folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["old.rrd", ".part-old.rrd"])
def test_a_recording_of_another_version_is_not_touched(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = b"RRF1" + bytes(range(256)) * 20
    (tmp_path / name).write_bytes(old)
    assert main(["repair", str(tmp_path)]) == 2
    assert f"{name} is no recording" in capsys.readouterr().err
    assert (tmp_path / name).read_bytes() == old


def test_a_recording_that_was_killed_before_its_first_data_is_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / ".part-run.rrd").write_bytes(b"RRF2")
    assert main(["repair", str(tmp_path)]) == 0
    assert "empty, removed" in capsys.readouterr().out and not list(tmp_path.iterdir())
