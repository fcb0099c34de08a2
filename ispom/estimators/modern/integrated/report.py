"""What a Step reports: decisions about the optimisation, the spline, the calibration, and the newest covariance."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.adjustment import optimised
from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.alignment import common_pair
from ispom.estimators.modern.integrated.shutter import jacobian_by_rate
from ispom.estimators.modern.integrated.state import MIN_POINTS, ModernIntegratedState, Setup
from ispom.estimators.modern.integrated.window import JointWindow, Reference, RigNoise, View
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.reductions import median
from ispom.solvers.spline.continuous import Solution
from ispom.solvers.spline.observation import RIG
from ispom.solvers.spline.pose_covariance import POSE, pose_covariance
from ispom.solvers.spline.problem import SplineProblem
from ispom.solvers.window.prior import LENS
from ispom.types import (
    Corrections,
    Decision,
    Landmarks,
    Measurement,
    MountCorrection,
    SplineFit,
    Step,
    colours_at,
    images_of,
)

OUTLIER = 8.0
"""Residual, in standard deviations, beyond which an observation is an outlier: the loss flattens from 1 on."""
DRIFT_SHARE = 0.006
"""Standard deviation of the drift without pairs, in each direction, as a share of the distance since the last pair.
Tracks drift farther from their landmarks, and depths get a common error of a percent, which independent errors of
points do not model. One share fits gaps of 3 s in sim:tiny, sim:city and indoors, four seeds each: without it the NEES
of positions grows from 3 to more than 20 within a second, with it it stays at 2 to 4."""


def report_optimisation(window: JointWindow, solution: Solution, iterations: int) -> tuple[Decision, ...]:
    """Returns the decisions about an optimised window; `iterations` is the largest number allowed."""
    problem = solution.problem
    ratio = solution.cost_after / max(solution.cost_before, 1e-12)
    size = f"{len(problem.times_s)} frames, {len(problem.points)} points, {len(solution.errors)} observations"
    cost = checks.JOINT_COST.of(ratio, 1.0, f"{size}, {len(problem.spline)} knots, {solution.iterations} iterations")
    far = checks.OUTLIERS.of(int((solution.errors > OUTLIER).sum()), len(solution.errors))
    went = optimised(solution.cost_before, solution.cost_after, solution.iterations, iterations)
    return (cost, *went, far, *_report_calibration(window))


def spline_fit(start_ns: int, problem: SplineProblem, solution: Solution) -> SplineFit:
    """Returns the spline before and after; `problem` is the solver's input, whose times count from `start_ns`."""
    found, observed, count = solution.problem, problem.exposures, len(problem.times_s)
    begun = problem.sampled()
    return SplineFit(
        start_ns + np.rint(problem.times_s * 1e9).astype(np.int64),
        problem.video,
        begun.positions[:count],
        solution.sampled.positions[:count],
        start_ns + np.rint(problem.spline.knot_times_s * 1e9).astype(np.int64),
        problem.spline.positions,
        found.spline.positions,
        _medians(solution.errors_before, observed, count),
        _medians(solution.errors, observed, count),
        solution.cost_before,
        solution.cost_after,
        solution.iterations,
    )


def _medians(errors: Array, exposure: NDArray[np.int64], count: int) -> Array:
    """Returns the median (E,) of the errors (O,) at each frame; NaN where there are none."""
    order = np.argsort(exposure, kind="stable")
    edges = np.searchsorted(exposure[order], np.arange(count + 1))
    at = [errors[order[a:b]] for a, b in pairwise(edges.tolist())]
    return np.array([median(found) if len(found) else np.nan for found in at])


def rig_covariance(window: JointWindow) -> Array:
    """Returns the covariance (7, 7) of the rig's corrections, 0 for fixed ones. Requires at least one estimate."""
    covariance, free = np.zeros((RIG, RIG)), np.flatnonzero(window.rig.free)
    inside = np.ix_(free, free)
    covariance[inside] = np.linalg.inv(window.rig_estimates[-1].information[inside])
    return covariance


def rig_corrections(window: JointWindow) -> Corrections:
    """Returns the self-calibrated corrections of the video camera's pose on the rig, and of its clock."""
    if not window.rig.free.any() or not window.rig_estimates:
        return Corrections()
    return Corrections(mount=MountCorrection.of(window.rig.minus(window.calibrated), rig_covariance(window)))


