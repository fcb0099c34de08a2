"""The covariance of the newest pose: of the pair that it is relative to, and of the way from there."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.setup import MIN_POINTS, Setup
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.stereo_world import common_pair
from ispom.estimators.modern.integrated.view import Noise, View
from ispom.geometry import Array
from ispom.solvers.spline.pose_covariance import pose_covariance
from ispom.types import Step


def newest_covariance(setup: Setup, state: ModernIntegratedState, part: Step) -> Array | None:
    """(6, 6) of the newest pose, `part` being the Step of the method asked; None where it is not known."""
    window, view = state.window, state.window.views[-1]
    if setup.follow_stereo and not view.video and part.world_from_frame is not None:
        return part.covariance
    reference, pair = window.reference, common_pair(setup, state)
    if reference is None or pair is None or reference.time_ns != pair.time_ns:
        return None
    base = state.metric_covariance if setup.follow_stereo else reference.drift
    way = reference.newest if view.smoothed is not None else _resected_covariance(setup.noise, window, view)
    if base is None or way is None:
        return None
    factor = _variance_factor(setup.noise, state.track_sigmas)
    if not setup.follow_stereo:
        base = factor * base
    carry = (view.world_from_rig.inverse() @ reference.world_from_rig).adjoint
    return carry @ base @ carry.T + factor * way


def _variance_factor(noise: Noise, sigmas: tuple[float | None, float | None]) -> float:
    """What covariances of the joint window are to be multiplied by: `noise` weighs one camera against the other, but
    tracks are as far off as the methods that followed them found (None where they did not say). Of both cameras the one
    that is the farther off counts for the whole."""
    given = zip(sigmas, (noise.video, noise.stereo), strict=True)
    return max(((sigma / setting) ** 2 for sigma, setting in given if sigma is not None), default=1.0)


def _resected_covariance(noise: Noise, window: JointWindow, view: View) -> Array | None:
    """(6, 6) of a pose by resection relative to the window's reference; None where its points are new."""
    assert window.reference is not None
    _, mine, its = np.intersect1d(view.ids, window.reference.ids, assume_unique=True, return_indices=True)
    if len(mine) < MIN_POINTS:
        return None
    return pose_covariance(
        view.world_from_rig,
        window.rig.rig_from_video if view.video else window.rig.rig_from_left,
        view.video,
        window.table.select(window.table.places(view.ids[mine])).points,
        window.seen(view)[mine],
        noise.of(view.video),
        noise.loss,
        window.reference.uncertainty.select(its),
    )
