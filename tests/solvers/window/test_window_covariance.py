"""Covariance of one camera's window: against finite differences, tracks that are left out, and errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.geometry import Array, Pose
from ispom.numerics.twist import moved
from ispom.solvers.localisation import fit_pose
from ispom.solvers.window.adjustment import Equations, Window, adjust, covariance, marginalise, total_cost
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich
from tests.estimators.modern.test_noise import VIEWS, flown
from tests.nees import band
from tests.solvers.window.left import without_oldest

SCALE, ERROR = 5e-3, 1e-3
HELD = 2
"""Poses that the prior holds."""


def made(seed: int, new: float = ERROR, step: float = 0.0) -> Window:
    """At its truth; the prior holds two poses, and nothing about it is unsure."""
    window = flown(seed, {"new": new, "step": step, "disparity": 0.0})
    size = POSE * HELD + LENS
    hold, none = np.diag(np.r_[np.full(POSE * HELD, 1e14), np.zeros(LENS)]), np.zeros(size)
    turns, ways = window.rotations[:HELD], window.translations[:HELD]
    prior = Prior(turns, ways, np.zeros(LENS), hold, none, sandwich=Sandwich(hold, np.zeros((size, size))))
    return replace(window, fixed=0, prior=prior)


def with_gross(window: Window) -> Window:
    seen = window.seen.copy()
    seen[::31] += 2 * SCALE
    return replace(window, seen=seen)


def found(window: Window, scale: float) -> WindowCovariance:
    return WindowCovariance.of(window, np.arange(len(window.points)), scale)


def without_jackknife(window: Window, scale: float) -> Sandwich:
    of = found(window, scale)
    return of.marginal(np.zeros(0, np.int64), np.zeros_like(of.curvature))


def covered(window: Window, scale: float) -> Array:
    """Covariance (D, D) by curvature and scatter, no track left out."""
    inverse = found(window, scale).inverse
    return inverse @ without_jackknife(window, scale).scatter @ inverse


def twists(window: Window, true: Window) -> Array:
    """(C, 6) how far its poses are off."""
    pairs = zip(window.rotations, window.translations, true.rotations, true.translations, strict=True)
    return np.stack([(Pose(r, t) @ Pose(q, s).inverse()).log() for r, t, q, s in pairs])


def test_curvature_and_scores_are_the_derivatives_of_the_cost_where_points_follow() -> None:
    window = replace(with_gross(made(0)), prior=None, fixed=VIEWS)
    window = adjust(window, SCALE, 200, 1e-15).window
    curved, way = found(window, SCALE), np.random.default_rng(1).normal(size=POSE * VIEWS) * 2e-5

    def cost(share: float) -> float:
        turns, ways = moved(window.rotations, window.translations, share * way.reshape(-1, POSE))
        placed = adjust(replace(window, rotations=turns, translations=ways), SCALE, 200, 1e-15).window
        return total_cost(placed, SCALE)

    lower, here, upper = cost(-1), cost(0), cost(1)
    direction = np.r_[way, np.zeros(LENS)]
    slope = curved.scores.sum(axis=0) @ direction
    assert slope == pytest.approx((upper - lower) / 2, rel=1e-3)
    bent = direction @ curved.curvature @ direction
    assert bent == pytest.approx(upper + lower - 2 * here, rel=0.02)
    held = Equations.of(window, SCALE).symmetric
    assert direction @ held @ direction > 1.05 * bent, "with weights held it would be more"


def test_without_errors_it_is_that_of_the_normal_equations() -> None:
    window = made(1, new=0.0)
    own, known = (c[:-LENS, :-LENS] for c in (found(window, SCALE).inverse, covariance(window, SCALE)))
    sigma = np.sqrt(np.diag(known))
    np.testing.assert_allclose(own / np.outer(sigma, sigma), known / np.outer(sigma, sigma), atol=1e-5)


def test_a_track_left_out_moves_poses_as_its_score_says() -> None:
    window = adjust(made(2), SCALE, 60, 1e-14).window
    curved = found(window, SCALE)
    says = curved.left_out @ curved.inverse
    longest = np.argsort(np.linalg.norm(says[:, -POSE - LENS : -LENS], axis=1))[-3:]
    for track in longest:
        kept = window.owners != track
        owners = window.owners[kept]
        rest = replace(
            window,
            points=np.delete(window.points, track, axis=0),
            cameras=window.cameras[kept],
            owners=owners - (owners > track),
            seen=window.seen[kept],
        )
        off = twists(adjust(rest, SCALE, 60, 1e-14).window, window)[-1]
        told = says[track, -POSE - LENS : -LENS]
        assert np.linalg.norm(off - told) < 0.15 * np.linalg.norm(off)


@pytest.mark.parametrize("kind", ["alike", "walk", "nearest worst", "narrow loss"])
def test_the_covariance_is_that_of_the_errors(kind: str) -> None:
    """Of the newest pose: where errors are independent and of one size, where they walk, where the points that say most
    have the largest, and where the loss is no wider than they are."""
    nees, scale = [], 1.5 * ERROR if kind == "narrow loss" else SCALE
    for seed in range(16):
        true = made(seed, *((0.0, ERROR) if kind == "walk" else (ERROR, 0.0)))
        if kind == "nearest worst":
            exact = made(seed, 0.0)
            worse = (8 / true.points[true.owners, 2:]) ** 2
            true = replace(true, seen=exact.seen + worse * (true.seen - exact.seen))
        done = adjust(true, scale, 30, 1e-8).window
        off, at = twists(done, true)[-1], slice(-POSE - LENS, -LENS)
        nees.append(off @ np.linalg.solve(found(done, scale).whole[at, at], off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("kind", ["alike", "walk"])
def test_the_covariance_of_a_frame_located_in_the_map_is_that_of_its_errors(kind: str) -> None:
    """Also where what is wrong with a track in the map's last view is wrong with it in the frame, too."""
    nees, newest = [], VIEWS - 1
    for seed in range(40):
        true = made(seed, *((0.0, ERROR) if kind == "walk" else (ERROR, 0.0)))
        lasting = np.isin(np.arange(len(true.points)), true.owners[true.cameras < newest])
        seen = (true.cameras == newest) & lasting[true.owners]
        window = without_newest(true, lasting)
        done = adjust(window, SCALE, 30, 1e-8).window
        ids = np.arange(len(done.points))
        owners = (np.cumsum(lasting) - 1)[true.owners[seen]]
        pose, xyz, x = Pose(true.rotations[-1], true.translations[-1]), done.points[owners], true.seen[seen, :2]
        motion = fit_pose(xyz, x, pose, 2 * SCALE, 4 * SCALE)
        assert motion is not None
        covariance = MapUncertainty.of(done, tuple(range(newest)), ids, SCALE).of_pose(
            owners, xyz, x, motion, 2 * SCALE
        )
        off = (pose @ motion.camera_from_world.inverse()).log()
        nees.append(off @ np.linalg.solve(covariance, off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high


def without_newest(whole: Window, lasting: NDArray[np.bool_]) -> Window:
    """Without the newest pose, and with the `lasting` (M,) points alone."""
    kept = (whole.cameras < len(whole.rotations) - 1) & lasting[whole.owners]
    return replace(
        whole,
        rotations=whole.rotations[:-1],
        translations=whole.translations[:-1],
        points=whole.points[lasting],
        cameras=whole.cameras[kept],
        owners=(np.cumsum(lasting) - 1)[whole.owners[kept]],
        seen=whole.seen[kept],
    )


@pytest.mark.parametrize(("scale", "gross"), [(100 * ERROR, False), (SCALE, True)])
def test_what_leaves_the_window_keeps_its_sandwich(scale: float, gross: bool) -> None:
    """Marginalised, poses are as sure as before, with larger errors in what left than in what stays: in a wide loss,
    and where some are beyond it."""
    whole, exact = made(3), made(3, 0.0)
    gone = np.isin(np.arange(len(whole.points)), whole.owners[whole.cameras == 0])
    seen = np.where(gone[whole.owners, None], exact.seen + 3 * (whole.seen - exact.seen), whole.seen)
    whole = replace(whole, seen=seen)
    whole = adjust(with_gross(whole) if gross else whole, scale, 60, 1e-14).window

    def of_part(part: Window) -> Sandwich:
        return without_jackknife(part, scale)

    prior = marginalise(whole, gone, scale, of_part)
    rest = without_oldest(whole, gone, prior)
    newest = slice(-POSE - LENS, -LENS)
    before, after = (covered(window, scale)[newest, newest] for window in (whole, rest))
    np.testing.assert_allclose(after, before, atol=0.02 * np.abs(before).max())
    if gross:
        assert prior.sandwich is not None
        stiff = replace(rest, prior=replace(prior, sandwich=Sandwich(prior.hessian, prior.sandwich.scatter)))
        assert np.trace(covered(stiff, scale)[newest, newest]) < 0.97 * np.trace(after), "with weights held"