def observed_landmarks(window: JointWindow, stereo_from_world: Pose, exposure: Measurement, part: Step) -> Landmarks:
    """Returns the landmarks observed in the newest frame; ids are the window's: even for the video, odd for pairs."""
    view = window.views[-1]
    name = "video" if view.video else "left"
    index = window.table.places(view.ids)
    known = index >= 0
    tracks = part.tracks[name]
    order = np.argsort(tracks.ids, kind="stable")
    uv = tracks.uv[order[places(tracks.ids[order], view.ids[known] // 2)]]
    xyz_in_world = window.table.select(index[known]).points.xyz_in_world
    colours = colours_at(images_of(exposure)[name], uv)
    return Landmarks(view.ids[known], stereo_from_world.apply(xyz_in_world), colours)


def _report_calibration(window: JointWindow) -> tuple[Decision, ...]:
    """Compares the corrections of the video camera's calibration with twice their standard deviations."""
    rig, change = window.rig, window.rig.minus(window.calibrated)
    covariance = rig_covariance(window)
    found = []
    parts = (
        (checks.VIDEO_TURNED, slice(0, 3), 180 / np.pi),
        (checks.VIDEO_SHIFTED, slice(3, 6), 1e3),
        (checks.CLOCK_OFFSET, slice(6, 7), 1e3),
    )
    for check, part, unit in parts:
        if rig.free[part].all():
            value, sigma = unit * change[part], unit * np.sqrt(np.diag(covariance)[part])
            size, limit = float(np.linalg.norm(value)), 2 * float(np.linalg.norm(sigma))
            each = ", ".join(f"{v:.3g} +- {s:.2g}" for v, s in zip(value, sigma, strict=True))
            found.append(check.of(float(value[0]) if len(value) == 1 else size, limit, each, size > limit))
    return tuple(found)


def newest_covariance(setup: Setup, state: ModernIntegratedState, part: Step) -> Array | None:
    """Returns the covariance (6, 6) of the newest pose; `part` is the Step of the method of this camera. None if
    unknown."""
    window, view = state.window, state.window.views[-1]
    if setup.follow_stereo and not view.video and part.world_from_frame is not None:
        return part.covariance
    reference, pair = window.reference, common_pair(setup, state)
    if reference is None or pair is None or reference.time_ns != pair.time_ns:
        return None
    base = state.metric_covariance if setup.follow_stereo else reference.drift
    way = reference.newest if view.smoothed is not None else _resected_covariance(setup.noise, state, view)
    if base is None or way is None:
        return None
    if view.information is not None:
        # The reference lies on the spline, which does not follow the motion exactly.
        way = way + window.spline_error * np.linalg.inv(view.information)
    carry = (view.world_from_rig.inverse() @ reference.world_from_rig).adjoint
    return carry @ base @ carry.T + way + _drift_without_pairs(window, view, reference)


def _drift_without_pairs(window: JointWindow, view: View, reference: Reference) -> Array:
    """Returns the covariance (6, 6) of the drift since the last pair, if that is longer ago than pairs usually are;
    else 0."""
    usual_ns, since_ns = window.usual_ns, view.time_ns - reference.time_ns
    if usual_ns is None or since_ns <= usual_ns:
        return np.zeros((6, 6))
    moved = np.linalg.norm((reference.world_from_rig.inverse() @ view.world_from_rig).translation)
    sigma_m = DRIFT_SHARE * moved * (1 - usual_ns / since_ns)
    return np.diag([*[sigma_m**2] * 3, 0.0, 0.0, 0.0])


def jacobian_by_lens(seen: Array) -> Array:
    """Returns the Jacobian (N, 2, 2) of normalised coordinates (N, 2) with respect to the lens correction."""
    return -np.stack([seen, seen * (seen**2).sum(axis=1, keepdims=True)], axis=2)


def _resected_covariance(noise: RigNoise, state: ModernIntegratedState, view: View) -> Array | None:
    """Returns the covariance (6, 6) of a resected pose relative to the window's reference; None if its points are
    new."""
    window, reference = state.window, required(state.window.reference, "the window has no reference")
    _, mine, its = np.intersect1d(view.ids, reference.ids, assume_unique=True, return_indices=True)
    if len(mine) < MIN_POINTS:
        return None
    seen, uncertainty = window.seen(view)[mine], reference.uncertainty.select(its)
    moved, shared = (jacobian_by_lens(seen), window.lens_covariance) if view.video else (None, None)
    if moved is not None and view.late_s is not None:
        moved = np.concatenate([moved, jacobian_by_rate(window, view)[mine]], axis=2)
        shared = _with_rate(window, shared)
        none = np.zeros((*uncertainty.shared.shape[:2], POSE))
        uncertainty = replace(uncertainty, shared=np.concatenate([uncertainty.shared, none], axis=2))
    return pose_covariance(
        view.world_from_rig,
        window.rig.rig_from_video if view.video else window.rig.rig_from_left,
        view.video,
        window.table.select(window.table.places(view.ids[mine])).points,
        seen,
        noise.of(view.video),
        uncertainty,
        moved,
        shared,
    )


def _with_rate(window: JointWindow, lens: Array | None) -> Array:
    """Returns the covariance (8, 8) of the lens correction and of the rate that corrected the rolling shutter: all
    points of a frame share both."""
    out = np.zeros((LENS + POSE, LENS + POSE))
    out[:LENS, :LENS] = 0.0 if lens is None else lens
    out[LENS:, LENS:] = np.diag(window.rate_variance())
    return out
