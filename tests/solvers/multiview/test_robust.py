"""OpenCV's robust solvers at the units that they are used with: of planes and of depth, with noise and outliers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.solvers.localisation import PoseFit, resect, resect_optimised
from ispom.solvers.multiview.essential import relative_pose, sampson_distance
from ispom.solvers.multiview.two_view import hypotheses

PIXEL = 1 / 500
NOISE, THRESHOLD = 0.34 * PIXEL, 1.0 * PIXEL
TRUTH = Pose.from_rotvec(np.array([0.02, -0.03, 0.05]), np.array([0.3, 0.06, 0.04]))
SIZES = (50, 75, 150, 300, 500)
Solver = Callable[[Array, Array, float], PoseFit | None]


def two_views(count: int, planar: bool, outliers: float, seed: int) -> tuple[Array, Array, Array]:
    """Points (N, 3) in the first camera, and where both cameras see them; the first ones of the second are wrong."""
    rng = np.random.default_rng(seed)
    x1 = rng.uniform(-0.6, 0.6, (count, 2))
    depth = 2 / (1 + 0.3 * x1[:, 0] + 0.2 * x1[:, 1]) if planar else rng.uniform(1.5, 6, count)
    xyz = np.column_stack([x1, np.ones(count)]) * depth[:, None]
    q = TRUTH.apply(xyz)
    x2 = q[:, :2] / q[:, 2:] + rng.normal(0, NOISE, (count, 2))
    wrong = int(outliers * count)
    x2[:wrong] = rng.uniform(-0.6, 0.6, (wrong, 2))
    return xyz, x1 + rng.normal(0, NOISE, (count, 2)), x2


@pytest.mark.parametrize("count", SIZES)
def test_the_essential_matrix_keeps_the_inliers_of_a_deep_scene(count: int) -> None:
    for seed in range(5):
        _, x1, x2 = two_views(count, planar=False, outliers=0.2, seed=seed)
        found = relative_pose(x1, x2, THRESHOLD)
        true = np.abs(sampson_distance(TRUTH, x1, x2)) < THRESHOLD
        assert found is not None and (found.inliers & true).sum() >= 0.95 * true[count // 5 :].sum()


@pytest.mark.parametrize("count", SIZES)
def test_the_homography_keeps_the_inliers_of_a_plane(count: int) -> None:
    for seed in range(5):
        _, x1, x2 = two_views(count, planar=True, outliers=0.1, seed=seed)
        found = hypotheses(x1, x2, THRESHOLD)
        assert found.planar_share > 0.85
        poses = found.second_from_first[found.essential :]
        assert min(np.linalg.norm((p @ TRUTH.inverse()).rotvec) for p in poses) < 0.02


@pytest.mark.parametrize("solve", [resect, resect_optimised])
@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("outliers", [0.2, 0.7])
@pytest.mark.parametrize("count", SIZES)
def test_resection_keeps_the_inliers_of_a_scene(count: int, outliers: float, planar: bool, solve: Solver) -> None:
    for seed in range(5):
        xyz, _, x2 = two_views(count, planar, outliers, seed)
        found = solve(xyz, x2, 2 * THRESHOLD)
        assert found is not None and found.inliers.sum() >= 0.95 * (1 - outliers) * count
        assert np.linalg.norm((found.camera_from_world @ TRUTH.inverse()).rotvec) < 0.01


def test_a_pose_is_found_by_more_than_the_points_that_lie_close_together() -> None:
    """Of a house front seen aslant, half of it on one sign, with a percent of error in depth and wrong points."""
    worst = 0.0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        height = np.concatenate([rng.uniform(-1.2, -0.9, 45), rng.uniform(-4, 1.5, 25)])
        xyz = np.column_stack([np.full(70, 4.5), height, rng.uniform(8, 20, 70)])
        xyz[:45, 2] = rng.uniform(11, 13, 45)
        place, turn = np.array([-3.0, 0.0, 8.0]), Pose.from_rotvec(np.array([0.0, np.radians(-60), 0.0]), np.zeros(3))
        q = turn.apply(xyz - place)
        x = q[:, :2] / q[:, 2:] + rng.normal(0, PIXEL, (70, 2))
        known = xyz * (1 + 0.01 * rng.standard_normal((70, 1)) * xyz[:, 2:] / 12)
        xyz = np.concatenate([known, rng.uniform((-5, -4, 6), (5, 2, 25), (35, 3))])
        x = np.concatenate([x, rng.uniform((-0.7, -0.5), (0.7, 0.5), (35, 2))])
        found = resect_optimised(xyz, x, 5 * PIXEL)
        assert found is not None
        worst = max(worst, float(np.linalg.norm(found.camera_from_world.inverse().translation - place)))
    assert worst < 0.6, "of 9 m, where the other samples end 2 m off once"


@pytest.mark.parametrize("solve", [resect, resect_optimised])
def test_points_that_all_but_coincide_give_no_error(solve: Solver) -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        xyz, x = np.array([0, 0, 2.0]) + 1e-5 * rng.normal(size=(12, 3)), rng.uniform(-0.05, 0.05, (12, 2))
        for at in (xyz, np.broadcast_to(xyz[0], xyz.shape)):
            found = solve(at, x, 0.05)
            assert found is None or found.inliers.sum() >= 6
