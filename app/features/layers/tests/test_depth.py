"""Dense depth of a stereo pair in the 3-D view: where its points are, and that there are none unless chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from ispom_app.engine.playback import Playback
from ispom_app.features.layers.commands import Choose
from ispom_app.features.recording.commands import Record, StopRecording
from ispom_app.features.recording.state import Recordings
from ispom_app.session import commands as do
from ispom_app.views.rerun.depth import MOST_POINTS, depth_entries, depth_points
from ispom_app.views.rerun.recorder import Recorder
from rerun.chunk import RrdReader

from ispom.geometry import Pose
from ispom.sequences.formats.simulated import open_simulated, rendered_source
from ispom.simulation.truth import Truth
from ispom.types import Frame, Rig, Sequence, Step, is_stereo
from tests import doubles
from tests.app import helpers


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return open_simulated("tiny", seed=0, cache_dir=tmp_path_factory.mktemp("rendered"), duration_s=0.5)


def pair_of(sequence: Sequence) -> Frame:
    pair = sequence[sequence.kinds.index("stereo")]
    assert is_stereo(pair)
    return pair


def test_the_points_are_where_the_place_is(tiny: Sequence) -> None:
    pair, source = pair_of(tiny), rendered_source("sim:tiny", 0)
    assert source is not None
    truth, camera = Truth(source).depth("left", pair.time_ns), tiny.rig.camera("left")
    xyz, rgb = depth_points(pair, tiny.rig)
    assert 0.3 * MOST_POINTS < len(xyz) <= MOST_POINTS and rgb.shape == xyz.shape
    u, v = np.rint(camera.project(xyz)).astype(int).T
    true = truth[v, u]
    solid = np.isfinite(true)  # the edge of a roof may be matched into the sky
    assert solid.mean() > 0.98
    assert np.median(np.abs(xyz[solid, 2] / true[solid] - 1)) < 0.01
    assert (rgb == pair.left[v, u]).all(), "each in the colour of its pixel"


def large(pair: Frame, rig: Rig) -> tuple[Frame, Rig]:
    """The same in four times as many pixels."""
    left, right = (np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (pair.left, pair.right))
    camera = rig.camera("left").scaled(2)
    return pair.with_images(left=left, right=right), rig.changed(left=camera, right=camera)


def test_a_large_image_gives_the_same_points(tiny: Sequence) -> None:
    pair = pair_of(tiny)
    plain, doubled = depth_points(pair, tiny.rig)[0], depth_points(*large(pair, tiny.rig))[0]
    assert len(doubled) == pytest.approx(len(plain), rel=0.05)
    assert np.median(doubled, axis=0) == pytest.approx(np.median(plain, axis=0), rel=0.02, abs=0.02)


def test_a_grey_pair_gives_grey_points(tiny: Sequence) -> None:
    pair = pair_of(tiny)
    _, rgb = depth_points(pair.with_images(left=pair.left[..., 0], right=pair.right[..., 0]), tiny.rig)
    assert len(rgb) and (rgb == rgb[:, :1]).all()


def step(method: str, pose: Pose | None) -> Step:
    return replace(doubles.FakeEstimator(method).step((), pair_of(doubles.sequence()))[1], world_from_frame=pose)


def test_they_are_in_the_pose_of_the_metric_method_that_is_shown() -> None:
    sequence = doubles.sequence()
    pair, moved = pair_of(sequence), Pose(translation=np.array([0.0, 0.0, 100.0]))
    steps = [step("monocular", Pose()), step("stereo", Pose()), step("integrated", moved)]

    def path_and_depth(*hidden: str) -> list[tuple[str, int]]:
        found = depth_entries(pair, steps, sequence.rig, hidden)
        return [(entry.path, round(float(positions(entry.value)[:, 2].min()) // 100)) for entry in found]

    assert path_and_depth() == [("world/integrated/depth", 1)]
    assert path_and_depth("integrated") == [("world/stereo/depth", 0)]
    assert path_and_depth("integrated", "stereo") == [], "a single camera has no metric unit"
    assert not list(depth_entries(pair, [step("stereo", None)], sequence.rig)), "without a pose there is no place"


def positions(value: rr.AsComponents) -> np.ndarray:
    assert isinstance(value, rr.Points3D) and value.positions is not None
    return value.positions.as_arrow_array().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)


def test_a_recording_has_it_of_the_pairs_while_it_is_chosen(tmp_path: Path) -> None:
    run = Playback(doubles.sequence(30), ("stereo",), builder=helpers.build)
    chosen: list[bool] = []
    recorder, never = Recorder(run.opened, lambda: bool(chosen)), Recorder(run.opened)
    found: list[tuple[int, str]] = []
    while not run.done:
        event = run.step()
        chosen[:] = [True] * (10 <= event.index < 20)
        entries = recorder.batch(event).entries
        found += [(event.index, type(e.value).__name__) for e in entries if e.path == "world/stereo/depth"]
        assert not any(entry.path.endswith("/depth") and "world" in entry.path for entry in never.batch(event).entries)
    pairs = [i for i, kind in enumerate(run.sequence.kinds) if kind == "stereo"]
    inside = [i for i in pairs if 10 <= i < 20]
    after = next(i for i in pairs if i >= 20)
    assert inside and found == [*((i, "Points3D") for i in inside), (after, "Clear")]


@pytest.mark.parametrize("is_chosen", [True, False])
def test_a_session_records_it_with_the_layer_and_only_then(tmp_path: Path, is_chosen: bool) -> None:
    session = helpers.started(tmp_path)
    helpers.wait_for(lambda: session.state.phase == "ready", "the source")
    session.post(Choose(frozenset({"depth"} if is_chosen else ())))
    session.post(Record("a"))
    helpers.wait_for(lambda: session.state[Recordings].current is not None, "the recording")
    session.post(do.Seek(session.state.total - 1))
    helpers.wait_for(lambda: session.state.index == session.state.total - 1, "the last frame")
    session.post(StopRecording())
    helpers.wait_for((tmp_path / "a.rrd").exists, "the file")
    session.close(5)
    chunks = RrdReader(tmp_path / "a.rrd").stream().filter(content="/world/integrated/depth").to_chunks()
    assert bool(list(chunks)) == is_chosen
