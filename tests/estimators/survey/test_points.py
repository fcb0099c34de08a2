"""Points of one camera: exact on exact points, in spite of outliers, and on images of a bend and of a drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ispom.ensemble import build
from ispom.estimators.survey.points import FIXED_KEYFRAMES, PointsConfig, intersected, refined
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.evaluation.metrics import path_errors
from ispom.geometry import Array, Pose
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.types import Status, Trajectory
from tests.alone import alone, run, stepped_through
from tests.rounds import SCENARIOS, rig, world_from_rig

KITTI = Path("../shared/data/kitti/sequences/06")
FEATURES = "harris", "susan", "shi_tomasi", "sift", "surf", "orb"
WIDTH, LIMIT = 1e-3, 2e-3
XYZ = np.random.default_rng(0).uniform([-6, -4, 5], [6, 4, 25], (120, 3))
POSES = tuple(Pose.from_rotvec(np.array([0, 0.02 * i, 0]), np.array([0.3 * i, 0.02 * i**2, 0.4 * i])) for i in range(5))


def seen(pose: Pose) -> Array:
    inside = pose.inverse().apply(XYZ)
    return inside[:, :2] / inside[:, 2:]


def exact_keys(first_with_late_points: int = 0) -> tuple[TrackedFrame, ...]:
    """Keyframes with all points; the last 20 are seen from the given keyframe on."""
    keys = []
    for i, pose in enumerate(POSES):
        ids = np.arange(len(XYZ) if i >= first_with_late_points else len(XYZ) - 20)
        keys.append(TrackedFrame(i, ids, seen(pose)[ids], pose))
    return tuple(keys)


def test_points_are_intersected_exactly_where_three_keyframes_see_them() -> None:
    points = intersected(exact_keys(2), ScenePoints(), WIDTH, LIMIT)
    assert_allclose(points.ids, np.arange(120))
    assert_allclose(points.xyz, XYZ, atol=1e-6)
    fewer = intersected(exact_keys(3), ScenePoints(), WIDTH, LIMIT)  # two keyframes see the last 20
    assert_allclose(fewer.ids, np.arange(100))


def test_points_that_are_known_are_left_and_those_that_three_views_contradict_are_not_added() -> None:
    keys = exact_keys()
    known = ScenePoints(np.array([3]), np.array([[1.0, 2.0, 3.0]]))
    spoilt = keys[2].x.copy()
    spoilt[7] += 0.02
    points = intersected((*keys[:2], replace(keys[2], x=spoilt), *keys[3:]), known, WIDTH, LIMIT)
    assert 7 not in points.ids and len(points.ids) == len(XYZ) - 1
    assert_allclose(points.xyz[points.places(np.array([3]))], known.xyz)


def test_refinement_finds_the_poses_and_drops_what_does_not_fit() -> None:
    rng, keys = np.random.default_rng(1), exact_keys()
    spoilt = keys[3].x.copy()
    spoilt[:10] += 0.05
    keys = (*keys[:3], replace(keys[3], x=spoilt), keys[4])
    moved = tuple(
        key if i < FIXED_KEYFRAMES else replace(key, world_from_camera=key.pose @ Pose.exp(rng.normal(0, 0.01, 6)))
        for i, key in enumerate(keys)
    )
    found, points, (cost,) = refined(
        moved, ScenePoints(np.arange(120), XYZ + rng.normal(0, 0.02, XYZ.shape)), WIDTH, LIMIT
    )
    assert cost.passed and not np.isin(np.arange(10), points.ids).any() and len(points.ids) == 110
    for key, pose in zip(found, POSES, strict=True):
        assert_allclose(key.pose.matrix, pose.matrix, atol=1e-3)  # ten iterations, with outliers of 25 widths


@pytest.mark.parametrize("features", ["harris", "shi_tomasi"])
def test_a_bend_through_a_cloud_of_balls_is_found(features: str) -> None:
    """Small images: 160 x 120 pixels, so that one pixel is half a degree; some 40 points."""
    scenario = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"video"})
    sequence, estimator = scenario.sequence(80), alone("points", rig(), PointsConfig(features=features))
    state, steps = stepped_through(estimator, (sequence[i] for i in range(80)))
    located = [step.status is Status.TRACKING for step in steps]
    assert all(located[located.index(True) :]) and np.mean(located) > 0.8
    truth = Trajectory.of([(sequence[i].time_ns, world_from_rig(i)) for i in range(80)], "rig")
    path_m = 79 * np.linalg.norm(world_from_rig(1).translation)
    assert path_errors(estimator.finish(state), truth, rig(), False)["ate_m"] < 0.02 * path_m
    assert any(len(step.landmarks.ids) > 20 for step in steps) and all(step.frame == "video" for step in steps)


def test_after_images_without_texture_a_new_segment_starts() -> None:
    scenario = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"video"})
    sequence, frames = scenario.sequence(120), []
    for i in range(120):
        frame = sequence[i]
        frames.append(frame.with_images(video=np.full_like(frame.image, 90)) if 60 <= i < 70 else frame)  # type: ignore[attr-defined]
    steps = list(run(alone("points", rig()), frames))
    states = [step.status for step in steps]
    assert states[0] is Status.INITIALISING and states[59] is Status.TRACKING and states[-1] is Status.TRACKING
    assert all(status is Status.LOST for status in states[60:70])
    assert [step.restarted for step in steps].count(True) == 1
    assert all(step.world_from_frame is None for step in steps[60:70])


@pytest.mark.slow
@pytest.mark.skipif(not KITTI.is_dir(), reason="KITTI 06 is not in ../shared/data")
@pytest.mark.parametrize("features", FEATURES)
def test_kitti_06(features: str) -> None:
    sequence = open_sequence(str(KITTI))
    ensemble = build(Config({"points": PointsConfig(features=features)}), ("points",), sequence.rig)
    state = ensemble.start()
    for i, kind in enumerate(sequence.kinds):
        if kind == "video":
            state, _ = ensemble.step(state, sequence[i])
    assert sequence.truth is not None
    assert path_errors(ensemble.finish(state)["points"], sequence.truth, sequence.rig, False)["t_err_percent"] < 3.0


def test_a_map_begins_although_the_near_points_with_the_parallax_leave() -> None:
    sequence = open_sequence("sim:tiny")
    frames = (frame for frame in map(sequence.load, range(len(sequence))) if frame.kind == "video")
    steps = list(run(alone("points", sequence.rig, PointsConfig(features="susan")), frames))
    assert sum(step.status is Status.TRACKING for step in steps) > len(steps) / 3
