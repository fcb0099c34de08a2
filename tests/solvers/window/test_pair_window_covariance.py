"""Covariance of a pair's window against its errors, also across marginalisation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Window, adjust, marginalise
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import PendingScores, Sandwich, anchored
from tests.estimators.modern.test_noise import flown
from tests.nees import band
from tests.solvers.window.left import without_oldest

ERROR, SCALE, BASELINE = 1e-3, 5e-3, 0.3
KINDS = {
    "alike": {"new": ERROR, "step": 0.0, "disparity": ERROR},
    "walk": {"new": 0.0, "step": ERROR, "disparity": ERROR},
    "kept disparity": {"new": 0.3 * ERROR, "step": 0.0, "disparity": 0.3 * ERROR},
    "narrow loss": {"new": ERROR, "step": 0.0, "disparity": ERROR},
    "alike in a cell": {"new": ERROR, "step": 0.0, "disparity": 0.0},
}


def made(seed: int, kind: str = "alike") -> Window:
    """At its truth; the first pose is the world."""
    window = flown(seed, KINDS[kind], BASELINE, cell=0.06 if kind == "alike in a cell" else 0.0)
    if kind == "kept disparity":
        seen, rng = window.seen.copy(), np.random.default_rng(seed)
        seen[:, 2] += 2 * ERROR * rng.normal(size=len(window.points))[window.owners]
        window = replace(window, seen=seen)
    return replace(window, fixed=0, prior=anchored(window.rotations[0], window.translations[0], np.zeros(PAIR)))


def found(window: Window, scale: float = SCALE) -> WindowCovariance:
    return WindowCovariance.of(window, np.arange(len(window.points)), scale)


@pytest.mark.parametrize("kind", KINDS)
def test_the_covariance_is_that_of_the_errors(kind: str) -> None:
    """Of the newest pose: where errors are independent and of one size, where they walk, where those of disparities
    stay, where the loss is no wider than they are, and where neighbours share them."""
    nees, scale = [], 1.5 * ERROR if kind == "narrow loss" else SCALE
    for seed in range(24):
        true = made(seed, kind)
        done = adjust(true, scale, 30, 1e-8).window
        pose, was = (Pose(w.rotations[-1], w.translations[-1]) for w in (done, true))
        off = (pose @ was.inverse()).log()
        nees.append(off @ np.linalg.solve(found(done, scale).newest, off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("kind", ["alike", "kept disparity"])
def test_what_leaves_the_window_is_as_unsure_as_in_it(kind: str) -> None:
    """On the mean: in what left and in what stays, groups are others than in both together. Single windows differ by a
    tenth, and the mean of eight by a twenty-fifth."""
    shares = []
    for seed in range(24):
        whole = adjust(made(seed, kind), SCALE, 60, 1e-14).window
        gone = np.isin(np.arange(len(whole.points)), whole.owners[whole.cameras == 0])
        prior = marginalise(whole, gone, SCALE, partial(_leaving, found(whole).inverse, np.flatnonzero(gone)))
        rest = without_oldest(whole, gone, prior)
        before, after = found(whole).newest, found(rest).newest
        shares.append(np.trace(np.linalg.solve(before, after)) / 6)
    assert np.mean(shares) == pytest.approx(1, abs=0.1)


def _leaving(known: Array, ids: NDArray[np.int64], part: Window) -> Sandwich:
    return WindowCovariance.of(part, ids, SCALE).marginal(np.zeros(0, np.int64), known)


def test_what_a_track_said_is_squared_with_what_it_says_later() -> None:
    """Not each by itself: an error that stays counts once for all its views."""
    whole, ids = adjust(made(4), SCALE, 60, 1e-14).window, np.array([3, 10])
    assert whole.prior is not None and whole.prior.sandwich is not None
    said = found(whole)
    first = said.scores[ids][:, np.r_[0:6, -PAIR:0]]  # those that the prior is about
    for pending, share in ((PendingScores(ids, first), 2.0), (PendingScores(ids + 1000, first), 1.0)):
        sandwich = replace(whole.prior.sandwich, pending=pending)
        window = replace(whole, prior=replace(whole.prior, sandwich=sandwich))
        after = found(window)
        np.testing.assert_allclose(after.scores[ids][:, :6], share * first[:, :6])
        assert len(after.pending.ids) == (0 if share == 2 else 2)
        went_on = after.marginal(np.array([3, 1010]), said.inverse).pending
        assert went_on is not None and went_on.ids.tolist() == ([3] if share == 2 else [3, 1010])


def test_few_tracks_make_it_no_surer() -> None:
    """With hardly more groups than unknowns, they say next to nothing of how far all are off."""
    whole = made(5)
    few = np.arange(len(whole.points)) < 12
    keep = few[whole.owners]
    window = replace(
        whole,
        points=whole.points[few],
        cameras=whole.cameras[keep],
        owners=whole.owners[keep],
        seen=whole.seen[keep],
        factors=whole.factors[keep],
    )
    window = adjust(window, SCALE, 60, 1e-14).window
    few_tracks, many = found(window).newest, found(adjust(whole, SCALE, 60, 1e-14).window).newest
    assert np.isfinite(few_tracks).all() and (np.diag(few_tracks) > 10 * np.diag(many)).all()
