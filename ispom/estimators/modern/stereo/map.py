"""Extends the map by a keyframe: adds its observations, optimises the window, and triangulates the new points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.adjustment import optimised as optimisation_decisions
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.localise import LocalisedFrame
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, TrackingResult
from ispom.estimators.modern.stereo.rolling_window import (
    rolling_without_oldest,
    with_motions,
    with_rolling_covariance,
)
from ispom.estimators.modern.stereo.shutter import points_at_middle
from ispom.estimators.modern.stereo.state import ModernStereoState, StereoMap
from ispom.estimators.modern.stereo.window import optimised, without_oldest
from ispom.geometry import Array
from ispom.numerics.places import places
from ispom.numerics.reductions import median
from ispom.persistent_list import PersistentList
from ispom.solvers.right_camera import (
    BOTH,
    COLUMNS,
    LAG,
    LEAST_DISPARITY,
    PAIR,
    TERMS,
    by_column,
    by_row,
    drift,
    row_evidence,
    without_errors,
)
from ispom.solvers.window.adjustment import Adjusted
from ispom.types import Check, Decision

BEND_AT = 0.5
"""x/z (27 degrees towards the sides of the image) at which the bend of the disparity offset is reported."""
UNOBSERVABLE_SHARE = 0.7
"""A correction is not observable while its standard deviation exceeds this share of the prior's. The data then
contribute less information than the prior."""


def extend_map(
    setup: Setup, state: ModernStereoState, frame: LocalisedFrame, new: PairPoints, tracked: TrackingResult
) -> tuple[ModernStereoState, LocalisedFrame, tuple[Decision, ...]]:
    """Adds the frame as a keyframe and optimises the window; returns the state, the frame and the decisions.

    Points observed once take no part in the optimisation; the `new` ones are triangulated with its results.
    """
    points, predicted = PairPoints.joined(frame.points, new), None
    if not state.map.keys and state.last.left is not None:
        predicted = state.last.predicted_covariance(frame.images.time_ns, setup.baseline_m)
    world = state.map.with_key(setup, frame.as_key(setup, points), predicted)
    world = _with_rows(setup, world, state, frame, tracked)
    world, result = optimise(setup, with_motions(setup, world))
    count, settled = len(world.keys), state.settled
    world, settled, consequence = _marginalised(setup, world, settled)
    decisions = () if result is None else _decisions(setup, world.corrected(state.level), result, count, consequence)
    newest = world.keys[-1]
    near = triangulated(setup, world, new, newest.motion)
    world = world.with_points(new.ids, newest.left_from_world.inverse().apply(near))
    points = points.select(places(newest.ids, points.ids) >= 0)
    frame = replace(frame, left_from_world=newest.left_from_world, points=points)
    state = replace(state, map=world.only(points.ids), settled=settled, next_id=state.next_id + len(new))
    return state, frame, decisions


def optimise(setup: Setup, world: StereoMap) -> tuple[StereoMap, Adjusted | None]:
    """Optimises the window, see `window.optimised`, and computes its covariance for either shutter."""
    world, result = optimised(setup, world)
    return (with_rolling_covariance(setup, world) if result is not None and setup.rolls else world), result


def _marginalised(setup: Setup, world: StereoMap, settled: PersistentList) -> tuple[StereoMap, PersistentList, str]:
    """Marginalises the keyframes that exceed the window's size; returns a sentence about the last one, too."""
    consequence = ""
    while len(world.keys) > setup.window:
        oldest = world.keys[0]
        consequence = f"the oldest was marginalised, with its {len(oldest.ids)} points"
        settled = settled.appended((oldest.time_ns, oldest.left_from_world))
        world = (rolling_without_oldest if setup.rolls else without_oldest)(setup, world)
    return world, settled, consequence


def triangulated(setup: Setup, world: StereoMap, points: PairPoints, motion: Array) -> Array:
    """Triangulates points (N, 3) in the left camera from corrected disparities, at 2000 baselines at most.

    `motion` (12,) is as in rolling.steady. For a rolling shutter the points are in the camera of the middle row.
    """
    seen = without_errors(points.seen_by(setup.camera), world.extra)
    (x, y, right), lag, rate = seen.T, world.extra[LAG], motion[:6]
    disparity = x - right + lag * (rate[4] - rate[5] * y - right * (rate[3] * y - rate[4] * x))
    depth = (setup.baseline_m - lag * (rate[0] - right * rate[2])) / np.maximum(disparity, LEAST_DISPARITY)
    near = np.column_stack([seen[:, :2], np.ones(len(seen))]) * depth[:, None]
    return points_at_middle(setup.camera, near, motion)


