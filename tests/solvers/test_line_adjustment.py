"""Lines in several views: displacements from exact lines, then poses and depths from disturbed starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array, Pose, rotation_angle_rad
from ispom.solvers.line_adjustment import LineViews, adjusted, displacements, line_residuals
from ispom.solvers.lines import KnownDirections, Observed
from tests.solvers import test_lines
from tests.solvers.test_lines import PX, degrees

POSES = tuple(
    Pose.from_rotvec(np.array([0.02 * k, -0.05 * k, 0.03 * k]), np.array([-0.15 * k, 0.05 * k * k, -0.2 * k]))
    for k in range(5)
)
"""camera_from_world; the first one is the world."""


def room() -> tuple[Array, Array]:
    """Returns those lines of the room, and their directions, that are not seen nearly end-on."""
    xyz, direction = test_lines.room()
    q = POSES[0].apply(xyz)
    x = q[..., :2] / q[..., 2:]
    some = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) > 20 * PX
    return xyz[some], direction[some]


def observed(pose: Pose, xyz: Array, noise: float = 0.0) -> Array:
    q = pose.apply(xyz)
    return q[..., :2] / q[..., 2:] + np.random.default_rng(1).normal(0, noise, (len(xyz), 2, 2))


def views_of(count: int = 5, noise: float = 0.0) -> LineViews:
    """Returns all lines of the room, first seen by the first view or every third one by the second, in all views."""
    xyz, _ = room()
    anchor = np.where(np.arange(len(xyz)) % 3 == 0, 1, 0)
    x = np.stack([observed(POSES[a], xyz[n : n + 1])[0] for n, a in enumerate(anchor)])
    rho = np.stack([1 / POSES[a].apply(xyz[n])[:, 2] for n, a in enumerate(anchor)])
    line, view = (i.ravel() for i in np.meshgrid(np.arange(len(xyz)), np.arange(count)))
    ends = np.stack([observed(pose, xyz, noise) for pose in POSES[:count]]).reshape(-1, 2, 2)
    other = view != anchor[line]
    return LineViews(POSES[:count], anchor, x, rho, line[other], view[other], ends[other])


NONE = KnownDirections(Observed(np.zeros((0, 2, 2))), np.zeros((0, 3)), np.zeros(0))


def test_displacements_of_three_views_are_exact_despite_wrong_lines() -> None:
    xyz, _ = room()
    normals = np.stack([Observed(observed(pose, xyz)).normals @ pose.rotation for pose in POSES[:3]])
    normals[2, ::4] = np.roll(normals[2, ::4], 1, axis=0)
    found, fits = displacements(normals, 1e-3)
    expected = np.stack([pose.inverse().translation for pose in POSES[1:3]])
    expected /= np.linalg.norm(expected)
    np.testing.assert_allclose(found * np.sign((found * expected).sum()), expected, atol=1e-4)
    assert fits[np.arange(len(xyz)) % 4 != 0].all()
    assert not displacements(normals[:, :4], 1e-3)[1].any()


def test_the_residuals_of_the_truth_are_zero_and_its_ends_are_in_the_world() -> None:
    views, (xyz, _) = views_of(), room()
    assert np.abs(line_residuals(views)).max() < 1e-12
    np.testing.assert_allclose(views.xyz, xyz, atol=1e-9)
    assert np.isnan(replace(views, rho=-views.rho).xyz).all()


@pytest.mark.parametrize("fixed", [1, 2])
def test_disturbed_poses_and_depths_are_adjusted_to_the_truth(fixed: int) -> None:
    truth, rng = views_of(), np.random.default_rng(2)
    moved = [Pose.exp(rng.normal(0, 0.01, 6)) @ pose for pose in truth.poses]
    start = replace(
        truth, poses=(*truth.poses[:fixed], *moved[fixed:]), rho=truth.rho * rng.uniform(0.9, 1.1, truth.rho.shape)
    )
    found = adjusted(start, [NONE] * 5, PX, 20.0, fixed)
    distances = [np.linalg.norm((v.poses[1] @ v.poses[0].inverse()).translation) for v in (start, found, truth)]
    assert distances[1] == pytest.approx(distances[0])
    factor = distances[2] / distances[1]
    for pose, true in zip(found.poses, truth.poses, strict=True):
        assert degrees(pose.rotation, true.rotation) < 1e-3
        np.testing.assert_allclose(factor * pose.translation, true.translation, atol=1e-4)


def test_known_directions_hold_the_rotation_of_noisy_views() -> None:
    truth, (xyz, direction) = views_of(noise=0.1 * PX), room()
    tilt = Pose.from_rotvec(np.array([0.0, 0.03, 0.0]), np.zeros(3))
    start = replace(truth, poses=(truth.poses[0], *(tilt @ pose for pose in truth.poses[1:])))
    known = [
        KnownDirections(Observed(observed(pose, xyz, 0.1 * PX)), direction, np.full(len(xyz), PX))
        for pose in truth.poses
    ]
    found = adjusted(adjusted(start, known, 0.1 * PX, 50.0, 1), known, 0.1 * PX, 2.0, 1)
    turned = [rotation_angle_rad(a.rotation @ b.rotation.T) for a, b in zip(found.poses, truth.poses, strict=True)]
    assert np.degrees(max(turned)) < 0.2
