"""`ispom run`: what the folder holds, and that it is complete or says that it is not."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.engine.playback import Builder
from ispom_app.engine.run_folder.results import in_frame
from ispom_app.engine.run_folder.run_file import read_run_file
from ispom_app.engine.run_folder.run_folder import MARKER
from ispom_app.features.headless import console
from ispom_app.features.report.folder import read_run
from ispom_app.views.rerun.rrd import is_finished

from ispom.io.rig import read_rig
from ispom.io.trajectories import read_tum
from ispom.types import Step, Trajectory
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import ran
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import make_video

FILES = {
    "run.yaml",
    "rig.yaml",
    "truth.tum",
    *(f"{m}.tum" for m in METHODS),
    "metrics.json",
    "thumbnail.jpg",
    "landmarks.npz",
    "steps.csv",
    "decisions.csv",
    "events.csv",
}


@pytest.fixture
def drive(tmp_path: Path) -> str:
    return str(make_drive(tmp_path / "kitti"))


def run(source: str, out: Path, *options: str, builder: Builder = helpers.build) -> int:
    """With estimators that walk a given path, so that only the command is under test."""
    return main(["run", source, "--out", str(out), *options], builder)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_writes_all_its_files(drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(drive, out, "--stereo-every", "2", "--monocular.max-tracks", "400") == 0
    assert names(out) == FILES | {"run.rrd"}
    run_file = yaml.safe_load((out / "run.yaml").read_text())
    assert run_file["source"] == drive and run_file["config"]["monocular"]["max_tracks"] == 400
    assert (run_file["exposures"], run_file["duration_s"]) == ({"video": 6, "stereo": 3}, 0.5) and "numpy" in run_file[
        "versions"
    ]
    assert read_rig(out / "rig.yaml").baseline_m == pytest.approx(0.5)
    assert len(read_tum(out / "stereo.tum")) == 3 and len(read_tum(out / "monocular.tum")) == 6
    assert "Emulated" in capsys.readouterr().out and "Emulated" in run_file["notes"][0]


def test_metrics_per_method(drive: str, tmp_path: Path) -> None:
    assert run(drive, tmp_path / "out", "--no-recording") == 0
    report = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert 0 <= report["cpu_ms_per_exposure"]["median"] <= report["cpu_ms_per_exposure"]["p95"]
    assert report["peak_memory_mb"] is None or report["peak_memory_mb"] > 20
    methods = report["methods"]
    common = {
        "ate_m",
        "aligned",
        "rpe_m",
        "rpe_deg",
        "t_err_percent",
        "r_err_deg_per_100m",
        "poses",
        "frames",
        "located",
        "lost",
    }
    assert all(common | {"ms_per_exposure"} <= set(entry) for entry in methods.values())
    assert [methods[m]["aligned"] for m in METHODS] == ["sim3", "se3", "se3"]
    assert {"between_stereo_rmse_m", "spline_between_stereo_rmse_m"} <= set(methods["integrated"])
    assert methods["stereo"]["ms_per_exposure"] == {"median": pytest.approx(5), "p95": pytest.approx(5)}


def test_without_truth_only_what_can_be_computed(tmp_path: Path) -> None:
    drive = make_drive(tmp_path / "kitti", poses=False)
    assert run(str(drive), tmp_path / "out", "--no-recording") == 0
    assert names(tmp_path / "out") == FILES - {"truth.tum"}
    entry = json.loads((tmp_path / "out" / "metrics.json").read_text())["methods"]["stereo"]
    assert set(entry) == {"poses", "frames", "located", "lost", "ms_per_exposure"}


def test_the_requested_methods_only(drive: str, tmp_path: Path) -> None:
    assert run(drive, tmp_path / "out", "--no-recording", "--methods", "integrated") == 0
    assert names(tmp_path / "out") == FILES - {"monocular.tum", "stereo.tum"}
    methods = json.loads((tmp_path / "out" / "metrics.json").read_text())["methods"]
    assert list(methods) == ["integrated"]
    # The integration and the stereo poses that it is measured between are the stand-in's, which walks one path.
    assert methods["integrated"]["between_stereo_rmse_m"] == pytest.approx(0.0, abs=1e-9)


def test_two_runs_write_the_same_bytes(drive: str, tmp_path: Path) -> None:
    for out, more in (("a", ("--no-recording",)), ("b", ())):
        assert run(drive, tmp_path / out, *more) == 0
    for name in (f"{m}.tum" for m in METHODS):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_complete_run_is_never_overwritten(drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(drive, tmp_path / "out", "--no-recording") == 0
    before = (tmp_path / "out" / "metrics.json").stat().st_mtime_ns
    assert run(drive, tmp_path / "out", "--no-recording") == 2
    assert "holds a complete run" in capsys.readouterr().err
    assert (tmp_path / "out" / "metrics.json").stat().st_mtime_ns == before


def test_a_bug_leaves_the_marker(drive: str, tmp_path: Path) -> None:
    class Broken(doubles.FakeEstimator):
        def step(self, state, exposure, asked=None) -> tuple[tuple[int, ...], Step]:
            raise ZeroDivisionError("oops")

    with pytest.raises(ZeroDivisionError):
        run(drive, tmp_path / "out", "--no-recording", builder=lambda c, m, r: doubles.ensemble(m, Broken))
    assert "oops" in (tmp_path / "out" / MARKER).read_text()


@pytest.mark.parametrize("frame", ["rig", "left", "video"])
def test_frames(frame: str) -> None:
    """A metric trajectory moves by the whole lever arm."""
    rig = doubles.rig()
    poses = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 10**9, 10**8)])
    moved = in_frame(poses, rig, frame)  # type: ignore[arg-type]
    assert moved.frame == frame
    expected = doubles.pose_at(3 * 10**8) @ rig.rig_from(frame)  # type: ignore[arg-type]
    np.testing.assert_allclose(moved.pose(3).matrix, expected.matrix, atol=1e-12)


@pytest.mark.parametrize("unit_m", [1.0, 4.0])
def test_the_lever_arm_is_in_the_trajectorys_unit(unit_m: float) -> None:
    rig = doubles.rig()
    metric = Trajectory.of([(t, doubles.pose_at(t) @ rig.rig_from_video) for t in range(0, 10**9, 10**8)], "video")
    own = Trajectory(metric.times_ns, metric.rotations, metric.translations / unit_m, "video")
    of_rig = in_frame(own, rig, "rig", unit_m)
    np.testing.assert_allclose(unit_m * of_rig.translations[2], doubles.pose_at(2 * 10**8).translation, atol=1e-12)


def test_without_unit_there_is_no_lever_arm() -> None:
    rig = doubles.rig()
    own = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 10**9, 10**8)], "video")
    of_rig = in_frame(own, rig, "rig", None)
    np.testing.assert_array_equal(of_rig.translations, own.translations)
    np.testing.assert_allclose(of_rig.rotations, own.rotations @ rig.rig_from_video.rotation.T, atol=1e-12)


def test_the_default_folder_is_in_recordings(drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", drive, "--no-recording"], helpers.build) == 0
    (folder,) = (tmp_path / "recordings").iterdir()
    assert folder.name.startswith("KITTI-07-") and names(folder) == FILES


def test_a_folder_of_one_video_stays_that_video_with_its_runs_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was refused once a run had been written to it."""
    make_video(tmp_path)
    monkeypatch.chdir(tmp_path)
    for out in (("--out", "complete"), ("--out", "killed"), ()):
        assert main(["run", ".", *out, "--no-recording"], helpers.build) == 0
    (tmp_path / "killed" / "run.yaml").rename(tmp_path / "killed" / MARKER)
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {"complete", "killed", "recordings"}
    ran(".", Path("again"), "--no-recording", builder=helpers.build)
    (tmp_path / "others").mkdir()
    assert main(["run", ".", "--no-recording", "--out", "refused"], helpers.build) == 2


