"""Optimises the joint window after each stereo pair, and computes the covariances of the result."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.covariance import by_lens
from ispom.estimators.modern.integrated.joint_problem import HELD, joint_problem
from ispom.estimators.modern.integrated.joint_report import report, spline_fit
from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.knots import USUAL_KNOT_FRAMES, dense_frames, knot_spacing_s, with_knots
from ispom.estimators.modern.integrated.observe import with_lens
from ispom.estimators.modern.integrated.setup import Setup
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.stereo_world import alignment, common_pair
from ispom.estimators.modern.integrated.thinning import shortened, thinned
from ispom.estimators.modern.integrated.view import Reference
from ispom.geometry import Array, Pose
from ispom.solvers.spline.accelerations import solve_with_accelerations
from ispom.solvers.spline.continuous import Solution, solve
from ispom.solvers.spline.problem import VIDEO, PosePrior
from ispom.solvers.window.prior import LENS
from ispom.types import Decision, SplineFit

USUAL_FRAME_S = 0.1
"""Frame interval [s] assumed for a video with one frame so far."""


def limited(setup: Setup, state: ModernIntegratedState) -> tuple[ModernIntegratedState, tuple[Decision, ...]]:
    """Thins the window to at most `max_views` views."""
    count = len(state.window.views)
    if count <= setup.max_views:
        return state, ()
    window, left = thinned(state.window, setup.max_views)
    then = (
        "the oldest leave without optimisation"
        if left
        else "every second one between two pairs moves with its neighbours"
    )
    settled = state.settled.extended(pose for view in left for pose in view.poses())
    return replace(state, window=window, settled=settled), (checks.VIEWS.of(count, setup.max_views, then),)


def adjusted(
    setup: Setup, state: ModernIntegratedState
) -> tuple[ModernIntegratedState, tuple[Decision, ...], list[tuple[int, Pose, bool]], SplineFit | None]:
    """Optimises the window after the oldest pair left; returns decisions, poses, and the spline in the window's
    world."""
    before = state.window
    state = _shortened(setup, state)
    window, meeting = with_lens(state), common_pair(setup, state)
    if len(window.pairs) < 2 or meeting is None:
        return state, (), [], None
    frame_s = USUAL_FRAME_S if state.interval.median_ns is None else state.interval.median_ns * 1e-9
    frames, why, solved = setup.knot_frames or USUAL_KNOT_FRAMES, (), solve
    # A wrong clock or rig looks like motion.
    if not setup.knot_frames and not window.rig.free.any():
        window, chosen = with_knots(window, frame_s, setup.knot_misfit)
        frames, why = min(window.knots), (chosen,)
        if len(window.pairs) == 2:
            frames, solved = dense_frames(window, frames, frame_s), solve_with_accelerations
            then = f"knots every {frames:.3g} frames, which alone connect video and pairs"
            why = (replace(chosen, consequence=then),)
    problem, used = joint_problem(window, setup.noise, knot_spacing_s(window, frames, frame_s), setup.max_points)
    if problem is None:
        return state, (checks.POINTS.of(0, 1),), [], None
    solution = solved(problem, setup.iterations)
    window = _with_solution(setup, replace(state, window=window), solution, used, meeting.time_ns)
    poses = [pose for view in window.views for pose in view.poses()]
    state, fit = replace(state, window=window), spline_fit(window.views[0].time_ns, problem, solution)
    went = report(window, solution, setup.iterations), (_what_left(setup, before, window),), alignment(setup, state)
    return state, (*why, *chain(*went)), poses, fit


def _what_left(setup: Setup, before: JointWindow, after: JointWindow) -> Decision:
    """Reports whether the oldest pairs left the window."""
    gone = len(before.views) - len(after.views)
    then = f"{gone} frames left with it, and their poses are final" if gone else ""
    return checks.WINDOW.of(len(before.pairs), setup.window_pairs, then)


def _shortened(setup: Setup, state: ModernIntegratedState) -> ModernIntegratedState:
    window, left = shortened(state.window, setup.window_pairs)
    since = window.views[0].time_ns if window.views else 0
    metric = tuple(item for item in state.metric if item[0] >= since)
    settled = state.settled.extended(pose for view in left for pose in view.poses())
    return replace(state, window=window, settled=settled, metric=metric)


def _with_solution(
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
    weighed = solution.parameter_covariance(PosePrior(here, pose, np.eye(6) * HELD))
    parameters, moves = solution.sandwich_covariance(weighed)
    by_spline, by_points = solution.follows(_moved_by_lens(solution), weighed)
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


def _moved_by_lens(solution: Solution) -> Array:
    """Returns (O, 3, 2) the Jacobian of all observations with respect to the lens correction of the video camera."""
    o = solution.problem.observations
    moved = np.where((o.camera == VIDEO)[:, None, None], by_lens(o.seen[:, :2]), 0.0)
    return np.concatenate([moved, np.zeros((len(moved), 1, LENS))], axis=1)
