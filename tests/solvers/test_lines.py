"""Geometry of lines on exact lines of a room, then with noise and wrong matches."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array, Pose, rotation_angle_rad
from ispom.solvers.lines import (
    KnownDirections,
    KnownLines,
    Observed,
    depths_on_lines,
    end_offsets,
    nearest_on_lines,
    offsets_from_direction,
    refined_pose,
    rotation_from_directions,
    sampled_pose,
    squared,
    vanishing_directions,
)

POSE = Pose.from_rotvec(np.array([0.05, -0.2, 0.1]), np.array([0.3, -0.1, 0.4]))
"""camera_from_world."""
PX = 1 / 500


def room(count: int = 90) -> tuple[Array, Array]:
    """Returns lines (N, 2, 3) along the three axes of the world before the camera, and their directions (N, 3)."""
    rng = np.random.default_rng(3)
    start = rng.uniform((-2, -1.5, 4), (2, 1.5, 8), (count, 3))
    direction = np.eye(3)[np.arange(count) % 3]
    return np.stack([start, start + rng.uniform(0.3, 1.2, (count, 1)) * direction], axis=1), direction


def observed(xyz: Array, noise: float = 0.0) -> Observed:
    q = POSE.apply(xyz)
    return Observed(q[..., :2] / q[..., 2:] + np.random.default_rng(1).normal(0, noise, (len(xyz), 2, 2)))


def degrees(a: Array, b: Array) -> float:
    return float(np.degrees(rotation_angle_rad(a @ b.T)))


def test_ends_lie_on_their_lines_under_the_true_pose_and_behind_the_camera_nowhere() -> None:
    xyz, _ = room()
    lines = observed(xyz).lines
    offset = end_offsets(POSE.rotation[None], POSE.translation[None], lines, xyz)
    assert np.abs(offset).max() < 1e-12
    assert np.isinf(end_offsets(POSE.rotation[None], POSE.translation[None] - (0, 0, 20), lines, xyz)).all()


def test_a_shifted_segment_is_off_by_the_shift() -> None:
    xyz, _ = room(1)
    seen = observed(xyz)
    across = seen.lines[0, :2]
    moved = Observed(seen.x + 0.01 * across)
    offset = end_offsets(POSE.rotation[None], POSE.translation[None], moved.lines, xyz)
    np.testing.assert_allclose(np.abs(offset), 0.01, atol=1e-9)


def test_vanishing_directions_are_the_axes() -> None:
    xyz, direction = room()
    found, group = vanishing_directions(observed(xyz), PX)
    assert len(found) == 3 and (group >= 0).mean() > 0.9
    axes = found @ POSE.rotation
    for n, axis in enumerate(axes):
        assert np.abs(axis).max() > np.cos(1e-3)
        # Some lines point to the vanishing point of another direction by chance.
        assert (np.abs(direction[group == n] @ axis) > 0.99).mean() > 0.8
    assert not len(vanishing_directions(observed(xyz[:4]), PX)[0])


def test_offsets_are_those_of_the_ends_from_a_line_through_the_middle() -> None:
    seen = Observed(np.array([[[-0.1, 0.02], [0.1, -0.02]]]))
    along_x, along_z = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    assert offsets_from_direction(seen, along_x)[0, 0] == pytest.approx(0.02)
    assert offsets_from_direction(seen, along_z)[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_two_directions_give_the_rotation_and_one_what_it_can() -> None:
    known = np.eye(3)
    seen = np.array([[1, 1, -1]]).T * (known @ POSE.rotation.T)
    predicted = Pose.from_rotvec(np.array([0.08, -0.1, -0.05]), np.zeros(3)).rotation @ POSE.rotation
    for some in ([0, 1], [2, 1], [0, 1, 2]):
        rotation, same = rotation_from_directions(seen[some], known, predicted, np.radians(12))
        assert same.tolist() == some
        assert degrees(rotation, POSE.rotation) < 0.02
    one, _ = rotation_from_directions(seen[:1], known, predicted, np.radians(12))
    assert abs(one[:, 0] @ seen[0]) > np.cos(1e-3)
    assert degrees(one, predicted) < degrees(POSE.rotation, predicted) + 1e-6
    none, same = rotation_from_directions(seen, known, predicted, np.radians(1))
    assert (same < 0).all() and (none == predicted).all()


def test_the_pose_from_exact_lines_is_exact_despite_wrong_matches() -> None:
    xyz, direction = room()
    seen = observed(xyz)
    wrong = np.arange(len(xyz)) % 3 == 0
    x = seen.x.copy()
    x[wrong] = np.roll(x[wrong], 5, axis=0)
    known = KnownLines(Observed(x), xyz, np.full((len(xyz), 2), PX))
    guess = Pose.from_rotvec(np.array([0.03, 0.02, -0.04]), np.array([0.1, 0.1, -0.2])) @ POSE
    sampled = sampled_pose(known, [guess], 4.0)
    towards = KnownDirections(seen, direction, np.full(len(xyz), PX))
    found, information = refined_pose(known, towards, sampled, 0.01)
    assert np.linalg.norm((found @ POSE.inverse()).log()) < 1e-4
    assert np.linalg.eigvalsh(information)[0] > 0
    again = sampled_pose(known, [guess], 4.0)
    assert (again.rotation == sampled.rotation).all() and (again.translation == sampled.translation).all()


def test_the_pose_from_noisy_lines_is_as_exact_as_they_are() -> None:
    xyz, direction = room()
    seen = observed(xyz, 0.5 * PX)
    known = KnownLines(seen, xyz, np.full((len(xyz), 2), 0.5 * PX))
    start = Pose.from_rotvec(np.array([0.02, 0, 0]), np.zeros(3)) @ POSE
    alone, _ = refined_pose(known, None, start, 2.0)
    both, _ = refined_pose(known, KnownDirections(seen, direction, np.full(len(xyz), PX)), start, 2.0)
    for pose in (alone, both):
        assert degrees(pose.rotation, POSE.rotation) < 0.1
        assert np.linalg.norm(pose.inverse().translation - POSE.inverse().translation) < 0.01


def test_depths_along_a_ray_are_those_of_the_line() -> None:
    xyz, _ = room()
    q = POSE.apply(xyz)
    middle = 0.75 * q[:, 0] + 0.25 * q[:, 1]
    points = np.stack([middle, q[:, 1]], axis=1)
    x = points[..., :2] / points[..., 2:]
    depth = depths_on_lines(x.reshape(-1, 2), q)
    sideways = np.arange(len(xyz)) % 3 != 2  # those along the view have rays nearly along them
    np.testing.assert_allclose(depth[sideways], points[sideways][..., 2], rtol=1e-6)
    beside = points + 0.01 * np.array([0.3, 1.0, 0.2])
    nearest = nearest_on_lines((beside[..., :2] / beside[..., 2:]).reshape(-1, 2), q)[sideways]
    along = (q[:, 1] - q[:, 0])[sideways, None]
    assert np.linalg.norm(np.cross(nearest - q[sideways, :1], along), axis=2).max() < 1e-9
    assert np.linalg.norm(nearest - points[sideways], axis=2).max() < 0.05


def test_nearly_right_angles_become_right_and_others_stay() -> None:
    tilted = np.array([[1.0, 0, 0], [np.sin(0.02), np.cos(0.02), 0], [0.0, np.sin(0.5), np.cos(0.5)]])
    out = squared(tilted, np.radians(3))
    assert out[0] @ out[1] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(out[2], tilted[2])
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1)
