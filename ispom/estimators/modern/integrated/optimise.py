"""Optimises the joint window after each stereo pair, and computes the covariances of the result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.alignment import common_pair, report_alignment
from ispom.estimators.modern.integrated.knots import choose_knots
from ispom.estimators.modern.integrated.observe import with_latest_lens
from ispom.estimators.modern.integrated.problem import FIXED_POSE, build_problem
from ispom.estimators.modern.integrated.report import jacobian_by_lens, report_optimisation, spline_fit
from ispom.estimators.modern.integrated.state import ModernIntegratedState, Setup
from ispom.estimators.modern.integrated.window import JointWindow, Reference, View
from ispom.geometry import Array, Pose
from ispom.solvers.spline.accelerations import solve_with_accelerations
from ispom.solvers.spline.continuous import Solution, solve
from ispom.solvers.spline.problem import VIDEO, PosePrior
from ispom.solvers.window.prior import LENS
from ispom.types import Decision, SplineFit

NEWEST_VIEWS = 8
"""Number of the newest views that are never thinned out: their points localise the next frames."""
MOST_ATTACHED = 3
"""Largest number of attached frames, per view that the window may have: beyond it the oldest part leaves the window."""
USUAL_FRAME_S = 0.1
"""Frame interval [s] assumed for a video with one frame so far."""


@dataclass(frozen=True, eq=False)
class Optimisation:
    """What a Step reports about the optimisation after a pair; empty if there was none."""

    decisions: tuple[Decision, ...] = ()
    poses: tuple[tuple[int, Pose, bool], ...] = ()
    """Time, world_from_rig in the window's world, and whether of the video, of all frames of the window."""
    spline: SplineFit | None = None
    """The spline in the window's world."""


def optimise(setup: Setup, state: ModernIntegratedState) -> tuple[ModernIntegratedState, Optimisation]:
    """Removes the oldest pairs, fits one spline to all observations in the window, and updates poses, points, rig and
    covariances."""
    before = state.window
    state = _without_oldest_pairs(setup, state)
    window, reference_pair = with_latest_lens(state), common_pair(setup, state)
    if len(window.pairs) < 2 or reference_pair is None:
        return state, Optimisation()
    frame_s = USUAL_FRAME_S if state.interval.median_ns is None else state.interval.median_ns * 1e-9
    window, knots = choose_knots(setup, window, frame_s)
    problem, used = build_problem(window, setup.noise, knots.spacing_s, setup.max_points)
    if problem is None:
        return state, Optimisation((checks.POINTS.of(0, 1),))
    # Dense knots follow any motion: only a prior on the accelerations keeps them together where images are missing.
    solver = solve_with_accelerations if knots.dense else solve
    solution = solver(problem, setup.iterations)
    window = _apply_solution(setup, replace(state, window=window), solution, used, reference_pair.time_ns)
    state = replace(state, window=window)
    decisions = (
        *knots.decisions,
        *report_optimisation(window, solution, setup.iterations),
        _report_removed(setup, before, window),
        *report_alignment(setup, state),
    )
    poses = tuple(pose for view in window.views for pose in view.poses())
    return state, Optimisation(decisions, poses, spline_fit(window.views[0].time_ns, problem, solution))


def _without_oldest_pairs(setup: Setup, state: ModernIntegratedState) -> ModernIntegratedState:
    """Keeps at most `window_pairs` stereo pairs; the poses of the frames that leave are final."""
    window, pairs = state.window, state.window.pairs
    if len(pairs) > setup.window_pairs:
        state = _without_first_views(state, pairs[-setup.window_pairs])
        window = state.window
    since_ns = window.views[0].time_ns if window.views else 0
    return replace(state, metric=tuple(item for item in state.metric if item[0] >= since_ns))


def _without_first_views(state: ModernIntegratedState, count: int) -> ModernIntegratedState:
    """Removes this number of the oldest views, whose poses are final."""
    window, removed = state.window, state.window.views[:count]
    settled = state.settled.extended(pose for view in removed for pose in view.poses())
    return replace(state, window=window.with_views(window.views[count:], truncated=True), settled=settled)


