"""Builds the optimisation problem of the joint window: the observations of both cameras, each at its own time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated.shutter import group_rows
from ispom.estimators.modern.integrated.window import JointWindow, RigNoise, estimated_poses, times_s
from ispom.geometry import Array
from ispom.solvers.spline.fit import fitted
from ispom.solvers.spline.problem import LEFT, VIDEO, PosePrior, RigModel, RigObservations, RowBands, SplineProblem

MIN_VIEWS = {True: 3, False: 2}
"""Least number of observations of a point in the problem, for the video (two have no redundancy) and for stereo
pairs."""
MIN_POINTS = 12
"""Least number of points of a problem: twice the minimum that a pose requires."""
FIXED_POSE = 1e10
"""Information [1/rad^2, 1/m^2] of the reference pose: 10 um and 10 urad fix it against all data."""
DEPTH_INFORMATION = 1.0
"""Prior information of the inverse depth of a point [m^2]. A standard deviation of 1/m is vague in any scene; it only
bounds the step of a point without parallax."""


def build_problem(
    window: JointWindow, noise: RigNoise, spacing_s: float, most: int
) -> tuple[SplineProblem | None, NDArray[np.int64]]:
    """Returns the problem, None for too few points, and the table indices of its points: up to `most` of each
    camera."""
    views, video_points = window.views, window.table.ids % 2 == 0
    place = np.concatenate([window.table.places(v.ids) for v in views])
    count = np.bincount(place, minlength=len(window.table.ids))
    used = _longest_tracks(count, np.where(video_points, MIN_VIEWS[True], MIN_VIEWS[False]), video_points, most)
    if len(used) < MIN_POINTS:
        return None, used
    points = window.table.select(used).points
    # The first pair of a window has neighbours on one side only: if it were fixed, its error would move all others.
    held = window.pairs[1] if window.truncated and len(window.pairs) > 2 else 0
    observations, bands = _observations(window, noise, place, used)
    return SplineProblem(
        fitted(*estimated_poses(views, times_s(views, window.rig))[1:], spacing_s),
        np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9,
        np.array([v.video for v in views]),
        points,
        observations,
        window.rig,
        _rig_prior(window),
        PosePrior(held, views[held].world_from_rig, np.eye(6) * FIXED_POSE),
        np.column_stack([points.values[:, 2], np.full(len(points), DEPTH_INFORMATION)]),
        loss=noise.video.factor,
        bands=bands,
    ), used


def _longest_tracks(count: NDArray, least: NDArray, video: NDArray, most: int) -> NDArray[np.int64]:
    """Returns the points with the most observations: up to `most` of the video and as many of the pairs."""
    enough = np.flatnonzero(count >= least)
    order = enough[np.argsort(-count[enough], kind="stable")]
    return np.sort(np.concatenate([order[video[order]][:most], order[~video[order]][:most]]))


def _observations(
    window: JointWindow, noise: RigNoise, place: NDArray[np.int64], used: NDArray[np.int64]
) -> tuple[RigObservations, RowBands]:
    """Returns the observations of the points in use, by point, then by frame, and their row bands; `place`: index in
    the window's table of each observation."""
    views = window.views
    exposure = np.repeat(np.arange(len(views)), [len(v.ids) for v in views])
    number = np.full(len(window.table.ids), -1)
    number[used] = np.arange(len(used))
    owner = number[place]
    index = np.flatnonzero(owner >= 0)
    index = index[np.lexsort((exposure[index], owner[index]))]
    video = np.array([v.video for v in views])
    camera = np.where(video[exposure[index]], VIDEO, LEFT)
    bands, when, moved = group_rows(views, exposure)
    seen = _coordinates(window, moved)[index]
    inverse = (
        1 / np.array([[noise.video.sigma] * 2 + [np.inf], [noise.stereo.sigma] * 2 + [noise.disparity.sigma]])[camera]
    )
    inverse[np.isnan(seen[:, 2]), 2] = 0.0
    return RigObservations(when[index], camera, owner[index], np.nan_to_num(seen), inverse), bands


def _coordinates(window: JointWindow, moved: Array) -> Array:
    """Returns (O, 3) normalised coordinates and disparities of all observations, without the calibration errors.

    `moved` (O, 2) is the displacement since the time of their row's band.
    """
    views = [v if v.middle is None else replace(v, middle=None) for v in window.views]
    uv = np.concatenate([window.seen(v) for v in views]) - moved
    disparity = [v.rectified(window.pair_errors, window.rig.baseline_m) for v in window.views]
    return np.column_stack([uv, np.concatenate(disparity)])


def _rig_prior(window: JointWindow) -> RigModel:
    """Returns the estimate of the rig from observations that have left the window, so that none counts twice."""
    complete = window.truncated and len(window.rig_estimates) >= len(window.pairs) - 1
    return window.rig_estimates[0] if complete else window.calibrated