def _with_rows(
    setup: Setup, world: StereoMap, state: ModernStereoState, frame: LocalisedFrame, tracked: TrackingResult
) -> StereoMap:
    """Adds the vertical disparities of the frame's inliers to the map's prior of the right camera's corrections."""
    located = tracked.located
    if located is None or world.prior is None or not setup.self_calibration:
        return world
    place, baseline = tracked.place[tracked.took_part[located.inliers]], setup.baseline_m
    near = frame.left_from_world.apply(state.map.xyz[place])
    seen = (near[:, :2] - (baseline, 0.0)) / np.maximum(near[:, 2:], 1e-6)
    late = drift(near, frame.motion[:6][None], world.extra[LAG], baseline)
    factors = by_row(seen, baseline / np.maximum(near[:, 2], 1e-6), late)
    factors = np.where(near[:, 2:] > 1e-6, factors, np.nan)
    covariance, lower = world.extra_covariance(setup.extra_sigma), tracked.lower[located.inliers]
    evidence = row_evidence(state.map.ids[place], factors, lower, world.extra, covariance, setup.noise.width)
    return replace(world, prior=world.prior.with_evidence(evidence))


def _decisions(setup: Setup, world: StereoMap, result: Adjusted, count: int, consequence: str) -> tuple[Decision, ...]:
    """Returns the decisions about an optimisation of `count` keyframes."""
    outliers, f = int((result.distances > setup.limit).sum()), setup.camera.fx
    error = median(result.distances) * f if len(result.distances) else 0.0
    noise = world.noise
    return (
        checks.ADJUSTED_ERROR.of(error, 2 * setup.noise_px.sigma),
        checks.NOISE.of(f * noise.sigma(setup.noise.sigma), setup.noise_px.sigma, noise.describe(f)),
        *optimisation_decisions(result.cost_before, result.cost_after, result.iterations, setup.iterations),
        checks.OUTLIERS.of(outliers, len(result.distances)),
        checks.WINDOW.of(count, setup.window, consequence),
        *corrections(setup, world),
    )


def corrections(setup: Setup, world: StereoMap) -> tuple[Decision, ...]:
    """Returns the decisions about all estimated corrections; none without self-calibration."""
    if not setup.self_calibration or world.covariance is None:
        return ()
    covariance = world.covariance[-PAIR:, -PAIR:]
    sigma, before = np.sqrt(np.diag(covariance)), setup.extra_sigma
    made = [
        _correction(check, *(factor * v for v in (world.extra[i], sigma[i], before[i])))
        for i, (check, factor) in enumerate(zip(checks.CORRECTIONS, _factors(setup.camera.fx), strict=True))
        if before[i] > 0
    ]
    free = before > 0
    hidden = free & (sigma > UNOBSERVABLE_SHARE * before)
    which = ", ".join(TERMS[i] for i in np.flatnonzero(hidden))
    observable = checks.OBSERVABLE.of((free & ~hidden).sum(), free.sum(), f"not yet: {which}" if which else "")
    return (*made, _bend(setup, world, covariance), observable)


def _factors(fx: float) -> Array:
    """Returns the factors (E,) from the units of right_camera.TERMS to those of the checks."""
    degree, one = float(np.degrees(1.0)), 1.0
    return np.array([one, one, fx, degree, degree, degree, 100.0, *[one] * 6, degree, 1e3, fx, degree])


def _correction(check: Check, value: float, sigma: float, before: float) -> Decision:
    """Compares a correction with two standard deviations of it."""
    spread = f"sigma {sigma:.2g}, prior {before:.2g} {check.unit}".rstrip()
    return check.of(value, 2 * sigma, spread, passed=bool(abs(value) > 2 * sigma))


def _bend(setup: Setup, world: StereoMap, covariance: Array) -> Decision:
    """Compares the disparity offset at both sides, relative to the centre, with two standard deviations of it."""
    sides = np.array([[BEND_AT, 0.0], [-BEND_AT, 0.0], [0.0, 0.0]])
    bend = setup.camera.fx * np.array([0.5, 0.5, -1.0]) @ by_column(sides, np.zeros(3))
    bend[:BOTH] = 0.0  # these corrections move far points alike in both images
    value = float(bend @ world.extra[:COLUMNS])
    twice = 2 * float(np.sqrt(bend @ covariance[:COLUMNS, :COLUMNS] @ bend))
    return checks.BEND.of(value, twice, passed=bool(abs(value) > twice))