def test_progress_is_for_terminals_only(capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress(3) as advance:
        advance()
    assert capsys.readouterr().err == ""


def test_help_needs_no_viewer_nor_ray_caster() -> None:
    """Each takes seconds to import."""
    code = (
        "import sys; from ispom_app.cli.main import main\n"
        "try: main(['run', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'rerun', 'viser', 'open3d', 'aiohttp'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr


def test_runs_record_whether_they_saw_the_same_images(drive: str, tmp_path: Path) -> None:
    def seen(name: str, *options: str) -> str:
        assert run(drive, tmp_path / name, "--no-recording", *options) == 0
        return yaml.safe_load((tmp_path / name / "run.yaml").read_text())["images_sha256"]

    first = seen("a")
    assert len(first) == 64 and seen("b", "--stereo.max-tracks", "300") == first
    assert seen("c", "--video-scale", "0.5") != first and seen("d", "--max-exposures", "6") != first


def stopped(folder: Path) -> dict | None:
    return yaml.safe_load((folder / "run.yaml").read_text())["stopped"]


def without_times(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return [[row[name] for name in row if name not in ("seconds", "stages")] for row in csv.DictReader(file)]


def test_a_run_stops_where_the_condition_holds(drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its folder is complete: that of a run over the frames up to there, with the recording."""
    condition = "monocular.key_frame and exposure > 3"
    assert run(drive, tmp_path / "a", "--until", condition) == 0
    run_file = yaml.safe_load((tmp_path / "a" / "run.yaml").read_text())
    last, time_s = run_file["stopped"]["exposure"], run_file["stopped"]["time_ns"] / 1e9
    assert run_file["options"]["until"] == condition and sum(run_file["exposures"].values()) == last + 1
    assert run_file["stopped"]["values"] == {"monocular.key_frame": True, "exposure": last}
    assert read_run_file(tmp_path / "a").stopped == run_file["stopped"]
    sentence = f"stopped at frame {last} ({time_s:.3f} s) by --until {condition}: "
    assert f"{sentence}monocular.key_frame yes, exposure {last}\n" in capsys.readouterr().out
    assert names(tmp_path / "a") == FILES | {"run.rrd"}
    assert run(drive, tmp_path / "b", "--max-exposures", str(last + 1)) == 0
    for name in (*(f"{m}.tum" for m in METHODS), "landmarks.npz", "decisions.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert without_times(tmp_path / "a" / "steps.csv") == without_times(tmp_path / "b" / "steps.csv")


def test_a_run_that_stops_before_it_moved_is_complete(drive: str, tmp_path: Path) -> None:
    assert run(drive, tmp_path / "a", "--until", "exposure == 0", "--no-recording") == 0
    assert names(tmp_path / "a") == FILES and len(read_tum(tmp_path / "a" / "stereo.tum")) == 1


def test_a_condition_that_never_holds_is_reported(
    drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--until", "stereo.status == 'lost'", "--max-exposures", "8", "--no-recording")
    assert run(drive, tmp_path / "a", *options) == 0
    assert "--until never held: stereo.status == 'lost'\n" in capsys.readouterr().out
    assert stopped(tmp_path / "a") is None and len(read_tum(tmp_path / "a" / "monocular.tum")) == 4


@pytest.mark.parametrize(
    ("condition", "options", "said"),
    [
        ("stero.status == 'lost'", (), "--until: column 1 of the expression: stero.status is unknown: did you mean"),
        ("stereo.status = 'lost'", (), "--until: column 15 of the expression: = compares nothing: write =="),
        ("stereo.scale > 1", ("--methods", "monocular"), "--until names stereo.scale, but monocular run here"),
    ],
)
def test_a_wrong_condition_is_refused_before_anything_is_opened(
    condition: str, options: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("/no/such/source", tmp_path / "out", "--until", condition, *options) == 2
    assert capsys.readouterr().err.startswith(f"ispom: {said}") and not (tmp_path / "out").exists()


def test_a_condition_on_a_method_that_does_not_run_is_refused_before_anything_is_written(
    drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(drive, tmp_path / "out", "--until", "stereo.paper.status == 'lost'") == 2
    assert "--until names stereo.paper.status" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_condition_on_the_error_needs_a_truth(drive: str, tmp_path: Path) -> None:
    """Without one it is missing, and never holds."""
    bare = make_drive(tmp_path / "bare", poses=False)
    for source, holds in ((drive, True), (str(bare), False)):
        out = tmp_path / f"out-{holds}"
        assert run(source, out, "--no-recording", "--until", "stereo.error_m >= 0") == 0
        assert (stopped(out) is not None) == holds


class _Dropped:
    """Gets a signal where Python drops what its handler raises."""

    def __init__(self, number: int) -> None:
        self._number = number

    def __del__(self) -> None:
        signal.raise_signal(self._number)


SIGNALS = pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])


@pytest.fixture
def interruptible(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A shell's background jobs, the tests among them, are started with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ended(drive: str, out: Path, estimator: type[doubles.FakeEstimator]) -> int | str | None:
    """The exit code of a run."""
    try:
        return run(drive, out, builder=lambda _config, methods, _rig: doubles.ensemble(methods, estimator))
    except SystemExit as end:
        return end.code


@SIGNALS
def test_a_signal_keeps_what_was_computed(
    number: int, code: int, drive: str, tmp_path: Path, interruptible: None
) -> None:
    class Interrupted(doubles.FakeEstimator):
        def step(self, state, exposure, *asked):
            if exposure.time_ns == 300_000_000:
                signal.raise_signal(number)
            return super().step(state, exposure, *asked)

    out = tmp_path / "out"
    assert ended(drive, out, Interrupted) == code
    assert names(out) == FILES | {"run.rrd", MARKER}
    assert "7 of 12" in (out / MARKER).read_text()
    assert any("7 of 12" in note for note in read_run(out, "stopped").manifest["notes"])
    assert len(read_tum(out / "monocular.tum")) == 3
    assert run(drive, out) == 0 and names(out) == FILES | {"run.rrd"}


@SIGNALS
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_signal_that_a_destructor_drops_still_ends_the_run(
    number: int, code: int, drive: str, tmp_path: Path, interruptible: None
) -> None:
    class Signalled(doubles.FakeEstimator):
        def step(self, state, exposure, *asked):
            if exposure.time_ns == 400_000_000:
                _Dropped(number)
            return super().step(state, exposure, *asked)

    assert ended(drive, tmp_path / "out", Signalled) == code
    assert "9 of 12" in (tmp_path / "out" / MARKER).read_text()


@SIGNALS
@pytest.mark.parametrize("dropped", [False, True])
def test_a_signal_after_the_last_exposure_ends_the_run_with_all_its_files(
    number: int, code: int, dropped: bool, drive: str, tmp_path: Path, interruptible: None
) -> None:
    class Signalled(doubles.FakeEstimator):
        def finish(self, state, *asked):
            _Dropped(number) if dropped else signal.raise_signal(number)
            return super().finish(state, *asked)

    out = tmp_path / "out"
    assert ended(drive, out, Signalled) == code
    assert "12 of 12" in (out / MARKER).read_text()
    assert names(out) == FILES | {"run.rrd", MARKER} and is_finished(out / "run.rrd")
