"""A map begins where the camera travels; where it pans or zooms, its place is held."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular.initialise import Progress, advance
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.estimators.modern.monocular.state import MAX_FRAMES, Start
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Array, Pose, so3_exp
from ispom.numerics.robust import Noise
from ispom.types import Decision

SIGMA, NOISE = 1e-3, 4e-4
TRACKS = Noise(SIGMA / LOSS, LOSS)
FRAMES = 20
RIGHT, SHIFT_DEG = np.array([1.0, 0.0, 0.0]), 0.2


def progress(moved: list[tuple[Pose, float]], focal: float = 1.0) -> tuple[Progress, list[dict[str, Decision]]]:
    """After frames by these poses camera_from_world and zooms, with a camera of another focal length than given."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (200, 3))
    found, said = Progress(Start(), (), None), list[dict[str, Decision]]()
    for i, (pose, zoom) in enumerate(moved):
        x = focal * zoom * _seen(pose.apply(xyz)) + rng.normal(0, NOISE, (200, 2))
        found = advance(found.start, TrackedFrame(i * 100_000_000, np.arange(200), x), TRACKS, np.radians(1.0))
        said.append({d.key: d for d in found.decisions})
        if found.map is not None:
            break
    return found, said


def _seen(p: Array) -> Array:
    return p[:, :2] / p[:, 2:]


def panned(by_rad: float) -> Pose:
    return Pose(so3_exp(np.array([0.1 * by_rad, by_rad, 0.0])), np.zeros(3))


@pytest.mark.parametrize("focal", [1.0, 0.7, 1.4])
def test_a_pan_makes_no_map_even_by_a_wrong_focal_length(focal: float) -> None:
    found, said = progress([(panned(0.03 * i), 1.0) for i in range(FRAMES)], focal)
    assert found.map is None and found.held is not None
    if focal != 1.0:
        assert said[-1]["start_parallax"].passed and not said[-1]["travel"].passed, "the turn alone looks like travel"


@pytest.mark.parametrize("focal", [1.3, 1.6])
def test_travel_is_an_angle_by_the_focal_length_that_a_pan_has(focal: float) -> None:
    """A hand that pans goes along by some centimetres: 0.2 degrees, by whatever focal length is given."""
    found, said = progress([(panned(0.03 * i) @ Pose(np.eye(3), 0.003 * i * RIGHT), 1.0) for i in range(FRAMES)], focal)
    assert found.map is None and said[-1]["start_parallax"].passed
    assert said[-1]["travel"].value == pytest.approx(SHIFT_DEG, rel=0.15)


def test_a_zoom_makes_no_map() -> None:
    found, said = progress([(panned(0.005 * i), 1.02**i) for i in range(FRAMES)])
    assert found.map is None and not said[-1]["travel"].passed


@pytest.mark.parametrize("way", [(0.04, 0.0, 0.0), (0.0, 0.0, 0.15)])
def test_travel_makes_one(way: tuple[float, float, float]) -> None:
    found, said = progress([(Pose(np.eye(3), -i * np.array(way)), 1.0) for i in range(FRAMES)])
    assert found.map is not None and said[-1]["travel"].passed


def test_a_toy_full_of_corners_before_a_still_background_makes_none() -> None:
    rng = np.random.default_rng(1)
    toy, wall = (
        rng.uniform((-0.3, -0.3, 2), (0.3, 0.3, 2.5), (200, 3)),
        rng.uniform((-2, -1.5, 5), (2, 1.5, 7), (90, 3)),
    )
    found = Progress(Start(), (), None)
    for i in range(FRAMES):
        waved = Pose(so3_exp(np.array([0.0, 0.01 * i, 0.0])), np.array([0.03 * i, 0.0, 0.0]))
        x = np.concatenate([_seen(waved.apply(toy)), _seen(wall)]) + rng.normal(0, NOISE, (290, 2))
        found = advance(found.start, TrackedFrame(i * 100_000_000, np.arange(290), x), TRACKS, np.radians(1.0))
        assert found.map is None
    said = {d.key: d for d in found.decisions}
    assert said["start_parallax"].passed and not said["travel"].passed
    assert said["second_motion"].value > 0.5 and not said["second_motion"].passed


