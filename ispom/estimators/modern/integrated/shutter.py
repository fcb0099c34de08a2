"""Rolling shutter: corrects views to the time of the middle row, and groups rows into bands for the spline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.integrated.window import JointWindow, View
from ispom.estimators.modern.rolling import at_middle
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.spline.problem import RowBands

BAND_S = 0.002
"""Height of a band [s]: its rows share a time of the spline; within it, points are moved as in `at_middle`."""


def view_at_middle_row(window: JointWindow, view: View, motion: Array) -> View:
    """Returns the view with the positions at the time of the middle row; the rig has the motion (12,), see
    `JointWindow.motion`."""
    if view.late_s is None:
        return view
    rig_from_camera = window.rig.rig_from_video if view.video else window.rig.rig_from_left
    of_camera = (motion.reshape(2, 6) @ rig_from_camera.inverse().adjoint.T).ravel()
    ray = np.column_stack([view.seen, np.ones(len(view.seen))])
    middle = at_middle(ray, view.late_s, of_camera, _inverse_depths(window, view))
    return replace(view, middle=middle[:, :2] / middle[:, 2:])


def jacobian_by_rate(window: JointWindow, view: View) -> Array:
    """Returns the Jacobian (N, 2, 6) of the positions at the time of the middle row with respect to the rate of
    rig_from_world (rho [m/s], phi [rad/s])."""
    late_s = required(view.late_s, "the view has a global shutter")
    rig_from_camera = window.rig.rig_from_video if view.video else window.rig.rig_from_left
    _, _, by_twist = reprojected(np.column_stack([view.seen, np.ones(len(view.seen))]))
    by_twist[:, :, :3] *= _inverse_depths(window, view)[:, None, None]
    return -late_s[:, None, None] * by_twist @ rig_from_camera.inverse().adjoint


def _inverse_depths(window: JointWindow, view: View) -> Array:
    """Returns the inverse depths (N,) [1/m] of a view's points: by disparity, or from the window's points; else their
    median."""
    if not view.video:
        return np.maximum(view.disparity, 0.0) / window.rig.baseline_m
    place, found = window.table.places(view.ids), np.full(len(view.ids), np.nan)
    known = place >= 0
    camera = window.camera_pose(replace(view, world_from_rig=window.predicted(view.time_ns)))
    depth = camera.inverse().apply(window.table.select(place[known]).points.xyz_in_world)[:, 2]
    found[known] = np.where(depth > window.rig.baseline_m, 1 / np.maximum(depth, 1e-6), np.nan)
    return np.where(np.isfinite(found), found, np.nanmedian(found) if np.isfinite(found).any() else 0.0)


def group_rows(views: tuple[View, ...], exposure: NDArray[np.int64]) -> tuple[RowBands, NDArray[np.int64], Array]:
    """Groups the rows of all observations (O,) into bands; `exposure` (O,) are the indices of their views.

    Returns the bands, the index (O,) of each time as in RigObservations, and the normalised displacements (O, 2) since
    the time of the band.
    """
    still = np.zeros((len(exposure), 2))
    if all(v.late_s is None for v in views):
        return RowBands(), exposure, still
    late = np.concatenate([np.zeros(len(v.ids)) if v.late_s is None else v.late_s for v in views])
    way = np.concatenate([v.seen - v.seen if v.middle is None else v.seen - v.middle for v in views])
    number = np.rint(late / BAND_S).astype(np.int64)
    other = np.flatnonzero(number)
    found, index = np.unique(np.column_stack([exposure, number])[other], axis=0, return_inverse=True)
    when = exposure.copy()
    when[other] = len(views) + index.reshape(-1)
    share = np.divide(late - BAND_S * number, late, out=np.zeros(len(late)), where=late != 0)
    return RowBands(found[:, 0], BAND_S * found[:, 1]), when, share[:, None] * way
