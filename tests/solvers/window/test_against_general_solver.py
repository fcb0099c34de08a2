"""Own solvers against `scipy.optimize.least_squares`: the same minimum from the same start, exact data and noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array, Pose, so3_exp
from ispom.solvers.localisation import fit_pose
from ispom.solvers.window.adjustment import Window, adjust, marginalise, total_cost
from ispom.solvers.window.prior import anchored
from tests.solvers import oracle

FOCAL, BASELINE, POSES, POINTS = 700.0, 0.5, 3, 12
SCALE = 0.5 / FOCAL
PAIR_SIGMA = np.array([1 / FOCAL, 0.01, 4 / FOCAL, 4 / FOCAL])
"""Of four corrections, whatever they are: see `factors`."""
TRUTH = Pose.from_rotvec(np.array([0.02, -0.05, 0.01]), np.array([0.1, -0.05, -1.1]))
GUESS = Pose.exp(np.array([0.02, -0.01, 0.05, 0.002, 0.003, -0.002])) @ TRUTH


def drive(noise_px: float, baseline: float = BASELINE, extra: Array | None = None, gross: int = 0) -> Window:
    """A few poses along z, each of which sees every point; poses (but the first two) and points are disturbed."""
    rng, i = np.random.default_rng(5), np.arange(float(POSES))
    rotations = so3_exp(np.stack([0 * i, 0.02 * i, 0.004 * i], axis=1))
    translations = np.stack([0.02 * i, 0.01 * i, -1.2 * i], axis=1)
    points = rng.uniform([-8, -4, 10], [8, 4, 30], (POINTS, 3))
    cameras, owners = np.tile(np.arange(POSES), POINTS), np.repeat(np.arange(POINTS), POSES)
    none = np.zeros(4 if baseline else 2)
    q = np.einsum("kij,kj->ki", rotations[cameras], points[owners]) + translations[cameras]
    right, rates = (q[:, 0] - baseline) / q[:, 2], np.linspace(0, 0.3, POSES)[cameras]
    factors = np.column_stack([np.ones(len(q)), rates * (1 + right**2), right**2, right**4])
    window = Window(rotations, translations, points, cameras, owners, np.zeros((len(cameras), 3)), baseline,
                    none, np.zeros(len(none)), factors if baseline else np.zeros((0, 2)),
                    fixed=1 if baseline else 2)  # fmt: skip
    seen = oracle.image_errors(q, window, none)
    if extra is not None:  # the corrections are what is seen, against what an ideal camera would see
        wrong = oracle.image_errors(q, window, extra)
        seen = wrong if baseline else 2 * seen - wrong
    seen[:, 2] = seen[:, 2] if baseline else np.nan
    seen += noise_px / FOCAL * rng.standard_normal(seen.shape)
    seen[:gross] += 20 / FOCAL
    seen[5::7, 2] = np.nan
    turn, shift = rng.normal(0, 0.002, (POSES, 3)), rng.normal(0, 0.02, (POSES, 3))
    turn[:2], shift[:2] = 0.0, 0.0
    return replace(
        window,
        rotations=so3_exp(turn) @ rotations,
        translations=translations + shift,
        points=points + rng.normal(0, 0.1, points.shape),
        seen=seen,
    )


def assert_same_minimum(window: Window, atol: float = 2e-5) -> None:
    """Poses to 20 micrometres and 20 microradians; the costs to one part in a million."""
    found = adjust(window, SCALE, 200, 1e-15)
    wanted, cost = oracle.adjusted(window, SCALE)
    wanted = replace(wanted, rotations=np.ascontiguousarray(wanted.rotations))
    assert total_cost(found.window, SCALE) == pytest.approx(total_cost(wanted, SCALE), rel=1e-6, abs=1e-9)
    if window.prior is None:
        assert found.cost_after == pytest.approx(cost, rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(found.window.rotations, wanted.rotations, atol=atol)
    np.testing.assert_allclose(found.window.translations, wanted.translations, atol=atol)
    np.testing.assert_allclose(found.window.extra, wanted.extra, atol=atol)


def test_a_pair_with_exact_data() -> None:
    assert_same_minimum(drive(0.0))


def test_a_pair_with_noise_and_gross_errors() -> None:
    assert_same_minimum(drive(0.3, gross=3))


def test_a_pair_and_what_is_wrong_with_it() -> None:
    assert_same_minimum(replace(drive(0.2), extra_sigma=PAIR_SIGMA))


def test_one_camera_with_noise() -> None:
    assert_same_minimum(drive(0.3, baseline=0.0), atol=1e-4)


def test_one_camera_and_its_lens() -> None:
    window = drive(0.1, baseline=0.0, extra=np.array([0.01, -0.02]))
    assert_same_minimum(replace(window, extra_sigma=np.array([0.02, 0.05])), atol=2e-4)


def test_a_pair_with_the_prior_of_what_has_left() -> None:
    start = drive(0.3)
    start = replace(start, fixed=0, prior=anchored(start.rotations[0], start.translations[0], np.zeros(4)))
    whole = adjust(start, SCALE, 60, 1e-14).window
    gone = np.arange(POINTS) < 5
    prior, kept = marginalise(whole, gone, SCALE), ~gone[whole.owners] & (whole.cameras > 0)
    window = Window(start.rotations[1:], start.translations[1:], start.points[5:], whole.cameras[kept] - 1,
                    whole.owners[kept] - 5, whole.seen[kept], BASELINE, np.zeros(4), np.zeros(4),
                    whole.factors[kept], prior)  # fmt: skip
    assert_same_minimum(window)


def scene(images: int, noise_px: float) -> tuple[Array, Array]:
    """Points (N, 3), and where TRUTH sees them (N, images)."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform([-8, -3, 6], [8, 3, 40], (60, 3))
    q = TRUTH.apply(xyz)
    seen = np.column_stack([q[:, :2] / q[:, 2:], (q[:, 0] - BASELINE) / q[:, 2]])
    return xyz, (seen + noise_px / FOCAL * rng.standard_normal(seen.shape))[:, :images]


@pytest.mark.parametrize("images", [2, 3])
@pytest.mark.parametrize("noise_px", [0.0, 0.4])
def test_motion_only_adjustment(images: int, noise_px: float) -> None:
    xyz, seen = scene(images, noise_px)
    found = fit_pose(xyz, seen, GUESS, SCALE, 1.0, BASELINE)
    wanted, _ = oracle.located(xyz, seen, GUESS, SCALE, BASELINE)
    assert found is not None
    # It stops at steps of a hundredth of the loss's scale, which are so far at the points' distance of some 20.
    apart = np.abs((found.camera_from_world @ wanted.inverse()).log())
    assert apart[:3].max() < 0.01 * SCALE * 20 and apart[3:].max() < 0.01 * SCALE
