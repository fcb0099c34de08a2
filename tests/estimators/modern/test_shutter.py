"""A pair with a rolling shutter: what it saw is put where the middle row's exposure would have seen it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ispom.estimators.modern.rolling import late_s, steady
from ispom.estimators.modern.stereo.estimator import ModernStereo, ModernStereoConfig
from ispom.estimators.modern.stereo.pair import Setup
from ispom.estimators.modern.stereo.rolling_window import motion_priors, with_motions
from ispom.estimators.modern.stereo.shutter import (
    MotionPrior,
    pair_at_middle,
    points_at_middle,
    points_at_rows,
    refined_motion,
    row_times,
)
from ispom.estimators.modern.stereo.state import KeyFrame, StereoMap
from ispom.geometry import Array, Pose
from ispom.solvers.localisation import fit_pose
from ispom.solvers.right_camera import BOTH_K1, COLUMNS, PAIR, ROLL, by_column
from ispom.solvers.window.prior import anchored
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of

CAMERA = Camera(1280, 960, 920.0, 920.0, 639.5, 470.0, line_delay_s=0.03 / 959)
BASELINE_M, SIGMA = 0.4, 0.17 / 920
RATE = np.array([0.4, -0.3, -2.0, 0.5, -0.4, 0.3])
"""left_from_world's change: 2 m/s, 40 degrees/s."""
MOTION = np.concatenate([RATE, [4.0, -3.0, 2.0, -4.0, 5.0, 3.0]])
"""And how that changes: 5 m/s^2, 400 degrees/s^2."""
POSE = Pose.from_rotvec(np.array([0.1, -0.2, 0.05]), np.array([0.5, 0.2, -1.0]))


def scene() -> Array:
    """(N, 3) in the world."""
    rng = np.random.default_rng(0)
    near = np.column_stack([rng.uniform(-0.6, 0.6, 200), rng.uniform(-0.45, 0.45, 200), np.ones(200)])
    return POSE.inverse().apply(near * rng.uniform(3, 40, (200, 1)))


def seen(near: Array) -> Array:
    """(N, 3) by a pair, of points in its left camera."""
    return np.column_stack([near[:, :2], near[:, 0] - BASELINE_M]) / near[:, 2:]


def times(observations: Array) -> Array:
    """(N,) [s] at which rows saw observations (N, 3)."""
    return late_s(CAMERA, CAMERA.fy * observations[:, 1] + CAMERA.cy)


def at_middle(observations: Array, motion: Array) -> Array:
    return pair_at_middle(observations, times(observations), motion, BASELINE_M)


def rolled(xyz: Array, pose: Pose = POSE, motion: Array = MOTION) -> Array:
    """(N, 3) as rows that are exposed when they are saw points (N, 3) in the world."""
    found = seen(pose.apply(xyz))
    for _ in range(5):
        ways = [Pose.exp(t * motion[:6] + 0.5 * t**2 * motion[6:]) for t in times(found)]
        near = [way.apply(pose.apply(p[None]))[0] for way, p in zip(ways, xyz, strict=True)]
        found = seen(np.stack(near))
    return found


def test_a_known_motion_is_undone() -> None:
    xyz = scene()
    late, middle = rolled(xyz), seen(POSE.apply(xyz))
    assert np.abs(late - middle).max() * CAMERA.fx > 10
    assert np.abs(at_middle(late, MOTION) - middle).max() * CAMERA.fx < 0.01
    assert np.abs(at_middle(late, steady(RATE)) - middle).max() * CAMERA.fx > 0.5


def test_points_go_there_and_back() -> None:
    near = POSE.apply(scene())
    there = points_at_rows(CAMERA, near, MOTION)
    np.testing.assert_allclose(seen(there), rolled(scene()), atol=0.5 / CAMERA.fx)
    np.testing.assert_allclose(points_at_middle(CAMERA, there, MOTION), near, atol=1e-3 * near[:, 2].max())


