"""Where the rig is at one exposure: by resection from the points known by now, or as at the view before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.rows import at_middle
from ispom.estimators.modern.integrated.setup import MIN_POINTS, Setup
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.stereo_world import pose_by_stereo
from ispom.estimators.modern.integrated.view import RigNoise, View
from ispom.estimators.modern.rolling import LEAST, PASSES, motion_at
from ispom.geometry import Array
from ispom.solvers.localisation import Policy, PoseFit, locate
from ispom.solvers.spline.pose_covariance import pose_information
from ispom.types import Status

ENOUGH_POINTS = 30
"""Of points that were adjusted: with so many, an exposure is placed by them alone."""
INLIER = 8.0
"""Of a resection: larger reprojection errors, in standard deviations of an observation, are wrong points; wide, as new
points have depths that are guesses."""
LATE_PAIRS = 2
"""Pairs passed over, or longest intervals between pairs of the window: after as many the next is missing."""


def located(
    setup: Setup, state: ModernIntegratedState, view: View
) -> tuple[ModernIntegratedState, PoseFit | None, Status]:
    """The window with one more view, whose pose is that of the points known by now; else that of the stereo method,
    which may have found the way after a gap; else that of the view before."""
    window = state.window
    if not window.views:
        if view.video or len(view.ids) < MIN_POINTS:
            return state, None, Status.INITIALISING
        return replace(state, window=window.with_view(view)), None, Status.TRACKING
    view, found = _seen_together(setup.noise, window, view)
    by_stereo = pose_by_stereo(setup, state, view) if found is None else None
    if by_stereo is not None:
        view = replace(view, world_from_rig=by_stereo)
    elif found is None:
        view = replace(view, world_from_rig=window.views[-1].world_from_rig, located=False)
    else:
        rig_from_camera = window.rig.rig_from_video if view.video else window.rig.rig_from_left
        pose = found.camera_from_world.inverse() @ rig_from_camera.inverse()
        view = replace(view, world_from_rig=pose, located=True, metric=_metric(window, view, found, state.passed))
        view = replace(view, information=_information(setup.noise, window, view))
    state = replace(state, window=window.with_view(view))
    # The first frames have no points of known depth yet: the pair just before them says where they are.
    near = found is None and window.reference is None
    known = (found is not None and view.metric) or by_stereo is not None or near
    return state, found, Status.TRACKING if known else Status.LOST


def _metric(window: JointWindow, view: View, found: PoseFit, passed: int) -> bool:
    """Whether the points that locate a view are in metres: where pairs are missing, depths of new ones are guesses, and
    those of the points seen by such a view guesses from guesses."""
    usual_ns, missing = window.usual_ns, passed >= LATE_PAIRS
    if usual_ns is not None:
        missing |= view.time_ns - window.views[window.pairs[-1]].time_ns > LATE_PAIRS * usual_ns
    if not missing or not view.video:
        return True
    known, adjusted = _known(window, view)
    return int((adjusted[known] & found.inliers).sum()) >= MIN_POINTS


def _seen_together(noise: RigNoise, window: JointWindow, view: View) -> tuple[View, PoseFit | None]:
    """The view as if all its rows had been exposed together, by the motion before it and, of the video, that which
    leads to it; and its resection."""
    view = at_middle(window, view, window.motion(view.video))
    found, recent = _resected(noise, window, view), window.recent(view.time_ns)
    if view.late_s is None or not view.video or len(recent) + 1 < LEAST:
        return view, found
    for _ in range(PASSES):
        if found is None:
            break
        pose = found.camera_from_world.inverse() @ window.rig.rig_from_video.inverse()
        poses = [*recent, (view.time_ns, pose)]
        (first, second), (fewer, _) = (motion_at(some, view.time_ns) for some in (poses, poses[1:]))
        view = at_middle(window, replace(view, unforeseen=first - fewer), np.concatenate([first, 2 * second]))
        found = _resected(noise, window, view)
    return view, found


def _resected(noise: RigNoise, window: JointWindow, view: View) -> PoseFit | None:
    """camera_from_world by resection from the points known by now."""
    place, (known, _) = window.table.places(view.ids), _known(window, view)
    if known.sum() < MIN_POINTS:
        return None
    xyz, seen = window.table.select(place[known]).points.xyz_in_world, window.seen(view)[known]
    limit = INLIER * noise.of(view.video).sigma
    predicted = replace(view, world_from_rig=window.predicted(view.time_ns))
    policy = Policy(noise.of(view.video).width, limit, limit)
    found = locate(xyz, seen, window.camera_pose(predicted).inverse(), policy)
    return found if found is not None and found.inliers.sum() >= MIN_POINTS else None


def _known(window: JointWindow, view: View) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N,) which of its points locate a view, and which were adjusted."""
    known = window.table.places(view.ids) >= 0
    if window.reference is None:
        return known, np.zeros(len(known), bool)
    adjusted = known & np.isin(view.ids, window.reference.ids, assume_unique=True)
    # The depth of a new point is a guess.
    return adjusted if adjusted.sum() >= ENOUGH_POINTS else known, adjusted


def _information(noise: RigNoise, window: JointWindow, view: View) -> Array:
    """(6, 6) of a pose by resection, relative to the points."""
    place = window.table.places(view.ids)
    return pose_information(
        view.world_from_rig,
        window.rig.rig_from_video if view.video else window.rig.rig_from_left,
        window.table.select(place[place >= 0]).points,
        window.seen(view)[place >= 0],
        noise.of(view.video),
    )
