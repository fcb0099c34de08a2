"""The pose of one camera against held points, on synthesised truth."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.motion_only import adjust_motion

TRUTH = Pose.from_rotvec(np.array([0.02, -0.1, 0.05]), np.array([0.3, -0.2, 0.5]))


def scene(count: int = 80) -> tuple[np.ndarray, np.ndarray]:
    xyz = np.random.default_rng(0).uniform((-4, -2, 4), (4, 2, 14), (count, 3))
    p = TRUTH.apply(xyz)
    return xyz, p[:, :2] / p[:, 2:]


def error(found: Pose) -> float:
    return float(np.abs((found.inverse() @ TRUTH).log()).max())


def test_exact_points_give_the_exact_pose() -> None:
    xyz, x = scene()
    motion = adjust_motion(xyz, x, Pose(), 0.01, 30)
    assert motion is not None and error(motion.camera_from_world) < 1e-9
    assert motion.inliers.all() and motion.residuals.max() < 1e-9


def test_gross_errors_lose_their_weight() -> None:
    xyz, x = scene()
    x[::4] += 0.2
    near = Pose.from_rotvec(np.array([0.0, -0.08, 0.05]), np.array([0.25, -0.2, 0.4]))
    motion = adjust_motion(xyz, x, near, 0.002, 30)
    assert motion is not None and error(motion.camera_from_world) < 1e-3
    assert motion.inliers.tolist() == [i % 4 != 0 for i in range(len(x))]


def test_the_information_predicts_the_scatter() -> None:
    """Errors of many noisy runs, weighed with the normal equations: 6 degrees of freedom."""
    xyz, x = scene()
    rng, sigma, nees = np.random.default_rng(1), 1e-4, []
    for _ in range(60):
        motion = adjust_motion(xyz, x + rng.normal(0, sigma, x.shape), TRUTH, 20 * sigma)
        assert motion is not None
        twist = (motion.camera_from_world @ TRUTH.inverse()).log()
        nees.append(twist @ motion.information @ twist / sigma**2)
    assert 4.5 < np.mean(nees) < 7.5


def test_too_few_points_are_no_pose() -> None:
    xyz, x = scene(5)
    assert adjust_motion(xyz, x, TRUTH, 0.01) is None
