"""What points of unknown depth say of a pose, on synthesised truth."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.solvers.epipolar import Rays
from ispom.solvers.localisation import fit_pose

SCALE = 0.5 / 300
FIRST = Pose.from_rotvec(np.array([0.03, 0.2, -0.02]), np.array([2.0, 0.1, -0.3]))
"""world_from_first."""
SECOND = Pose.from_rotvec(np.array([0.02, -0.15, 0.01]), np.array([-0.1, -0.05, -2.1])) @ FIRST.inverse()
"""camera_from_world."""
NEAREST = 4.0


def rays(depths: np.ndarray, second: Pose = SECOND, seed: int = 0) -> Rays:
    """Of points at these depths (M,) in the first camera."""
    first = np.random.default_rng(seed).uniform([-0.6, -0.4], [0.6, 0.4], (len(depths), 2))
    xyz = FIRST.apply(np.column_stack([first, np.ones(len(first))]) * depths[:, None])
    there = second.apply(xyz)
    return Rays.of(FIRST, first, NEAREST, there[:, :2] / there[:, 2:])


def off(found: Pose) -> float:
    return float(np.abs((found @ SECOND.inverse()).log()).max())


@pytest.mark.parametrize("depth", [6.0, 30.0, 1e5])
def test_what_is_seen_of_a_still_point_is_on_its_line(depth: float) -> None:
    errors, _ = rays(np.full(40, depth)).errors(SECOND)
    assert np.abs(errors).max() < 1e-9


def test_what_cannot_be_so_near_or_behind_infinity_is_off_by_all_its_way() -> None:
    near, _ = rays(np.full(20, 0.5 * NEAREST)).errors(SECOND)
    assert np.linalg.norm(near, axis=1).min() > 5 * SCALE
    made = rays(np.full(20, 20.0))
    errors, by_twist = made.errors(Pose(SECOND.rotation, -SECOND.translation))
    assert np.median(np.linalg.norm(errors, axis=1)) > 5 * SCALE
    far = np.abs(by_twist[:, :, :3]).max(axis=(1, 2)) < 1e-5
    assert far.mean() > 0.5, "infinitely far, it only says how the camera turned"


def test_without_travel_all_of_an_error_says_how_the_camera_turned() -> None:
    here = FIRST.inverse()
    errors, by_twist = rays(np.full(30, 20.0), here).errors(Pose.exp(np.r_[0, 0, 0, 1e-4, 0, 0]) @ here)
    assert np.linalg.norm(errors, axis=1).min() > 0.9e-4 and np.isfinite(by_twist).all()


def test_derivatives_are_those_of_the_errors() -> None:
    """To first order in the errors: across its line, and of the line's own turning no part."""
    made, step = rays(np.random.default_rng(1).uniform(6, 60, 50)), 1e-6
    _, by_twist = made.errors(SECOND)
    for i in range(6):
        ways = (Pose.exp(sign * step * np.eye(6)[i]) @ SECOND for sign in (1, -1))
        ahead, behind = (made.errors(pose)[0] for pose in ways)
        np.testing.assert_allclose((ahead - behind) / (2 * step), by_twist[:, :, i], atol=1e-4)


def corner(count: int, error: float, seed: int) -> tuple[np.ndarray, np.ndarray, Rays]:
    """Points close together at the image's edge, where they are seen, and rays all over it; both noisy."""
    rng = np.random.default_rng(seed)
    at = rng.uniform([-0.65, -0.1], [-0.5, 0.1], (count, 2))
    xyz = SECOND.inverse().apply(np.column_stack([at, np.ones(count)]) * rng.uniform(11, 12, (count, 1)))
    made = rays(rng.uniform(8, 60, 60), seed=seed)
    return xyz, at + error * rng.standard_normal(at.shape), Rays(
        made.directions, made.origin, made.nearest, made.seen + error * rng.standard_normal(made.seen.shape)
    )  # fmt: skip


def test_points_at_the_edge_leave_open_how_the_camera_turned_and_rays_tell() -> None:
    alone, both = [], []
    for seed in range(10):
        xyz, seen, made = corner(48, 0.3 * SCALE, seed)
        guess = Pose.exp(np.array([0.05, 0.02, 0.1, 0.002, 0.01, -0.003])) @ SECOND
        points = fit_pose(xyz, seen, guess, SCALE, 5 * SCALE)
        assert points is not None
        joint = fit_pose(xyz, seen, points.camera_from_world, SCALE, 5 * SCALE, widest=SCALE, rays=made)
        assert joint is not None and joint.inliers.mean() > 0.9
        alone.append(off(points.camera_from_world))
        both.append(off(joint.camera_from_world))
    assert np.median(both) < 0.3 * np.median(alone)


def test_rays_of_what_moves_lose_their_weight() -> None:
    xyz, seen, made = corner(48, 0.0, 0)
    moved = made.seen.copy()
    moved[::4] += 0.1
    joint = fit_pose(xyz, seen, SECOND, SCALE, 5 * SCALE, rays=Rays(made.directions, made.origin, NEAREST, moved))
    assert joint is not None and off(joint.camera_from_world) < 2e-3
