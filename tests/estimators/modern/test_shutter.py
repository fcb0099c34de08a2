"""A pair with a rolling shutter: what it saw is put where the middle row's exposure would have seen it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.stereo.rates import with_rates
from ispom.estimators.modern.stereo.shutter import RateBelief, Rows, Shutter
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap
from ispom.geometry import Array, Pose
from ispom.solvers.motion_only import fit_pose
from ispom.types import Camera

CAMERA = Camera(1280, 960, 920.0, 920.0, 639.5, 470.0, line_delay_s=0.03 / 959)
BASELINE_M, SIGMA = 0.4, 0.17 / 920
RATE = np.array([0.4, -0.3, -2.0, 0.5, -0.4, 0.3])
"""left_from_world's change: 2 m/s, 40 degrees/s."""
POSE = Pose.from_rotvec(np.array([0.1, -0.2, 0.05]), np.array([0.5, 0.2, -1.0]))
SHUTTER = Shutter.of(CAMERA)


def scene() -> Array:
    """(N, 3) in the world."""
    rng = np.random.default_rng(0)
    near = np.column_stack([rng.uniform(-0.6, 0.6, 200), rng.uniform(-0.45, 0.45, 200), np.ones(200)])
    return POSE.inverse().apply(near * rng.uniform(3, 40, (200, 1)))


def seen(near: Array) -> Array:
    """(N, 3) by a pair, of points in its left camera."""
    return np.column_stack([near[:, :2], near[:, 0] - BASELINE_M]) / near[:, 2:]


def rolled(xyz: Array, pose: Pose = POSE, rate: Array = RATE) -> Array:
    """(N, 3) as rows that are exposed when they are saw points (N, 3) in the world."""
    found = seen(pose.apply(xyz))
    for _ in range(20):
        late_s = SHUTTER.late_s(found[:, 1])
        near = [Pose.exp(t * rate).apply(pose.apply(p[None]))[0] for t, p in zip(late_s, xyz, strict=True)]
        found = seen(np.stack(near))
    return found


def test_a_known_motion_is_undone() -> None:
    xyz = scene()
    late, middle = rolled(xyz), seen(POSE.apply(xyz))
    assert np.abs(late - middle).max() * CAMERA.fx > 10
    assert np.abs(SHUTTER.at_middle(late, RATE, BASELINE_M) - middle).max() * CAMERA.fx < 0.01


def test_points_go_there_and_back() -> None:
    near = POSE.apply(scene())
    there = SHUTTER.as_seen(near, RATE)
    np.testing.assert_allclose(seen(there), rolled(scene()), atol=0.5 / CAMERA.fx)
    np.testing.assert_allclose(SHUTTER.points_at_middle(there, RATE), near, atol=1e-3 * near[:, 2].max())


def test_without_a_disparity_turns_are_undone() -> None:
    alone = rolled(scene()) * (1, 1, np.nan)
    turning = SHUTTER.at_middle(alone, np.concatenate([np.zeros(3), RATE[3:]]), BASELINE_M)
    both = SHUTTER.at_middle(alone, RATE, BASELINE_M)
    np.testing.assert_array_equal(both[:, :2], turning[:, :2])
    assert np.isnan(both[:, 2]).all()


def test_a_global_shutter_changes_nothing() -> None:
    still = Shutter.of(replace(CAMERA, line_delay_s=0.0))
    observations = rolled(scene())
    assert still.at_middle(observations, RATE, BASELINE_M) is observations and not still.rolls


@pytest.mark.parametrize("noise_px", [0.0, 0.17])
def test_pose_and_rate_are_found_together(noise_px: float) -> None:
    xyz, rng = scene(), np.random.default_rng(1)
    late = rolled(xyz) + rng.normal(0, noise_px / CAMERA.fx, (len(xyz), 3))
    rows = Rows(SHUTTER, xyz, late, BASELINE_M, SIGMA)
    believed = RateBelief(np.zeros(6), np.array([10.0, 10.0, 10.0, 3.0, 3.0, 3.0]))
    rate, pose = believed.rate, Pose()
    for _ in range(4):
        middle = SHUTTER.at_middle(late, rate, BASELINE_M)
        fit = fit_pose(xyz, middle, pose, SIGMA, 20 / CAMERA.fx, BASELINE_M)
        assert fit is not None
        pose, given = fit.camera_from_world, fit.information
        rate, fit = rows.refined(believed, rate, fit)
    off = np.abs((pose @ POSE.inverse()).log())
    sigma = np.sqrt(np.linalg.inv(fit.information).diagonal())
    if noise_px:
        assert (off < 4 * sigma).all() and off[:3].max() < 0.005
    else:
        assert np.abs(rate - RATE).max() < 0.02 and off.max() < 2e-4
    assert (sigma > np.sqrt(np.linalg.inv(given).diagonal())).all(), "a pose is known less well with the rate unknown"


def test_motions_of_key_frames_are_found_together_with_the_map_that_they_bent() -> None:
    """Of a way along z with a shake; all begins at the mean motions."""
    rng, xyz, ids = np.random.default_rng(2), scene(), np.arange(200)
    places = [Pose.from_rotvec(0.02 * rng.standard_normal(3), np.array([0, 0, -0.5 * c])) @ POSE for c in range(5)]
    mean = np.array([0.0, 0, -1.5, 0, 0, 0])
    rates = [mean + 0.3 * rng.standard_normal(6) for _ in places]
    keys = tuple(
        KeyFrame(c * 333_000_000, pose, ids, rolled(xyz, pose, rate), mean, SHUTTER)
        for c, (pose, rate) in enumerate(zip(places, rates, strict=True))
    )
    bent = keys[0].at_middle(BASELINE_M)
    near = np.column_stack([bent[:, :2], np.ones(len(bent))]) * (BASELINE_M / (bent[:, 0] - bent[:, 2]))[:, None]
    start = StereoMap(keys, ids, places[0].inverse().apply(near))
    found = start
    for _ in range(4):
        found = with_rates(found, BASELINE_M, 1e-3 * SIGMA, 1.0)
    off, before = (np.abs([k.rate - r for k, r in zip(m.keys, rates, strict=True)]).max() for m in (found, start))
    assert before > 0.4 and off < 0.03
    distance, then = (np.linalg.norm(m.xyz - xyz, axis=1) / near[:, 2] for m in (found, start))
    assert np.median(distance) < 0.05 * np.median(then)
