"""Scores of tracks and curvature of a window's cost, against finite differences in which the points follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array
from ispom.numerics.twist import moved
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Equations, Window, adjust, total_cost
from ispom.solvers.window.kernels import FIXED_WEIGHTS, OWN_CURVATURE
from ispom.solvers.window.prior import LENS, POSE
from ispom.solvers.window.scores import score_changes, track_scores
from tests.estimators.modern.test_noise import VIEWS, flown
from tests.solvers.window.test_window_pair import POSES, SCALE, found


def settled(kind: str) -> tuple[Window, float]:
    """With some gross errors, its points where they fit best, without prior; and the scale of its loss."""
    if kind == "pair":
        window, scale, count = found(np.zeros(PAIR), 0.1).window, SCALE, POSES
    else:
        window, scale, count = flown(0, {"new": 1e-3, "step": 0.0, "disparity": 0.0}), 4e-3, VIEWS
    seen = window.seen.copy()
    seen[::31] += 1.5 * scale
    window = replace(window, seen=seen, prior=None, extra_sigma=0 * window.extra_sigma, fixed=count)
    return adjust(window, scale, 200, 1e-15).window, scale


def direction(kind: str, window: Window) -> Array:
    """Of poses and of what the images show of corrections."""
    rng, poses = np.random.default_rng(1), POSE * len(window.rotations)
    way = np.concatenate([2e-6 * rng.normal(size=poses), np.zeros(len(window.extra))])
    way[poses : poses + (5 if kind == "pair" else LENS)] = 1e-5 * rng.normal(size=5 if kind == "pair" else LENS)
    return way


@pytest.mark.parametrize("kind", ["one camera", "pair"])
def test_scores_and_curvature_are_the_derivatives_of_the_cost_where_points_follow(kind: str) -> None:
    window, scale = settled(kind)
    poses, way = POSE * len(window.rotations), direction(kind, window)

    def cost(share: float) -> float:
        turns, ways = moved(window.rotations, window.translations, share * way[:poses].reshape(-1, POSE))
        there = replace(window, rotations=turns, translations=ways, extra=window.extra + share * way[poses:])
        return total_cost(adjust(there, scale, 200, 1e-15).window, scale)

    lower, here, upper = cost(-1), cost(0), cost(1)
    bent, held = (
        Equations.of(replace(window, extra_sigma=np.ones_like(window.extra)), scale, second_order=b)
        for b in (OWN_CURVATURE, FIXED_WEIGHTS)
    )
    slope = track_scores(window.observed, bent.eliminated, len(window.extra), scale).sum(axis=0) @ way
    assert slope == pytest.approx((upper - lower) / 2, rel=0.03)
    known = way[poses:] @ way[poses:]  # by the deviations of one, which keep corrections from being held
    curve = [way @ equations.symmetric @ way - known for equations in (bent, held)]
    assert curve[0] == pytest.approx(upper + lower - 2 * here, rel=0.03)
    assert curve[1] > 1.05 * curve[0], "with weights held it would be more"


@pytest.mark.parametrize("second_order", [FIXED_WEIGHTS, OWN_CURVATURE])
@pytest.mark.parametrize("kind", ["one camera", "pair"])
def test_scores_change_as_the_curvature_says(kind: str, second_order: float) -> None:
    window, scale = settled(kind)
    window = adjust(replace(window, seen=window.seen - 0.9 * _errors(window)), scale, 200, 1e-15).window
    equations = Equations.of(replace(window, extra_sigma=np.ones_like(window.extra)), scale, second_order=second_order)
    way, groups = direction(kind, window), np.arange(len(window.points)) % 3
    found = score_changes(window.observed, equations.eliminated, scale, second_order, groups, np.tile(way, (3, 1)))
    wanted = equations.symmetric @ way
    wanted[POSE * len(window.rotations) :] -= way[POSE * len(window.rotations) :]
    np.testing.assert_allclose(found.sum(axis=0), wanted, atol=1e-9 * np.abs(wanted).max())
    assert (np.abs(found).max(axis=1) > 0.1 * np.abs(wanted).max()).all(), "each group says its part"


def _errors(window: Window) -> Array:
    """(K, 3) of the images: small ones leave no point so flat that it is left out."""
    q = np.einsum("kij,kj->ki", window.rotations[window.cameras], window.points[window.owners])
    q += window.translations[window.cameras]
    right = (q[:, 0] - window.baseline) / q[:, 2]
    return window.observed.seen - np.column_stack([q[:, :2] / q[:, 2:], right])
