"""How far a spline passes beside poses: what its knots cannot follow, not what the poses are off by."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.integrated.knots import VideoPoses, spline_error, spline_misfit
from ispom.geometry import so3_exp
from ispom.solvers.spline.fit import fitted, misfits

FRAME_S, SIGMA = 0.04, 1e-3


def located(swing_m: float, noise: float, seed: int = 0, count: int = 200) -> tuple[VideoPoses, VideoPoses]:
    """Poses of a rig that swings up and down, with noise and without it."""
    rng, times = np.random.default_rng(seed), FRAME_S * np.arange(count)
    along = np.column_stack([times, 0.1 * times**2, swing_m * np.sin(2 * np.pi * times / (5 * FRAME_S))])
    turned = np.column_stack([0.1 * np.sin(times), 0.2 * times, 0 * times])
    information = np.tile(np.eye(6) / SIGMA**2, (count, 1, 1))

    def of(noise: float) -> VideoPoses:
        off = noise * rng.normal(size=(count, 6))
        turns = np.stack([so3_exp(t) @ so3_exp(o) for t, o in zip(turned, off[:, 3:], strict=True)])
        return VideoPoses(times, turns, along + off[:, :3], np.ones(count, bool), information)

    return of(noise), of(0.0)


def error_of(poses: VideoPoses, frames: float) -> float:
    return spline_error(lambda f: spline_misfit(poses, f * FRAME_S), frames)


@pytest.mark.parametrize("noise", [0.5, 1.0])
def test_of_noise_alone_it_is_next_to_nothing(noise: float) -> None:
    errors = [error_of(located(0.0, noise * SIGMA, seed)[0], 2.0) for seed in range(8)]
    assert np.mean(errors) < 0.05 * noise**2


@pytest.mark.parametrize(("swing", "noise"), [(0.02, 0.3), (0.05, 1.0)])
def test_it_is_what_the_knots_cannot_follow(swing: float, noise: float) -> None:
    noisy, exact = located(swing, noise * SIGMA)
    spline = fitted(exact.times_s, exact.rotations, exact.positions, 2 * FRAME_S)
    off = misfits(spline, exact.times_s, exact.rotations, exact.positions) / SIGMA
    true, told = (off**2).mean(), error_of(noisy, 2.0)
    assert true > 0.1
    assert told == pytest.approx(true, rel=0.4)


def test_with_knots_as_dense_as_frames_nothing_is_known() -> None:
    assert error_of(located(0.05, 0.0)[0], 1.0) == 0