@pytest.mark.parametrize("way", [(0.0, 0.0, 0.06), (0.02, 0.0, 0.05), (0.03, 0.0, 0.0)])
@pytest.mark.parametrize("seed", range(3))
def test_near_things_beside_a_camera_that_starts_to_drive_are_no_moving_object(
    way: tuple[float, float, float], seed: int
) -> None:
    """Most of the image is far, and looks like a zoom or like rest. What is near moves as the same drive moves it."""
    rng = np.random.default_rng(seed)
    far, near = rng.uniform((-12, -9, 28), (12, 9, 45), (240, 3)), rng.uniform((-2, 0.6, 2.5), (2, 1.0, 5), (260, 3))
    xyz, found, made = np.concatenate([far, near]), Progress(Start(), (), None), 0
    for i in range(FRAMES):
        x = _seen(xyz - i * np.array(way)) + rng.normal(0, NOISE, (len(xyz), 2))
        found = advance(found.start, TrackedFrame(i * 100_000_000, np.arange(len(xyz)), x), TRACKS, np.radians(1.0))
        second = [d for d in found.decisions if d.key == "second_motion"]
        made += any(d.key == "travel" and not d.passed for d in found.decisions)
        assert all(d.passed for d in second), f"frame {i}: {second[0].about}"
        if found.map is not None:
            break
    assert made or way[2] == 0, "a frame at which the camera seemed to stay"


@pytest.mark.parametrize(("shared", "joined"), [(12, True), (4, False)])
def test_a_start_that_shares_nothing_with_the_frames_before_is_a_segment_of_its_own(shared: int, joined: bool) -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(-0.4, 0.4, (200, 2))
    found = Progress(Start(), (), None)
    nothing = TrackedFrame(0, np.zeros(0, np.int64), np.zeros((0, 2)))
    for time, first in enumerate((0, 0, 200 - shared)):
        ids = first + np.arange(200)
        found = advance(found.start, TrackedFrame(time, ids, x), TRACKS, np.radians(1.0))
    assert found.start.joined is joined and found.held is not None
    dark = advance(advance(Start(), nothing, TRACKS, np.radians(1.0)).start, nothing, TRACKS, np.radians(1.0))
    assert dark.start.joined, "no pose was told before"


@pytest.mark.parametrize(("shared", "known"), [(35, True), (10, False)])
def test_frames_before_a_start_begins_again_are_placed_by_its_map(shared: int, known: bool) -> None:
    """Too few points reach the second frame to begin a map with the first one; they still tell where that was."""
    rng = np.random.default_rng(3)
    xyz, exact = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (500, 3)), NOISE / 10
    centres = [np.array([x, 0.0, 0.0]) for x in (0.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)]
    found, settled = Progress(Start(), (), None), list[tuple[int, Pose]]()
    for i, centre in enumerate(centres):
        ids = np.arange(200) if i == 0 else np.arange(200 - shared, 500)
        x = _seen(xyz[ids] - centre) + rng.normal(0, exact, (len(ids), 2))
        found = advance(found.start, TrackedFrame(i * 100_000_000, ids, x), TRACKS, np.radians(1.0))
        settled += found.settled
        if found.map is not None:
            break
    assert found.map is not None
    poses = dict([*settled, *found.map.trajectory()])
    assert sorted(poses) == [k * 100_000_000 for k in range(i + 1)], "of each frame one pose"
    own = np.stack([poses[k * 100_000_000].translation for k in range(i + 1)])
    unit = (centres[i] - centres[1])[0] / np.linalg.norm(own[i] - own[1])
    back, way = unit * (own[0] - own[1]), (own[i] - own[1]) / np.linalg.norm(own[i] - own[1])
    assert back == pytest.approx((-0.3 if known else 0.0) * way, abs=0.01)


def test_a_long_wait_for_parallax_leaves_no_frame_behind() -> None:
    """Frames are thinned out while it lasts: those that are not remembered lie between those that are."""
    count, deg_a_frame = 300, 0.004
    centres = [np.array([1.0 * (i / count) ** 2, 0.02 * np.sin(i / 40), 0.0]) for i in range(count)]
    rng = np.random.default_rng(4)
    xyz = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (200, 3))
    found, settled, ids = Progress(Start(), (), None), list[tuple[int, Pose]](), np.arange(200)
    for i, centre in enumerate(centres):
        pose = Pose(so3_exp(np.array([0.0, np.radians(deg_a_frame) * i, 0.0])), np.zeros(3)) @ Pose(np.eye(3), -centre)
        x = _seen(pose.apply(xyz)) + rng.normal(0, NOISE / 10, (200, 2))
        found = advance(found.start, TrackedFrame(i * 100_000_000, ids, x), TRACKS, np.radians(1.5))
        settled += found.settled
        assert len(found.start.frames) <= MAX_FRAMES
        if found.map is not None:
            break
    assert found.map is not None and i > MAX_FRAMES + 50
    poses = dict([*settled, *found.map.trajectory()])
    assert sorted(poses) == [k * 100_000_000 for k in range(i + 1)], "of each frame one pose"
    own, true = (np.stack(some) for some in ([poses[k].translation for k in sorted(poses)], centres[: i + 1]))
    unit = np.linalg.norm(true[-1] - true[0]) / np.linalg.norm(own[-1] - own[0])
    assert np.linalg.norm(unit * own - true, axis=1).max() < 0.01
