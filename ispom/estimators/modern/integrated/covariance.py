"""Covariance of the newest pose: that of the reference pair, plus that of the relative pose since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.errors import required
from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.rows import by_rate
from ispom.estimators.modern.integrated.setup import MIN_POINTS, Setup
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.stereo_world import common_pair
from ispom.estimators.modern.integrated.view import Reference, RigNoise, View
from ispom.geometry import Array
from ispom.solvers.spline.pose_covariance import POSE, pose_covariance
from ispom.solvers.window.prior import LENS
from ispom.types import Step

DRIFT_SHARE = 0.006
"""Standard deviation of the drift without pairs, in each direction, as a share of the distance since the last pair.
Tracks drift farther from their landmarks, and depths get a common error of a percent, which independent errors of
points do not model. One share fits gaps of 3 s in sim:tiny, sim:city and indoors, four seeds each: without it the NEES
of positions grows from 3 to more than 20 within a second, with it it stays at 2 to 4."""


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
    return carry @ base @ carry.T + way + _drift(window, view, reference)


def _drift(window: JointWindow, view: View, reference: Reference) -> Array:
    """Returns the covariance (6, 6) of the drift since the last pair, if that is longer ago than pairs usually are;
    else 0."""
    usual_ns, since_ns = window.usual_ns, view.time_ns - reference.time_ns
    if usual_ns is None or since_ns <= usual_ns:
        return np.zeros((6, 6))
    moved = np.linalg.norm((reference.world_from_rig.inverse() @ view.world_from_rig).translation)
    sigma_m = DRIFT_SHARE * moved * (1 - usual_ns / since_ns)
    return np.diag([*[sigma_m**2] * 3, 0.0, 0.0, 0.0])


def by_lens(seen: Array) -> Array:
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
    moved, shared = (by_lens(seen), window.lens_covariance) if view.video else (None, None)
    if moved is not None and view.late_s is not None:
        moved = np.concatenate([moved, by_rate(window, view)[mine]], axis=2)
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