def test_without_a_disparity_turns_are_undone() -> None:
    alone = rolled(scene()) * (1, 1, np.nan)
    turning = at_middle(alone, MOTION * np.tile([0, 0, 0, 1, 1, 1], 2))
    both = at_middle(alone, MOTION)
    np.testing.assert_array_equal(both[:, :2], turning[:, :2])
    assert np.isnan(both[:, 2]).all()


def test_a_global_shutter_changes_nothing() -> None:
    still, observations, near = replace(CAMERA, line_delay_s=0.0), rolled(scene()), POSE.apply(scene())
    assert row_times(still, observations[:, 1]) is None
    assert pair_at_middle(observations, None, MOTION, BASELINE_M) is observations
    assert points_at_middle(still, near, MOTION) is near and points_at_rows(still, near, MOTION) is near


@pytest.mark.parametrize("noise_px", [0.0, 0.17])
def test_pose_and_motion_are_found_together(noise_px: float) -> None:
    xyz, rng = scene(), np.random.default_rng(1)
    late = rolled(xyz) + rng.normal(0, noise_px / CAMERA.fx, (len(xyz), 3))
    believed = MotionPrior(np.zeros(12), np.repeat([10.0, 3.0, 200.0, 60.0], 3))
    motion, pose = believed.motion, Pose()
    for _ in range(4):
        middle = at_middle(late, motion)
        fit = fit_pose(xyz, middle, pose, SIGMA, 20 / CAMERA.fx, BASELINE_M)
        assert fit is not None
        pose, given = fit.camera_from_world, fit.information
        motion, fit = refined_motion(xyz, middle, times(late), BASELINE_M, SIGMA, believed, motion, fit)
    off = np.abs((pose @ POSE.inverse()).log())
    sigma = np.sqrt(np.linalg.inv(fit.information).diagonal())
    if noise_px:
        assert (off < 4 * sigma).all() and off[:3].max() < 0.01
    else:
        assert np.abs(motion - MOTION)[:6].max() < 0.02 and off.max() < 2e-4
        assert np.abs(motion - MOTION)[9:].max() < 0.2, "10 degrees/s^2"
    assert (sigma > np.sqrt(np.linalg.inv(given).diagonal())).all(), "a pose is known less well with the motion unknown"


def shaken() -> tuple[list[Pose], list[Array]]:
    """Five poses along z with a shake, and their motions (12,)."""
    rng = np.random.default_rng(2)
    poses = [Pose.from_rotvec(0.02 * rng.standard_normal(3), np.array([0, 0, -0.5 * c])) @ POSE for c in range(5)]
    mean, spread = np.array([0.0, 0, -1.5, 0, 0, 0]), np.repeat([0.3, 0.3, 5.0, 5.0], 3)
    return poses, [steady(mean) + spread * rng.standard_normal(12) for _ in poses]


def found_of(setup: Setup, extra: Array) -> tuple[StereoMap, StereoMap, list[Array], Array]:
    """The map begun with one mean motion and a perfect pair, that found by all key frames of a pair with the errors
    `extra`; and the true motions and points."""
    xyz, ids, (poses, motions) = scene(), np.arange(200), shaken()
    mean = steady(np.array([0.0, 0, -1.5, 0, 0, 0]))
    observed = [miscalibrated(rolled(xyz, pose, motion), extra) for pose, motion in zip(poses, motions, strict=True)]
    keys = tuple(
        KeyFrame(c * 333_000_000, pose, ids, seen, mean, np.zeros((200, 2)), times(seen))
        for c, (pose, seen) in enumerate(zip(poses, observed, strict=True))
    )
    bent = keys[0].at_middle(BASELINE_M)
    near = np.column_stack([bent[:, :2], np.ones(len(bent))]) * (BASELINE_M / (bent[:, 0] - bent[:, 2]))[:, None]
    prior = anchored(poses[0].rotation, poses[0].translation, setup.extra_sigma)
    start = found = StereoMap(keys, ids, poses[0].inverse().apply(near), prior=prior)
    for _ in range(6):
        found = with_motions(setup, found)
    return start, found, motions, xyz


def unchecked_setup(**settings: Any) -> Setup:
    """Without a check of the settings: exact observations want a narrower loss than they may have."""
    return setup_of(ModernStereo(Rig.stereo(CAMERA, BASELINE_M), ModernStereoConfig(**settings)))


