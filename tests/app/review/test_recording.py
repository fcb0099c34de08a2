"""A recording by itself, opened for review."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from ispom_app.engine.history.series import Series
from ispom_app.features.breakpoints.commands import FindMatch
from ispom_app.features.stage.drawings import drawings
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.external_paths import ExternalPaths
from ispom_app.session.review.folder import read_stored
from ispom_app.session.review.recording import read_recording
from ispom_app.views.rerun.blueprint import page_layout
from ispom_app.views.rerun.entities import image_size
from ispom_app.views.rerun.live import LiveStream
from ispom_app.views.rerun.rrd import HEADER, messages
from ispom_app.views.viser.screen import Screen

from ispom.errors import InputError
from tests import doubles
from tests.app.helpers import build_full, ran, started, wait_for
from tests.app.run.external_trajectories.made import elsewhere, read, written
from tests.sequences.kitti_folder import make_drive


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("recorded")
    drive = str(make_drive(place / "kitti", 14))
    Path(drive, "times.txt").write_text("".join(f"{100 + i / 10:.6f}\n" for i in range(14)))
    return ran(drive, place / "run", "--stereo-every", "2", builder=build_full)


@pytest.fixture
def recording(run: Path, tmp_path: Path) -> Path:
    """Without the run around it."""
    (tmp_path / "alone.rrd").write_bytes((run / "run.rrd").read_bytes())
    return tmp_path / "alone.rrd"


def test_what_its_plots_hold_is_known_and_nothing_else_is_claimed(run: Path, recording: Path) -> None:
    whole, alone = read_stored(run, lambda s, o: o.open(s), build_full), read_recording(recording)
    assert alone.methods == whole.methods
    expected, found = Series(whole.methods), Series(alone.methods)
    for stored, series in ((whole, expected), (alone, found)):
        for record in stored.records():
            series.append(record)
    assert len(found) == len(expected) == 21
    for method in alone.methods:
        for key in ("error_m", "scale", "inliers", "residual_median_px"):
            mine, said = (s.values(f"{method}.{key}") for s in (found, expected))
            stepped = [i for i in range(21) if found.stepped([method], i)]
            np.testing.assert_array_equal(mine[stepped], said[stepped])
        assert np.isnan(found.values(f"{method}.status")).all()
    assert [r.kind for r in alone.records()] == [r.kind for r in whole.records()]
    rig = whole.playback.sequence.rig
    cameras = {"video": rig.video, "left": rig.left, "right": rig.left}
    assert alone.image_sizes == {n: tuple(image_size(c).astype(int)) for n, c in cameras.items() if c is not None}
    opened = CurrentRun.of_stored(alone, 10**6).opened
    assert list(page_layout(opened)["images"].values()) == list(alone.image_sizes.values())
    times = np.array([r.time_ns for r in whole.records()])
    assert (alone.playback.sequence.times_ns == times).all()


def test_another_programs_trajectory_is_drawn_with_a_recording_at_the_times_of_its_source(
    recording: Path, run: Path, tmp_path: Path
) -> None:
    source = read_stored(run, lambda s, o: o.open(s), build_full).playback.sequence
    orb = read(written(tmp_path / "orb.tum", elsewhere(source)))
    session = started(tmp_path / "recordings", str(recording), trajectory_options=(orb,))
    wait_for(lambda: session.state.index >= 0, "the recording")
    (external,) = session.state[ExternalPaths].all
    assert external.of_truth is not None and "(14 poses)" in external.of_truth.alignment
    assert np.nanmax(external.errors_m) < 1e-5
    session.close(5)


@pytest.mark.parametrize("alone", [True, False], ids=["recording", "folder"])
def test_another_programs_trajectory_is_drawn_over_what_was_recorded(
    recording: Path, run: Path, tmp_path: Path, alone: bool
) -> None:
    source = read_stored(run, lambda s, o: o.open(s), build_full).playback.sequence
    orb = read(written(tmp_path / "orb.tum", elsewhere(source)))
    options = {"trajectory_options": (orb,), "opener": lambda source, options: options.open(source)}
    session = started(tmp_path / "recordings", str(recording if alone else run), **options)
    wait_for(lambda: session.state.index >= 0, "the recording")
    session.post(do.Seek(9))
    wait_for(lambda: session.state.index == 9, "the seek")
    assert session.run is not None
    found = {d.name: d for d in drawings(session, session.state, session.run)}["external paths"].entries()
    line = next(e.value for e in found if e.path == "world/beside/orb/path/0")
    assert isinstance(line, rr.LineStrips3D) and line.strips is not None
    drawn = line.strips.as_arrow_array().flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)
    (external,) = session.state[ExternalPaths].all
    assert external.of_truth is not None
    poses = external.of_truth.poses
    np.testing.assert_allclose(drawn, poses.translations[poses.times_ns <= source.times_ns[9]], atol=1e-5)
    session.close(5)


def test_without_truth_in_a_recording_the_page_says_so_and_goes_on(tmp_path: Path) -> None:
    drive = make_drive(tmp_path / "kitti", 14, poses=False)
    ran(drive, tmp_path / "run", builder=build_full)
    alone = (tmp_path / "run" / "run.rrd").rename(tmp_path / "alone.rrd")
    orb = read(written(tmp_path / "orb.tum", elsewhere(doubles.sequence(14))))
    session = started(tmp_path / "recordings", str(alone), trajectory_options=(orb,))
    wait_for(lambda: session.state.index >= 0, "the recording")
    screen = Screen(session)
    screen.show_tabs(screen.tabs)
    screen.paint()
    assert session.state[ExternalPaths].all[0].of_truth is None and not session.state.notices[1:]
    screen.server.stop()
    session.close(5)


def test_the_page_shows_it_and_its_bytes_go_to_the_viewer(recording: Path, tmp_path: Path) -> None:
    live = LiveStream()
    session = started(tmp_path / "recordings", str(recording), live=live)
    wait_for(lambda: session.state.index >= 0, "the recording")
    assert (session.state.total, session.state.index, session.state.methods) == (21, 20, ())
    tape = live.tape
    assert tape is not None and tape.end == 21
    opening = tape.opening()
    assert len(opening) > 1000 and messages(recording.read_bytes()).startswith(opening[:1000])
    assert {"video/image", "left/image", "decisions"} <= {path for path, _ in tape.scene(20).versions}
    screen = Screen(session)
    screen.show_tabs(screen.tabs)
    screen.paint()
    session.post(FindMatch("stereo.inliers > 0", forwards=False))
    wait_for(lambda: session.state.index < 20, "the match")
    screen.paint()
    screen.server.stop()
    session.close(5)
    live.close()


def test_one_of_another_rerun_version_is_refused_in_one_sentence(recording: Path) -> None:
    content = recording.read_bytes()
    recording.write_bytes(content[:5] + bytes([HEADER[5] - 1]) + content[6:])
    with pytest.raises(InputError, match=rf"was written by Rerun 0\.{HEADER[5] - 1}, and the viewer here is 0"):
        read_recording(recording)


@pytest.mark.parametrize(
    ("name", "said"), [("text", "no Rerun recording"), ("cut", "ispom repair"), ("foreign", "ispom run")]
)
def test_what_is_no_recording_of_a_run_is_refused(recording: Path, name: str, said: str) -> None:
    if name == "text":
        recording.write_text("no recording at all")
    elif name == "cut":
        recording.write_bytes(recording.read_bytes()[:-100])
    else:
        with rr.RecordingStream("other") as stream:
            stream.save(recording)
            stream.log("x", rr.Scalars(1.0))
    with pytest.raises(InputError, match=said):
        read_recording(recording)
