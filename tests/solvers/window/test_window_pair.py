"""What is wrong with a pair, found in a window from columns and rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.geometry import Array, so3_exp
from ispom.solvers.right_camera import PAIR, TERMS, by_column, by_row, drift, row_evidence
from ispom.solvers.window.adjustment import MAX_DEPTH_GROWTH, Adjusted, Window, adjust, as_inverse_depths, covariance
from ispom.solvers.window.prior import anchored
from tests.solvers.pairs import BASELINE, SIGMA, F, seen, seen_left

POSES, POINTS, SCALE = 6, 300, 0.17 / F
BEND = np.array([0.4, 0.0, -14.0, 0.3, -0.4, 0.2])
"""The motion: ahead, in a bend, swaying."""


def found(extra: Array, noise_px: float, motion: Array = BEND, nearest: float = 6.0, seed: int = 0) -> Adjusted:
    """A tenth of a second between poses; all points are seen by all of them."""
    rng, k = np.random.default_rng(seed), np.arange(POSES)
    turn = so3_exp(0.1 * k[:, None] * motion[3:] * np.where(k % 2, 1.0, -0.5)[:, None])
    shift = 0.1 * k[:, None] * motion[:3]
    depth = 1 / rng.uniform(0.1 / nearest, 1 / nearest, POINTS) + 0.1 * POSES * abs(motion[2])
    xyz = np.column_stack([rng.uniform(-0.35, 0.35, POINTS), rng.uniform(-0.2, 0.2, POINTS), np.ones(POINTS)])
    xyz *= depth[:, None]
    camera, owner = np.tile(k, POINTS), np.repeat(np.arange(POINTS), POSES)
    q = np.einsum("kij,kj->ki", turn[camera], xyz[owner]) + shift[camera]
    rates = motion * np.linspace(0.5, 1.5, POSES)[camera][:, None]
    right = np.concatenate([seen(q[n : n + 1], extra, rates[n]) for n in range(len(q))])
    right = right + noise_px / F * rng.standard_normal(right.shape)
    left = seen_left(q, extra) + noise_px / F * rng.standard_normal((len(q), 2))
    prior, disparity = anchored(turn[0], shift[0], SIGMA), left[:, 0] - right[:, 0]
    late = drift(q, rates, 0.0, BASELINE)
    for c in k:
        own = camera == c
        rows = by_row(right[own], disparity[own], late[own]), right[own, 1] - left[own, 1]
        evidence = row_evidence(owner[own], *rows, np.zeros(PAIR), np.diag(SIGMA**2), SCALE)
        prior = prior.with_evidence(evidence)
    off = so3_exp(np.vstack([np.zeros(3), rng.normal(0, 0.002, (POSES - 1, 3))]))
    window = Window(
        off @ turn, shift, xyz * rng.normal(1, 0.01, (POINTS, 1)), camera, owner, np.column_stack([left, right[:, 0]]),
        BASELINE, np.zeros(PAIR), SIGMA, by_column(right, disparity, late), prior,
    )  # fmt: skip
    return adjust(window, SCALE, 60, 1e-14)


@pytest.mark.parametrize("term", range(PAIR), ids=TERMS)
def test_each_error_is_found_exactly(term: int) -> None:
    """To 2 % of it: what is left is of second order."""
    extra = np.zeros(PAIR)
    extra[term] = 0.2 * SIGMA[term]
    window = found(extra, 0.0).window
    np.testing.assert_allclose(window.extra / SIGMA, extra / SIGMA, atol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_with_noise_errors_are_as_large_as_the_covariance_says(seed: int) -> None:
    extra = 0.1 * np.random.default_rng(seed).normal(0, SIGMA)
    window = found(extra, 0.15, seed=seed).window
    spread = covariance(window, SCALE)[-PAIR:, -PAIR:]
    error = window.extra - extra
    assert np.sqrt(error @ np.linalg.solve(spread, error) / PAIR) < 2
    assert (np.sqrt(np.diag(spread)) < 0.7 * SIGMA).sum() > 10


@pytest.mark.parametrize(
    ("motion", "nearest", "hidden"),
    [
        (np.zeros(6), 1000.0, ("offset_x", "down", "ahead", "lag")),
        (np.array([0, 0, -14.0, 0, 0, 0]), 1e5, ("down", "ahead")),
        (np.zeros(6), 6.0, ("offset_x", "lag")),
    ],
    ids=["far and still", "ahead and far", "still"],
)
def test_what_the_data_do_not_show_stays_as_uncertain_as_it_was(
    motion: Array, nearest: float, hidden: tuple[str, ...]
) -> None:
    window = found(np.zeros(PAIR), 0.0, motion, nearest).window
    spread = np.sqrt(np.diag(covariance(window, SCALE)))[-PAIR:] / SIGMA
    told = dict(zip(TERMS, spread, strict=True))
    assert min(told[name] for name in hidden) > 0.9, told


def test_a_pair_that_is_off_by_much_is_found_in_a_few_steps() -> None:
    """Points begin where disparities that are half a pixel off put them: those far away at many times their depth."""
    rng, extra = np.random.default_rng(4), np.zeros(PAIR)
    off = {"offset_x": 0.0018, "offset_y": -0.001, "pitch": 0.005, "roll": -0.003, "p1": 0.003, "k2": -0.009}
    extra[[TERMS.index(term) for term in off]] = list(off.values())
    turn, shift = so3_exp(np.array([[0.0, 0, 0], [0.01, -0.02, 0.01]])), np.array([[0.0, 0, 0], [0.1, 0.05, -0.6]])
    depth = 1 / rng.uniform(1 / 5000, 1 / 10, POINTS)
    xyz = np.column_stack([rng.uniform(-0.5, 0.5, POINTS), rng.uniform(-0.4, 0.4, POINTS), np.ones(POINTS)])
    xyz *= depth[:, None]
    camera, owner = np.tile([0, 1], POINTS), np.repeat(np.arange(POINTS), 2)
    q = np.einsum("kij,kj->ki", turn[camera], xyz[owner]) + shift[camera]
    left = seen_left(q, extra) + 0.1 / F * rng.standard_normal((len(q), 2))
    right = seen(q, extra, np.zeros(6)) + 0.1 / F * rng.standard_normal((len(q), 2))
    disparity, still = left[:, 0] - right[:, 0], np.zeros((len(q), 2))
    first = camera == 0
    start = (
        np.column_stack([left[first], np.ones(POINTS)]) * (BASELINE / np.maximum(disparity[first], 1 / 2000))[:, None]
    )
    prior = anchored(turn[0], shift[0], SIGMA)
    for c in (0, 1):
        own = camera == c
        rows = by_row(right[own], disparity[own], still[own]), right[own, 1] - left[own, 1]
        prior = prior.with_evidence(row_evidence(owner[own], *rows, np.zeros(PAIR), np.diag(SIGMA**2), SCALE))
    window = Window(
        turn, shift, start, camera, owner, np.column_stack([left, right[:, 0]]), BASELINE, np.zeros(PAIR), SIGMA,
        by_column(right, disparity, still), prior,
    )  # fmt: skip
    few, best = adjust(window, SCALE, 10), adjust(replace(window, points=xyz, extra=extra), SCALE, 300, 1e-9)
    assert few.cost_after < 1.02 * best.cost_after < 0.05 * few.cost_before
    assert abs(few.window.extra - extra)[TERMS.index("offset_x")] < 0.05 / F


@given(depth=st.floats(0.1, 1e4), inverse=st.floats(-0.99, 50.0), aside=st.floats(-1.0, 1.0))
def test_a_step_changes_inverse_depths_as_it_does_to_first_order(depth: float, inverse: float, aside: float) -> None:
    """By a share `inverse` of what they are, and to ten times the depth at most, whatever it is."""
    point, step = depth * np.array([0.3, -0.2, 1.0]), depth * np.array([aside - 0.3 * inverse, 0.2 * inverse, -inverse])
    window = Window(
        np.eye(3)[None], np.zeros((1, 3)), point[None], np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros((1, 3))
    )
    moved = point + as_inverse_depths(window, step[None])[0]
    wanted = max(1 + inverse, 1 / MAX_DEPTH_GROWTH)
    assert moved[2] == pytest.approx(depth / wanted, rel=1e-9)
    if 1 + inverse > 1 / MAX_DEPTH_GROWTH:
        np.testing.assert_allclose(moved[:2] / moved[2], [0.3 + aside, -0.2], atol=1e-6)
    beyond = point + as_inverse_depths(window, 1e3 * depth * np.array([[0.0, 0.0, 1.0]]))[0]
    assert beyond[2] == pytest.approx(MAX_DEPTH_GROWTH * depth)
