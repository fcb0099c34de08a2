"""What two views allow, on a plane and off it."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.two_view import hypotheses

TRUTH = Pose.from_rotvec(np.array([0.03, -0.12, 0.02]), np.array([0.6, 0.1, 0.2]))


def project(pose: Pose, xyz: Array) -> Array:
    p = pose.apply(xyz)
    return p[:, :2] / p[:, 2:]


def scene(planar: bool) -> Array:
    xyz = np.random.default_rng(0).uniform((-2, -1.5, 3), (2, 1.5, 7), (120, 3))
    if planar:
        xyz[:, 2] = 4 + 0.4 * xyz[:, 0] - 0.2 * xyz[:, 1]
    return xyz


def miss(found: Pose) -> float:
    """Largest of the angles between rotations and directions [rad]."""
    direction = TRUTH.translation / np.linalg.norm(TRUTH.translation)
    turned = np.linalg.norm(found.rotation.T @ TRUTH.rotation - np.eye(3))
    return max(float(turned), float(np.linalg.norm(found.translation - direction)))


@pytest.mark.parametrize("planar", [False, True])
def test_the_true_motion_is_among_them(planar: bool) -> None:
    xyz = scene(planar)
    noise = np.random.default_rng(1).normal(0, 2e-4, (2, len(xyz), 2))
    found = hypotheses(project(Pose(), xyz) + noise[0], project(TRUTH, xyz) + noise[1], 1e-3)
    assert min(miss(p) for p in found.second_from_first) < 0.05
    assert (found.planar_share > 0.7) == planar


def test_too_few_points_allow_nothing() -> None:
    x = project(Pose(), scene(False))[:7]
    assert hypotheses(x, x, 1e-3).second_from_first == ()
