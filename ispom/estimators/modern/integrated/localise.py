"""Localises the rig at one frame: by resection from known points, otherwise by stereo or the pose before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated.alignment import pose_by_stereo, stereo_from_window
from ispom.estimators.modern.integrated.shutter import view_at_middle_row
from ispom.estimators.modern.integrated.state import MIN_POINTS, ModernIntegratedState, Setup
from ispom.estimators.modern.integrated.window import JointWindow, RigNoise, View
from ispom.estimators.modern.rolling import LEAST, PASSES, motion_at
from ispom.geometry import Array, Pose
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.resection import ResectionProblem
from ispom.solvers.localisation import Policy, PoseFit, locate
from ispom.solvers.spline.pose_covariance import pose_information
from ispom.types import Status

ENOUGH_POINTS = 30
"""Number of optimised points from which a frame is localised by these only."""
INLIER = 8.0
"""Inlier limit of a resection, in standard deviations of an observation; wide, as the depths of new points are
guesses."""
LATE_PAIRS = 2
"""Number of skipped pairs, or of longest intervals between pairs, after which pairs count as missing."""


def localise(
    setup: Setup, state: ModernIntegratedState, view: View
) -> tuple[ModernIntegratedState, PoseFit | None, Status]:
    """Adds a view to the window. Its pose is resected from known points; otherwise it is that of the stereo method,
    which may have relocalised after a gap; otherwise that of the view before."""
    window = state.window
    if not window.views:
        if view.video or len(view.ids) < MIN_POINTS:
            return state, None, Status.INITIALISING
        return replace(state, window=window.with_view(view)), None, Status.TRACKING
    view, resection = _resect_at_middle_row(setup.noise, window, view, lambda: stereo_from_window(setup, state))
    by_stereo = pose_by_stereo(setup, state, view) if resection is None else None
    if by_stereo is not None:
        view = replace(view, world_from_rig=by_stereo)
    elif resection is None:
        view = replace(view, world_from_rig=window.views[-1].world_from_rig, located=False)
    else:
        rig_from_camera = window.rig.rig_from_video if view.video else window.rig.rig_from_left
        pose = resection.camera_from_world.inverse() @ rig_from_camera.inverse()
        view = replace(
            view, world_from_rig=pose, located=True, metric=_is_metric(window, view, resection, state.skipped)
        )
        view = replace(view, information=_information(setup.noise, window, view))
    state = replace(state, window=window.with_view(view))
    # The first frames have no points of known depth; they take the pose of the pair just before them.
    near = resection is None and window.reference is None
    known = (resection is not None and view.metric) or by_stereo is not None or near
    return state, resection, Status.TRACKING if known else Status.LOST


def _is_metric(window: JointWindow, view: View, resection: PoseFit, skipped: int) -> bool:
    """Checks that the points which localise a view are metric: where pairs are missing, depths of new points are
    guesses, and those of the points first observed by such views depend on guesses."""
    usual_ns, missing = window.usual_ns, skipped >= LATE_PAIRS
    if usual_ns is not None:
        missing |= view.time_ns - window.views[window.pairs[-1]].time_ns > LATE_PAIRS * usual_ns
    if not missing or not view.video:
        return True
    known, adjusted = _points_to_use(window, view)
    return int((adjusted[known] & resection.inliers).sum()) >= MIN_POINTS


def _resect_at_middle_row(
    noise: RigNoise, window: JointWindow, view: View, stereo_from_world: Callable[[], Pose]
) -> tuple[View, PoseFit | None]:
    """Corrects the rolling shutter of a view by the predicted motion and, for the video, by the motion up to it;
    returns the view and its resection. `stereo_from_world` leads to the world of
    the reported poses."""
    view = view_at_middle_row(window, view, window.motion(view.video))
    resection, recent = _resect(noise, window, view, stereo_from_world), window.recent(view.time_ns)
    if view.late_s is None or not view.video or len(recent) + 1 < LEAST:
        return view, resection
    for _ in range(PASSES):
        if resection is None:
            break
        pose = resection.camera_from_world.inverse() @ window.rig.rig_from_video.inverse()
        poses = [*recent, (view.time_ns, pose)]
        motion, fewer = motion_at(poses, view.time_ns), motion_at(poses[1:], view.time_ns)
        view = view_at_middle_row(window, replace(view, rate_difference=(motion - fewer)[:6]), motion)
        resection = _resect(noise, window, view, stereo_from_world)
    return view, resection


def _resect(noise: RigNoise, window: JointWindow, view: View, stereo_from_world: Callable[[], Pose]) -> PoseFit | None:
    """Returns camera_from_world by resection from known points; None for too few inliers."""
    place, (known, _) = window.table.places(view.ids), _points_to_use(window, view)
    if known.sum() < MIN_POINTS:
        return None
    xyz, seen = window.table.select(place[known]).points.xyz_in_world, window.seen(view)[known]
    limit = INLIER * noise.of(view.video).sigma
    predicted = replace(view, world_from_rig=window.predicted(view.time_ns))
    policy = Policy(noise.of(view.video).width, limit, limit)
    resection = locate(xyz, seen, window.camera_pose(predicted).inverse(), policy)
    if resection is None or resection.inliers.sum() < MIN_POINTS:
        return None

    def problem() -> ResectionProblem:
        """In the world of the reported poses, by the ids of the camera's own tracks."""
        onto = stereo_from_world()
        pose, name = resection.camera_from_world @ onto.inverse(), "video" if view.video else "left"
        return ResectionProblem(view.ids[known] // 2, onto.apply(xyz), seen, pose, policy.width, name)

    report_problem(problem)
    return resection


def _points_to_use(window: JointWindow, view: View) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns (N,) which points localise a view, and which of its points were optimised."""
    known = window.table.places(view.ids) >= 0
    if window.reference is None:
        return known, np.zeros(len(known), bool)
    adjusted = known & np.isin(view.ids, window.reference.ids, assume_unique=True)
    # Depths of new points are guesses.
    return adjusted if adjusted.sum() >= ENOUGH_POINTS else known, adjusted


def _information(noise: RigNoise, window: JointWindow, view: View) -> Array:
    """Returns the information (6, 6) of a resected pose, for fixed points."""
    place = window.table.places(view.ids)
    return pose_information(
        view.world_from_rig,
        window.rig.rig_from_video if view.video else window.rig.rig_from_left,
        window.table.select(place[place >= 0]).points,
        window.seen(view)[place >= 0],
        noise.of(view.video),
    )
