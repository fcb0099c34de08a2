"""What a pair leads to, as the Step says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.stereo.correspondence import Correspondences
from ispom.estimators.paper.stereo.rigid_transformation import CommonPoints
from ispom.estimators.paper.stereo.state import Cloud
from ispom.geometry import Pose
from ispom.solvers.rigid import RigidMotion
from ispom.types import Decision, Frame, Landmarks, Rig, Status, Step, Tracks, TrackStatus, colours_at


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the steps of section 6.2 gave."""

    found: Correspondences
    has_depth: NDArray[np.bool_]
    """(N,) of the points found."""
    cloud: Cloud
    common: CommonPoints
    motion: RigidMotion | None
    world_from_rig: Pose | None
    decisions: tuple[Decision, ...]


def as_step(
    rig: Rig,
    exposure: Frame,
    reference: Cloud | None,
    outcome: Outcome,
    cloud: Cloud,
    depth_limit_m: float,
    seconds: Mapping[str, float],
) -> Step:
    """`cloud` is that of the outcome with the ids that its points have from now on."""
    tracks, located = _tracks(rig, reference, outcome), outcome.world_from_rig is not None
    residuals = tracks.residual_px[tracks.status == TrackStatus.ALIVE]
    lost = Status.INITIALISING if reference is None else Status.LOST
    return Step(
        exposure.time_ns,
        Status.TRACKING if located else lost,
        "rig",
        outcome.world_from_rig,
        key_frame=located,
        tracks={"left": tracks},
        landmarks=_landmarks(rig, exposure, cloud, outcome.world_from_rig, depth_limit_m),
        residuals_px=residuals[np.isfinite(residuals)],
        decisions=outcome.decisions,
        seconds=seconds,
    )


def _tracks(rig: Rig, reference: Cloud | None, outcome: Outcome) -> Tracks:
    """The points of this pair, and those of the reference that were not found again."""
    found, has_depth, motion, common = outcome.found, outcome.has_depth, outcome.motion, outcome.common
    known, nan = found.previous >= 0, np.full(len(found.ids), np.nan, np.float32)
    status = np.where(known, TrackStatus.ALIVE, TrackStatus.NEW).astype(np.uint8)
    status[~has_depth] = TrackStatus.NO_DISPARITY
    residual, disparity = nan.copy(), nan.copy()
    disparity[has_depth] = outcome.cloud.disparity_px
    if reference is None:
        return Tracks.of(found.ids, found.features.uv, status=status, disparity_px=disparity)
    uv_prev = np.column_stack([nan, nan])
    uv_prev[known] = reference.features.uv[found.previous[known]]
    if motion is not None:
        place = np.flatnonzero(has_depth)[common.cloud]
        moved = motion.target_from_source.inverse().apply(reference.xyz_in_left[common.reference])
        seen = rig.camera("left").project(moved)
        residual[place] = np.linalg.norm(seen - found.features.uv[place], axis=1)
        status[place[~motion.inliers]] = TrackStatus.RIGID
    gone = found.ended != TrackStatus.ALIVE
    unknown = np.full(gone.sum(), np.nan, np.float32)
    return Tracks.of(
        np.concatenate([found.ids, reference.ids[gone]]),
        np.concatenate([found.features.uv, reference.features.uv[gone]]),
        status=np.concatenate([status, found.ended[gone]]),
        uv_prev=np.concatenate([uv_prev, reference.features.uv[gone]]),
        residual_px=np.concatenate([residual, unknown]),
        disparity_px=np.concatenate([disparity, unknown]),
    )


def _landmarks(rig: Rig, exposure: Frame, cloud: Cloud, world_from_rig: Pose | None, limit_m: float) -> Landmarks:
    """The points near enough to count."""
    if world_from_rig is None:
        return Landmarks.empty()
    near = cloud.xyz_in_left[:, 2] <= limit_m
    xyz = (world_from_rig @ rig.rig_from_left).apply(cloud.xyz_in_left[near])
    return Landmarks(cloud.ids[near], xyz, colours_at(exposure.left, cloud.features.uv[near]))