def limit_views(setup: Setup, state: ModernIntegratedState) -> tuple[ModernIntegratedState, tuple[Decision, ...]]:
    """Thins the window to about `max_views` views; that is only necessary if the time between two pairs is very long.

    Every second video view in the interval between pairs (or since the last one) that has the most views is attached to
    the view before it, and moves along with that. If too many are attached, the older half leaves the window.
    """
    window, most = state.window, setup.max_views
    count = len(window.views)
    if count <= most:
        return state, ()
    if sum(len(v.attached) for v in window.views) > MOST_ATTACHED * most:
        removed = "the oldest leave without optimisation"
        return _without_first_views(state, count // 2), (checks.VIEWS.of(count, most, removed),)
    ends = [-1, *window.pairs, count - NEWEST_VIEWS]
    first, last = max(pairwise(ends), key=lambda interval: interval[1] - interval[0])
    views = list[View]()
    for i, view in enumerate(window.views):
        if first < i - 1 and i < last and (i - first) % 2 == 0:
            views[-1] = views[-1].with_attached(view)
        else:
            views.append(view)
    attached = "every second one between two pairs moves with its neighbours"
    window = window.with_views(tuple(views), window.truncated)
    return replace(state, window=window), (checks.VIEWS.of(count, most, attached),)


def _report_removed(setup: Setup, before: JointWindow, after: JointWindow) -> Decision:
    """Reports whether the oldest pairs left the window."""
    removed = len(before.views) - len(after.views)
    then = f"{removed} frames left with it, and their poses are final" if removed else ""
    return checks.WINDOW.of(len(before.pairs), setup.window_pairs, then)


def _apply_solution(
    setup: Setup, state: ModernIntegratedState, solution: Solution, used: NDArray[np.int64], reference_ns: int
) -> JointWindow:
    """Updates poses, points and the free parameters of the rig; covariances are relative to the frame at
    `reference_ns`."""
    window = state.window
    sampled, edge = solution.sampled, window.pairs[1]
    exposures = slice(len(window.views))
    poses = [Pose(r, p) for r, p in zip(sampled.rotations[exposures], sampled.positions[exposures], strict=True)]
    views = tuple(
        replace(
            view,
            world_from_rig=pose,
            smoothed=view.smoothed if view.smoothed is not None and i < edge and window.truncated else pose,
            located=True,
            information=None,
        )
        for i, (view, pose) in enumerate(zip(window.views, poses, strict=True))
    )
    values = window.table.points.values.copy()
    values[used] = solution.problem.points.values
    table = replace(window.table, points=replace(window.table.points, values=values))
    window = replace(window, rig=solution.problem.rig, views=views, table=table)
    reference, parameters = _reference(setup, replace(state, window=window), reference_ns, solution, used)
    rig_estimates = (*window.rig_estimates, solution.refined_rig(parameters))[-len(window.pairs) :]
    return replace(window, reference=reference, rig_estimates=rig_estimates)


def _reference(
    setup: Setup, state: ModernIntegratedState, time_ns: int, solution: Solution, used: NDArray[np.int64]
) -> tuple[Reference, Array]:
    """Returns the covariances of the points that may be observed again and of the newest pose, relative to a pair's
    pose; and (n, n) the covariance of knots and rig by the normal equations alone."""
    window = state.window
    place = {v.time_ns: i for i, v in enumerate(window.views) if not v.video}
    here = place[time_ns]
    pose = window.views[here].world_from_rig
    weighed = solution.parameter_covariance(PosePrior(here, pose, np.eye(6) * FIXED_POSE))
    parameters, moves = solution.sandwich_covariance(weighed)
    by_spline, by_points = solution.follows(_jacobian_by_lens(solution), weighed)
    lens = np.zeros((LENS, LENS)) if window.lens_covariance is None else window.lens_covariance
    together = parameters + by_spline @ lens @ by_spline.T
    recent = [next((v.ids for v in reversed(window.views) if v.video == video), used[:0]) for video in (True, False)]
    chosen = np.flatnonzero(np.isin(window.table.ids[used], np.concatenate(recent)))
    drift, before = np.zeros((6, 6)), window.reference
    if before is not None:
        # The covariance of the relative pose to the previous reference, plus that of the reference itself.
        there = place.get(before.time_ns, 0)
        carry = (pose.inverse() @ window.views[there].world_from_rig).adjoint
        drift = carry @ (before.drift + solution.pose_covariance(there, together)) @ carry.T
    points = replace(solution.point_uncertainty(chosen, parameters, moves), shared=by_points[chosen])
    newest = solution.pose_covariance(len(window.views) - 1, together)
    return Reference(time_ns, pose, window.table.ids[used[chosen]], points, newest, drift), weighed


def _jacobian_by_lens(solution: Solution) -> Array:
    """Returns (O, 3, 2) the Jacobian of all observations with respect to the lens correction of the video camera."""
    o = solution.problem.observations
    moved = np.where((o.camera == VIDEO)[:, None, None], jacobian_by_lens(o.seen[:, :2]), 0.0)
    return np.concatenate([moved, np.zeros((len(moved), 1, LENS))], axis=1)
