"""The covariance of the newest pose: of the pair that it is relative to, and of the way from there."""

from __future__ import annotations

import numpy as np

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
    way = reference.newest if view.smoothed is not None else _resected_covariance(setup.noise, state, view)
    if base is None or way is None:
        return None
    carry = (view.world_from_rig.inverse() @ reference.world_from_rig).adjoint
    return carry @ base @ carry.T + way


def by_lens(seen: Array) -> Array:
    """(N, 2, 2) how normalised coordinates (N, 2) change with the correction of the lens, to first order."""
    return -np.stack([seen, seen * (seen**2).sum(axis=1, keepdims=True)], axis=2)


def _resected_covariance(noise: Noise, state: ModernIntegratedState, view: View) -> Array | None:
    """(6, 6) of a pose by resection relative to the window's reference; None where its points are new."""
    window = state.window
    assert window.reference is not None
    _, mine, its = np.intersect1d(view.ids, window.reference.ids, assume_unique=True, return_indices=True)
    if len(mine) < MIN_POINTS:
        return None
    seen = window.seen(view)[mine]
    return pose_covariance(
        view.world_from_rig,
        window.rig.rig_from_video if view.video else window.rig.rig_from_left,
        view.video,
        window.table.select(window.table.places(view.ids[mine])).points,
        seen,
        noise.of(view.video),
        noise.loss,
        window.reference.uncertainty.select(its),
        by_lens(seen) if view.video else None,
        window.lens_covariance,
    )
