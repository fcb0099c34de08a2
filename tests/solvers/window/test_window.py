"""The windowed solver: derivatives, exact data, calibration found, and a prior that stands for what has left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import so3_exp
from ispom.solvers.window import adjustment as solver
from ispom.solvers.window.adjustment import Equations, Window, adjust, covariance, marginalise, total_cost
from ispom.solvers.window.prior import anchored
from tests.solvers.window.left import without_oldest

FOCAL, BASELINE, POSES, POINTS = 700.0, 0.5, 6, 150
SCALE = 0.5 / FOCAL
SIGMA = np.array([0.01, 0.01, 1 / FOCAL, 0.01, 4 / FOCAL, 4 / FOCAL])
"""Of both lenses, and of four corrections of the right camera, whatever they are."""
NONE = (0.0,) * 6


def truth(extra: tuple[float, ...] = NONE, noise_px: float = 0.0, stereo: bool = True) -> Window:
    """A drive along z past points at 10 to 50 m, each seen from four poses at most."""
    rng = np.random.default_rng(0)
    i = np.arange(float(POSES))
    rotations = so3_exp(np.stack([0 * i, 0.01 * i, 0.002 * i], axis=1))
    translations = np.stack([0.01 * i, 0.0 * i, -1.2 * i], axis=1)
    points = rng.uniform([-12, -3, 12], [12, 3, 50], (POINTS, 3))
    cameras, owners = np.meshgrid(np.arange(POSES), np.arange(POINTS))
    first = rng.integers(0, POSES - 2, POINTS)[:, None]
    kept = (cameras >= first) & (cameras < first + 4)
    cameras, owners = cameras[kept], owners[kept]
    p = np.einsum("kij,kj->ki", rotations[cameras], points[owners]) + translations[cameras]
    right = (p[:, 0] - BASELINE) / p[:, 2]
    rates = np.linspace(0, 0.3, POSES)[cameras]
    left = p[:, :2] / p[:, 2:]
    square, there = (left**2).sum(1), right**2 + left[:, 1] ** 2
    radial = np.column_stack([there * right, there**2 * right])
    factors = np.column_stack([radial, np.ones(len(p)), (1 + right**2) * rates, right**2, right**4])
    right = right + factors @ extra
    left = left * (1 + extra[0] * square + extra[1] * square**2)[:, None]
    seen = np.column_stack([left, right if stereo else np.full(len(p), np.nan)])
    seen += noise_px / FOCAL * rng.standard_normal(seen.shape)
    prior = anchored(rotations[0], translations[0], SIGMA)
    return Window(
        rotations, translations, points, cameras, owners, seen, BASELINE, np.zeros(6), SIGMA, factors, prior
    )  # fmt: skip


def disturbed(window: Window) -> Window:
    rng = np.random.default_rng(1)
    turn = so3_exp(np.vstack([np.zeros((1, 3)), rng.normal(0, 0.004, (POSES - 1, 3))]))
    moved = window.translations + np.vstack([np.zeros((1, 3)), rng.normal(0, 0.05, (POSES - 1, 3))])
    points = window.points + rng.normal(0, 0.2, window.points.shape)
    return replace(window, rotations=turn @ window.rotations, translations=moved, points=points)


def test_exact_data_gives_the_truth_back() -> None:
    window = truth()
    found = adjust(disturbed(window), SCALE, 30, 1e-12).window
    np.testing.assert_allclose(found.translations, window.translations, atol=1e-5)
    np.testing.assert_allclose(found.rotations, window.rotations, atol=1e-6)
    np.testing.assert_allclose(found.extra, 0, atol=1e-6)


def test_what_is_wrong_with_both_lenses_is_found() -> None:
    window = truth(extra=(0.004, -0.003, 0.0, 0.0, 0.0, 0.0))
    open_ = anchored(window.rotations[0], window.translations[0], 100 * SIGMA)
    window = replace(window, prior=open_, extra_sigma=100 * SIGMA)
    found = adjust(disturbed(window), SCALE, 60, 1e-13).window
    np.testing.assert_allclose(found.extra, (0.004, -0.003, 0, 0, 0, 0), atol=5e-5)
    np.testing.assert_allclose(found.translations, window.translations, atol=2e-3)


def test_what_is_wrong_with_the_right_camera_is_found() -> None:
    window = truth(extra=(0.0, 0.0, 0.3 / FOCAL, 0.004, -1.1 / FOCAL, 0.5 / FOCAL))
    found = adjust(disturbed(window), SCALE, 60, 1e-13).window
    np.testing.assert_allclose(found.extra[2:] * (FOCAL, 1e3, FOCAL, FOCAL), (0.3, 4.0, -1.1, 0.5), atol=0.05)
    np.testing.assert_allclose(found.translations, window.translations, atol=2e-3)


def test_held_calibration_stays_and_a_late_shutter_then_costs_scale() -> None:
    window = replace(truth(extra=(0.0, 0.0, 0.3 / FOCAL, 0.0, 0.0, 0.0)), extra_sigma=np.zeros(6))
    found = adjust(disturbed(window), SCALE, 30, 1e-12).window
    np.testing.assert_allclose(found.extra, 0, atol=1e-18)
    assert np.linalg.norm(found.translations[-1] - window.translations[-1]) > 0.02


def test_one_camera_alone_with_two_poses_held() -> None:
    window = replace(truth(stereo=False), fixed=2, prior=None)
    start = disturbed(window)
    start.rotations[:2], start.translations[:2] = window.rotations[:2], window.translations[:2]
    found = adjust(start, SCALE, 40, 1e-12).window
    np.testing.assert_allclose(found.translations, window.translations, atol=1e-4)
    assert np.array_equal(found.rotations[:2], window.rotations[:2])


def test_the_gradient_is_that_of_the_cost() -> None:
    window = replace(disturbed(truth(extra=(0.006, -0.004, 0.5 / FOCAL, 0.003, 0.4 / FOCAL, -0.3 / FOCAL))), prior=None)
    size = 6 * POSES + 6
    gradient = -Equations.of(window, SCALE, damping=1e30).right  # this damping holds the points
    numeric = np.empty(size)
    for k in range(size):
        step = np.zeros(size)
        step[k] = 1e-7
        plus, minus = (
            total_cost(solver._moved(window, s[:-6].reshape(-1, 6), np.zeros((POINTS, 3)), s[-6:]), SCALE)
            for s in (step, -step)
        )
        numeric[k] = (plus - minus) / 2e-7
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-5 * np.abs(numeric).max())


def test_a_prior_stands_for_the_pose_and_points_that_have_left() -> None:
    whole = adjust(disturbed(truth(noise_px=0.1)), SCALE, 40, 1e-12).window
    gone = np.isin(np.arange(POINTS), whole.owners[whole.cameras == 0])
    prior = marginalise(whole, gone, SCALE)
    rest = without_oldest(whole, gone, prior)
    # at the optimum it is the optimum still, with the same spread
    again = adjust(rest, SCALE, 10, 1e-12).window
    np.testing.assert_allclose(again.translations, rest.translations, atol=1e-6)
    np.testing.assert_allclose(covariance(rest, SCALE), covariance(whole, SCALE)[6:, 6:], rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("noise_px", [0.1, 0.4])
def test_errors_are_as_large_as_the_covariance_says(noise_px: float) -> None:
    exact, noisy = truth(), truth(noise_px=noise_px)
    scale = noise_px / FOCAL
    # a loss much wider than the noise: least squares
    found = adjust(noisy, 20 * scale, 30, 1e-12).window
    spread = covariance(found, 20 * scale)[6:-6, 6:-6] / 400
    rotation_error = np.einsum("nij,nkj->nik", found.rotations, exact.rotations)
    phi = np.stack([rotation_error[:, 2, 1], rotation_error[:, 0, 2], rotation_error[:, 1, 0]], axis=1)
    rho = found.translations - np.einsum("nij,nj->ni", rotation_error, exact.translations)
    error = np.hstack([rho, phi])[1:].ravel()
    assert 10 < error @ np.linalg.solve(spread, error) < 55  # chi-square with 30 degrees of freedom: 99.8 %


def test_one_layout_of_arrays_is_compiled() -> None:
    """Seen on KITTI: a map's first adjustment waited for what the warm-up had compiled for another layout."""
    window = truth()
    turned = np.stack([r.T.copy().T for r in window.rotations])
    assert replace(window, rotations=turned).rotations.flags.c_contiguous
    assert replace(window, rotations=np.asfortranarray(turned)).rotations.flags.c_contiguous