def off_by(world: StereoMap, motions: list[Array]) -> Array:
    """(12,) the worst of all key frames."""
    return np.abs([k.motion - m for k, m in zip(world.keys, motions, strict=True)]).max(axis=0)


def test_motions_of_key_frames_are_found_together_with_the_map_that_they_bent() -> None:
    setup = unchecked_setup(loss_px=1e-3 * SIGMA * CAMERA.fx, max_error_px=20)
    start, found, motions, xyz = found_of(setup, np.zeros(PAIR))
    before, off = off_by(start, motions), off_by(found, motions)
    assert before[:6].max() > 0.4 and off[:6].max() < 0.03
    then, distance = (np.linalg.norm(w.xyz - xyz, axis=1) / POSE.apply(xyz)[:, 2] for w in (start, found))
    assert np.median(distance) < 0.05 * np.median(then)


def test_what_is_wrong_with_the_pair_is_not_taken_for_motion() -> None:
    """A roll of 0.1 degrees and 0.1 % of distortion, beside motions."""
    extra = np.zeros(PAIR)
    extra[ROLL], extra[BOTH_K1] = np.radians(0.1), 0.001
    found = {}
    for sought in (False, True):
        setup = unchecked_setup(loss_px=0.01, max_error_px=20, self_calibration=sought)
        _, world, motions, _ = found_of(setup, extra)
        found[sought] = off_by(world, motions)[:6], np.abs(world.extra - extra)[[ROLL, BOTH_K1]]
    assert found[False][0].max() > 1.5, "m/s, where the pair is held"
    # The lens is undone after the motion, as if it bent that way alike: 0.02 px of 0.1 % of distortion.
    off, wrong = found[True]
    assert off[:3].max() < 0.02 and off[3:].max() < 0.1 and wrong.max() < 5e-5


def test_a_key_frame_that_sees_nothing_of_the_others_moves_as_foretold() -> None:
    setup = unchecked_setup()
    _, world, _, _ = found_of(setup, np.zeros(PAIR))
    first, second, *rest = world.keys
    blind = second.only(np.zeros(200, bool))
    found = with_motions(setup, replace(world, keys=(first, blind, *rest)))
    np.testing.assert_allclose(found.keys[1].left_from_world.matrix, second.left_from_world.matrix, atol=1e-9)
    assert np.isfinite(found.xyz).all() and np.isfinite(found.keys[1].motion).all()


def miscalibrated(perfect: Array, extra: Array) -> Array:
    """(N, 3) what a pair with the errors `extra` sees, where a perfect one sees `perfect` (N, 3)."""
    out = perfect.copy()
    out[:, :2] *= 1 + extra[BOTH_K1] * (perfect[:, :2] ** 2).sum(axis=1)[:, None]
    out[:, 2] += by_column(perfect[:, [2, 1]], perfect[:, 0] - perfect[:, 2]) @ extra[:COLUMNS]
    return out


def test_the_less_a_way_is_shaken_the_surer_are_motions_foretold() -> None:
    """By poses 0.1 s apart on a straight line, of which the middle ones deviate."""

    def sigma(deviation_m: float) -> Array:
        offsets = deviation_m * np.array([0, 1, -1, 1, -1, 1, -1, 0])
        poses = [Pose.from_rotvec(np.zeros(3), np.array([x, 0, -0.15 * c])) for c, x in enumerate(offsets)]
        none = np.zeros(0, np.int64)
        keys = [
            KeyFrame(c * 100_000_000, p, none, np.zeros((0, 3)), np.zeros(12), np.zeros((0, 2)))
            for c, p in enumerate(poses)
        ]
        return motion_priors(tuple(keys), BASELINE_M)[3].sigma

    smooth, rough = sigma(0.0), sigma(0.05)
    assert rough[0] > 2 * smooth[0] > 0 and smooth[3] == rough[3]
    np.testing.assert_allclose(rough[6:] / rough[:6], smooth[6:] / smooth[:6])
