"""Points from all their views, on synthesised truth."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import intersect

VIEWS = tuple(
    Pose.from_rotvec(np.array([0.01 * i, -0.02 * i, 0.0]), np.array([0.1 * i, 0.0, -0.4 * i])) for i in range(4)
)


def views() -> tuple[np.ndarray, np.ndarray]:
    return np.stack([p.rotation for p in VIEWS]), np.stack([p.translation for p in VIEWS])


def seen(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cameras, owners, coordinates, sorted by point."""
    x = np.stack([(p := v.apply(xyz))[:, :2] / p[:, 2:] for v in VIEWS], axis=1)
    n, c = len(xyz), len(VIEWS)
    return np.tile(np.arange(c), n), np.repeat(np.arange(n), c), x.reshape(-1, 2)


def test_exact_rays_meet_in_the_point() -> None:
    xyz = np.random.default_rng(0).uniform((-3, -2, 5), (3, 2, 20), (50, 3))
    found = intersect(*views(), *seen(xyz), len(xyz), Noise(1e-3))
    np.testing.assert_allclose(found.xyz_in_world, xyz, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.depth, VIEWS[0].apply(xyz)[:, 2])
    assert found.worst.max() < 1e-7


def test_far_points_have_no_significant_depth() -> None:
    cameras, owners, x = seen(np.array([[0.0, 0.0, 1e5], [1.0, 0.5, 6.0]]))
    found = intersect(*views(), cameras, owners, x, 2, Noise(1e-3))
    assert found.significance[0] < 1 < 20 < found.significance[1]
    assert found.parallax_rad[0] < 1e-4 < found.parallax_rad[1]


def test_a_wrong_match_shows_in_the_worst_residual() -> None:
    cameras, owners, x = seen(np.array([[1.0, 0.5, 6.0]]))
    x[-1] += (0.0, 0.05)
    assert intersect(*views(), cameras, owners, x, 1, Noise(1e-3)).worst[0] > 0.02


def test_what_moves_by_itself_is_not_taken_for_infinitely_far() -> None:
    far = np.array([[0.0, 0.0, 1e9]])
    cameras, owners, x = seen(far)
    assert intersect(*views(), cameras, owners, x, 1, Noise(1e-3)).worst[0] < 1e-6
    for shift in (-0.03, 0.03):
        moving = x + np.arange(len(x))[:, None] * (shift, 0.0)
        assert intersect(*views(), cameras, owners, moving, 1, Noise(1e-3)).worst[0] > 0.01
