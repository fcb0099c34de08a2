"""The monocular method with a rolling shutter: motions by the poses around a frame, and frames put right by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.localise import Localisation, localise_by_tracks
from ispom.estimators.modern.monocular.map import Map, RelativeFrame, TracksInMap, optimise
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.shutter import (
    correct_by_motion,
    correct_first_map,
    correct_frames,
    speeds_by_motion,
)
from ispom.estimators.modern.monocular.tracks import LiveTracks, TrackingResult
from ispom.estimators.modern.monocular.window import anchored_prior
from ispom.estimators.modern.rolling import RollingTracks, late_px, late_s, motion_at
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig, TrackStatus
from tests.estimators.modern.setups import setup_of

STEP_NS, READOUT_S = 33_333_333, 0.02
CAMERA = Camera(640, 480, 450.0, 450.0, 319.5, 239.5, (0.05, -0.02, 0.0, 0.0), line_delay_s=READOUT_S / 479)
IDS = np.arange(150, dtype=np.int64)


def shaken(time_ns: int) -> Pose:
    """world_from_camera of a hand that walks, and shakes at 3 and 4 Hz."""
    t = time_ns * 1e-9
    shake = np.sin(2 * np.pi * np.array([3.0, 4.0, 3.5]) * t + np.array([0.3, 1.0, 2.0]))
    return Pose.exp(np.concatenate([0.02 * shake[::-1] + (0, 0, 1.4 * t), 0.02 * shake]))


def points() -> Array:
    rng = np.random.default_rng(3)
    z = rng.uniform(4, 20, len(IDS))
    return np.column_stack([rng.uniform(-0.5, 0.5, len(IDS)) * z, rng.uniform(-0.4, 0.4, len(IDS)) * z, z])


def seen(time_ns: int) -> np.ndarray:
    """(N, 2) [px] each in the row that is exposed when it is there."""
    uv = CAMERA.project(shaken(time_ns).inverse().apply(points()))
    for _ in range(6):
        late_ns = 1e9 * late_s(CAMERA, uv[:, 1])
        poses = [shaken(time_ns + round(ns)) for ns in late_ns]
        uv = np.array([CAMERA.project(q.inverse().apply(p[None]))[0] for q, p in zip(poses, points(), strict=True)])
    return uv.astype(np.float32)


def at_middle(time_ns: int) -> Array:
    return CAMERA.project(shaken(time_ns).inverse().apply(points()))


def test_a_polynomial_through_poses_has_their_motion() -> None:
    twist = np.array([0.3, -0.2, 1.5, 0.4, -0.1, 0.2])
    times = [0, 30_000_000, 100_000_000, 130_000_000]  # an image was dropped
    steady = [(t, Pose.exp(-t * 1e-9 * twist)) for t in times]  # camera_from_world goes by the twist
    for t in times:
        np.testing.assert_allclose(motion_at(steady, t), [*twist, *np.zeros(6)], atol=1e-9)
    pushed = [(t, Pose(translation=np.array([0, 0, (t * 1e-9) ** 3]))) for t in times]
    z = motion_at(pushed, times[2])[[2, 8]]
    np.testing.assert_allclose(z, [-3 * 0.1**2, -6 * 0.1], atol=1e-12)


def test_poses_on_both_sides_tell_the_motion_better_than_those_before() -> None:
    times = [k * STEP_NS for k in range(10, 15)]
    poses, step_ns = [(t, shaken(t)) for t in times], 100_000
    worst = []
    for t, known in ((times[2], poses), (times[4], poses[1:])):
        true = (shaken(t + step_ns).inverse() @ shaken(t - step_ns)).log() / (2e-9 * step_ns)
        worst.append(np.abs(motion_at(known, t)[:6] - true).max() / np.abs(true).max())
    assert worst[0] < 0.02 and worst[1] > 3 * worst[0]


@pytest.mark.parametrize("k", [11, 12, 13])
def test_a_motion_puts_points_where_the_middle_row_saw_them(k: int) -> None:
    now = k * STEP_NS
    poses = [(t, shaken(t)) for t in (now + i * STEP_NS for i in range(-2, 3))]
    uv, pose = seen(now), shaken(now).inverse()
    speed = speeds_by_motion(Lens(CAMERA, np.zeros(2)), uv, points(), pose, motion_at(poses, now))
    assert np.abs(uv - at_middle(now)).max() > 0.7
    assert np.abs(uv - late_px(CAMERA, uv, speed) - at_middle(now)).max() < 0.03


def window(last: int) -> Map:
    """Key frames 4 and `last` - 1 with all that they saw, as if the shutter did not roll; frames between, a little
    off; and the points."""
    of_key = {k: shaken(k * STEP_NS) for k in (4, last - 1)}
    keys = tuple(TrackedFrame(k * STEP_NS, IDS, CAMERA.normalise(seen(k * STEP_NS)), p) for k, p in of_key.items())
    off = {last - 2: Pose.exp(np.array([0.001, -0.001, 0.001, 1e-4, 1e-4, -1e-4]))}
    others = tuple(
        RelativeFrame(k * STEP_NS, 4 * STEP_NS, of_key[4].inverse() @ shaken(k * STEP_NS) @ off.get(k, Pose()))
        for k in range(5, last - 1)
    )
    return Map(keys, ScenePoints(IDS, points()), None, setup().noise.width, others)


def setup(camera: Camera = CAMERA) -> Setup:
    return setup_of(ModernMonocularConfig().build(Rig.single(camera)))


def followed_to(time_ns: int) -> tuple[LiveTracks, TrackingResult]:
    """Tracks in the image of a time, as if the shutter did not roll."""
    last_ns, uv = time_ns - STEP_NS, seen(time_ns)
    live = LiveTracks(ids=IDS, uv=seen(last_ns), time_ns=last_ns)
    return live, TrackingResult(uv, np.full(len(IDS), TrackStatus.ALIVE, np.uint8), np.zeros_like(uv))


def off(found: Localisation, time_ns: int) -> float:
    assert found.fit is not None
    return float(np.linalg.norm((found.fit.camera_from_world @ shaken(time_ns)).translation))


def test_the_last_two_frames_are_put_right_by_the_pose_after_them() -> None:
    last = 13
    before, recent = (
        window(last),
        tuple(RollingTracks(k * STEP_NS, IDS, seen(k * STEP_NS)) for k in (last - 2, last - 1)),
    )
    newest = (last * STEP_NS, shaken(last * STEP_NS))
    after = correct_frames(setup(), before, recent, (newest,))
    true = CAMERA.normalise(at_middle((last - 1) * STEP_NS))
    errors = [float(np.abs(m.keys[-1].x - true).max()) * CAMERA.fx for m in (before, after)]
    assert errors[0] > 0.7 and errors[1] < 0.15
    np.testing.assert_array_equal(after.keys[0].x, before.keys[0].x)
    moved = [
        dict(m.trajectory())[(last - 2) * STEP_NS].inverse() @ shaken((last - 2) * STEP_NS) for m in (before, after)
    ]
    assert np.linalg.norm(moved[0].translation) > 0.0015 and np.linalg.norm(moved[1].translation) < 0.0003


def anchored(world: Map) -> Map:
    """Its first pose and its unit held."""
    none = np.zeros((6, 6))
    return replace(world, prior=anchored_prior(world.poses, world.extra_sigma, none, 0.0))


def shape_error(world: Map) -> float:
    """Of the points, relative to their distances (median)."""
    true = points()[world.points.ids]
    return float(np.median(np.linalg.norm(world.points.xyz - true, axis=1) / true[:, 2]))


def test_a_map_whose_newest_key_frame_is_put_right_is_adjusted_at_once() -> None:
    """Bent as that key frame saw the scene; the frame after it, and so all up to the next key frame, is located by
    what is left."""
    last, sigma = 13, setup().noise.width
    now = last * STEP_NS
    world = anchored(window(last))
    old = world.keys[0].with_updated_coordinates(IDS, CAMERA.normalise(at_middle(world.keys[0].time_ns)))
    bent = optimise(replace(world, keys=(old, world.keys[1])), sigma, 20)[0]
    live, followed = followed_to(now)
    first = localise_by_tracks(TracksInMap(setup(), live, bent), followed, shaken(now))
    recent = RollingTracks((last - 2) * STEP_NS, IDS, seen((last - 2) * STEP_NS)), live.rolling_tracks
    found, straight = correct_by_motion(TracksInMap(setup(), live, bent), recent, now, first)
    assert shape_error(bent) > 0.003 and shape_error(straight) < 0.3 * shape_error(bent)
    assert off(found, now) < 0.3 * off(first, now)
    still = setup(replace(CAMERA, line_delay_s=0.0))
    assert correct_by_motion(TracksInMap(still, live, bent), recent, now, first) == (first, bent)


def test_a_first_map_is_put_right_by_its_own_poses() -> None:
    times = [k * STEP_NS for k in range(4, 13)]
    world = anchored(window(13))
    bent = optimise(world, setup().noise.width, 20)[0]
    recent = tuple(RollingTracks(t, IDS, seen(t)) for t in times)
    straight = correct_first_map(setup(), bent, recent)
    assert shape_error(bent) > 0.003 and shape_error(straight) < 0.5 * shape_error(bent)
    true = [CAMERA.normalise(at_middle(key.time_ns)) for key in bent.keys]
    before, after = (
        [float(np.median(np.linalg.norm(k.x - t, axis=1))) * CAMERA.fx for k, t in zip(m.keys, true, strict=True)]
        for m in (bent, straight)
    )
    assert max(before) > 0.4 and max(after) < 0.15
    assert correct_first_map(setup(replace(CAMERA, line_delay_s=0.0)), bent, recent) is bent


def test_a_frame_is_located_by_its_motion() -> None:
    now, world = 13 * STEP_NS, window(14)
    world = replace(world, keys=world.keys[:1])
    live, followed = followed_to(now)
    first = localise_by_tracks(TracksInMap(setup(), live, world), followed, shaken(now))
    found, _ = correct_by_motion(TracksInMap(setup(), live, world), (live.rolling_tracks,), now, first)
    assert off(found, now) < 0.3 * off(first, now)
    alone = replace(world, relative_frames=())
    assert correct_by_motion(TracksInMap(setup(), live, alone), (live.rolling_tracks,), now, first) == (first, alone)


@pytest.mark.parametrize("gap_s", [0.3, 2.0])
def test_a_pose_after_a_gap_tells_nothing_of_the_motion_before(gap_s: float) -> None:
    world, now = window(13), 12 * STEP_NS + round(gap_s * 1e9)
    recent = (RollingTracks(12 * STEP_NS, IDS, seen(12 * STEP_NS)),)
    after, alone = correct_frames(setup(), world, recent, ((now, shaken(now)),)), correct_frames(setup(), world, recent)
    np.testing.assert_array_equal(after.keys[-1].x, alone.keys[-1].x)


@pytest.mark.parametrize("rate_hz", [4, 8, 15, 60])
def test_frames_at_any_rate_are_put_right_where_three_are_near_enough(rate_hz: int) -> None:
    step_ns = round(1e9 / rate_hz)
    times = [k * step_ns for k in range(1, 8)]
    keys = tuple(TrackedFrame(t, IDS, CAMERA.normalise(seen(t)), shaken(t)) for t in times)
    world = Map(keys, ScenePoints(IDS, points()), None, setup().noise.width)
    after = correct_frames(setup(), world, tuple(RollingTracks(t, IDS, seen(t)) for t in times))
    assert all((a.x != b.x).any() == (rate_hz > 4) for a, b in zip(after.keys, keys, strict=True))
