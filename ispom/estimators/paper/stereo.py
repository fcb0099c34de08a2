"""Stereo (section 6.2): left/right matches, a point cloud each, the rigid transformation between consecutive clouds.

Where this differs from the print: the motion is fitted in RANSAC, to points within `max_depth_baselines` of the camera;
a pair is compared with the last one that was located, which is the one before it unless that was lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper import checks
from ispom.frontends import corners, sift
from ispom.frontends.disparity import RowSearch
from ispom.frontends.klt import Klt
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.solvers.rigid import RigidMotion, rigid_motion
from ispom.solvers.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Exposure,
    Image,
    Landmarks,
    Rig,
    Status,
    Step,
    StereoPair,
    Tracks,
    TrackStatus,
    Trajectory,
    as_grey,
    colours_at,
)

REFINE = Klt(window_px=15, levels=0, max_forward_backward_px=0.3)
"""Detectors place a point anew in every image, tenths of a pixel beside itself; this finds the same place again."""
MAX_REFINEMENT_PX = 1.0
MIN_DISPARITY_PX = 1.0
"""A smaller disparity says no more than that the point is far."""


@dataclass(frozen=True)
class StereoConfig:
    """Settings of the stereo estimator (section 6.2)."""

    matching: Literal["sift", "klt"] = "sift"
    """How consecutive left images correspond: descriptors survive metres between pairs, tracking is faster."""
    max_points: Annotated[int, Range(50, 5000)] = 3000
    """Points described in each left image, with sift."""
    max_tracks: Annotated[int, Range(50, 5000)] = 1000
    """Points tracked into each left image, with klt."""
    max_depth_baselines: Annotated[float, Range(5, 500)] = 50.0
    """Points farther than this many baselines are left out of the fit, which, unweighted, they would spoil;
    where too few are nearer, up to two and four times as far."""
    inlier_disparity_px: Annotated[float, Range(0.1, 10)] = 0.7
    """A point fits the rigid motion where its distance is within the depth error of this disparity error."""
    min_inliers: Annotated[int, Range(6, 500)] = 12
    """Fewer corresponding points than this, and the pair is not located."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last located one before the next starts afresh from the last known pose."""

    def build(self, rig: Rig) -> Stereo:
        return Stereo(rig, self)


@dataclass(frozen=True, eq=False)
class Cloud:
    """The points of one stereo pair, with what finds them again in the next left image."""

    grey: Image
    ids: NDArray[np.int64]
    features: sift.Features
    disparity_px: NDArray[np.float32]
    xyz_in_left: Array

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class StereoState:
    reference: Cloud | None = None
    """Of the last located pair."""
    world_from_rig: Pose | None = None
    """Of the last located pair."""
    lost_pairs: int = 0
    next_id: int = 0
    poses: PersistentList[tuple[int, Pose]] = PersistentList()


@dataclass(frozen=True, eq=False)
class Stereo:
    """Metric, sparse, needs only two consecutive pairs at a time. World: the rig at the first pair."""

    rig: Rig
    config: StereoConfig

    def start(self) -> StereoState:
        return StereoState()

    def finish(self, state: StereoState) -> Trajectory:
        return Trajectory.of(list(state.poses))

    def step(self, state: StereoState, exposure: Exposure) -> tuple[StereoState, Step]:
        """One pair, as the steps of section 6.2."""
        assert isinstance(exposure, StereoPair)
        watch = Stopwatch()
        left, right = as_grey(exposure.left), as_grey(exposure.right)
        found = self._correspond_in_time(state, left)
        watch.lap("correspond")
        cloud, has_depth = self._cloud(left, right, found)
        watch.lap("left-right")
        pairs = self._pairs(state.reference, cloud)
        motion = self._rigid_motion(state.reference, cloud, pairs)
        watch.lap("motion")
        first = state.reference is None
        located, decisions = self._decide(state, cloud, pairs, motion)
        world_from_rig = self._locate(state, motion) if located else None
        tracks = self._tracks(state, found, has_depth, cloud, pairs, motion)
        cloud, next_id = _renamed(cloud, pairs[1], motion, found.next_id)
        after = self._next_state(state, exposure.time_ns, cloud, world_from_rig, next_id)
        status = Status.TRACKING if located else Status.INITIALISING if first else Status.LOST
        residuals = tracks.residual_px[tracks.status == TrackStatus.ALIVE]
        step = Step(
            exposure.time_ns,
            status,
            "rig",
            world_from_rig,
            key_frame=located,
            tracks={"left": tracks},
            landmarks=self._landmarks(exposure, cloud, world_from_rig),
            residuals_px=residuals[np.isfinite(residuals)],
            decisions=decisions,
            seconds=watch.seconds,
        )
        return after, step

    def _correspond_in_time(self, state: StereoState, left: Image) -> Found:
        """Points of this left image, and which of them the reference image shows as well."""
        reference, config = state.reference, self.config
        if config.matching == "sift":
            features = sift.detect_and_describe(left, config.max_points)
            ended = np.zeros(0, np.uint8) if reference is None else np.full(len(reference), TrackStatus.UNMATCHED)
            ids, previous = np.full(len(features), -1, np.int64), np.full(len(features), -1, np.int64)
            if reference is not None:
                pairs = sift.match(reference.features, features)
                previous[pairs[:, 1]] = pairs[:, 0]
                ended[pairs[:, 0]] = TrackStatus.ALIVE
                features = _refined(reference, left, features, pairs)
        else:
            uv, ended = np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
            previous = np.zeros(0, np.int64)
            if reference is not None:
                uv, ended = Klt(levels=4).track(reference.grey, left, reference.features.uv)
                previous = np.flatnonzero(ended == TrackStatus.ALIVE)
                uv = uv[previous]
            fresh = corners.detect(left, config.max_tracks - len(uv), uv)
            features = sift.Features(np.concatenate([uv, fresh]), np.zeros((len(uv) + len(fresh), 0), np.float32))
            previous = np.concatenate([previous, np.full(len(fresh), -1, np.int64)])
            ids = np.full(len(features), -1, np.int64)
        known = previous >= 0
        if reference is not None:
            ids[known] = reference.ids[previous[known]]
        ids[~known] = state.next_id + np.arange((~known).sum())
        return Found(left, features, ids, previous, ended, state.next_id + int((~known).sum()))

    def _cloud(self, left: Image, right: Image, found: Found) -> tuple[Cloud, NDArray[np.bool_]]:
        """Left to right along the row, triangulated."""
        camera, baseline = self.rig.camera("left"), self.rig.baseline_m
        disparity, _ = RowSearch().disparity(left, right, found.features.uv)
        keep = disparity >= MIN_DISPARITY_PX
        features = sift.Features(found.features.uv[keep], found.features.descriptors[keep])
        xyz = points_from_disparity(camera, baseline, features.uv, disparity[keep])
        return Cloud(left, found.ids[keep], features, disparity[keep], xyz), keep

    def _pairs(self, reference: Cloud | None, cloud: Cloud) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices into the reference and into this cloud of the points that both have near enough to count."""
        if reference is None:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        _, old, new = np.intersect1d(reference.ids, cloud.ids, assume_unique=True, return_indices=True)
        depth = np.maximum(reference.xyz_in_left[old, 2], cloud.xyz_in_left[new, 2])
        limit = self.config.max_depth_baselines * self.rig.baseline_m
        near = depth <= limit
        for factor in (2, 4):
            if near.sum() < 3 * self.config.min_inliers:
                near = depth <= factor * limit
        return old[near], new[near]

    def _rigid_motion(
        self, reference: Cloud | None, cloud: Cloud, pairs: tuple[NDArray[np.int64], NDArray[np.int64]]
    ) -> RigidMotion | None:
        """reference_left_from_left, from the two clouds."""
        if reference is None:
            return None
        source, target = cloud.xyz_in_left[pairs[1]], reference.xyz_in_left[pairs[0]]
        per_px = self.config.inlier_disparity_px / (self.rig.camera("left").fx * self.rig.baseline_m)
        lateral = 2 * self.config.inlier_disparity_px / self.rig.camera("left").fx
        tolerance = per_px * (source[:, 2] ** 2 + target[:, 2] ** 2) + lateral * target[:, 2]
        return rigid_motion(source, target, tolerance)

    def _decide(
        self, state: StereoState, cloud: Cloud, pairs: tuple[NDArray, NDArray], motion: RigidMotion | None
    ) -> tuple[bool, tuple[Decision, ...]]:
        least = self.config.min_inliers
        points = checks.DEPTH_POINTS.of(len(cloud), least)
        if state.reference is None:
            return points.passed, (replace(points, consequence="the first pair is the world"),)
        inliers = 0 if motion is None else int(motion.inliers.sum())
        common = checks.COMMON_POINTS.of(len(pairs[0]), least)
        fitting = checks.RIGID_POINTS.of(inliers, least)
        afresh = state.lost_pairs + 1 > self.config.max_lost_pairs
        if not fitting.passed:
            then = "start afresh from the last known pose" if afresh else "keep the last located pair as reference"
            fitting = replace(fitting, consequence=f"not located; {then}")
        return fitting.passed, (points, common, fitting)

    def _locate(self, state: StereoState, motion: RigidMotion | None) -> Pose:
        if state.world_from_rig is None or motion is None:
            return state.world_from_rig or Pose()
        rig_from_left = self.rig.rig_from_left
        return state.world_from_rig @ rig_from_left @ motion.target_from_source @ rig_from_left.inverse()

    def _next_state(
        self, state: StereoState, time_ns: int, cloud: Cloud, world_from_rig: Pose | None, next_id: int
    ) -> StereoState:
        if world_from_rig is not None:
            return StereoState(cloud, world_from_rig, 0, next_id, state.poses.appended((time_ns, world_from_rig)))
        if state.lost_pairs + 1 > self.config.max_lost_pairs and len(cloud) >= self.config.min_inliers:
            return replace(state, reference=cloud, lost_pairs=0, next_id=next_id)
        return replace(state, lost_pairs=state.lost_pairs + 1, next_id=next_id)

    def _tracks(
        self,
        state: StereoState,
        found: Found,
        has_depth: NDArray[np.bool_],
        cloud: Cloud,
        pairs: tuple[NDArray, NDArray],
        motion: RigidMotion | None,
    ) -> Tracks:
        """What a person sees of this pair: its points, and those of the reference that were not found again."""
        reference = state.reference
        status = np.where(found.previous >= 0, TrackStatus.ALIVE, TrackStatus.NEW).astype(np.uint8)
        status[~has_depth] = TrackStatus.NO_DISPARITY
        residual = np.full(len(found.ids), np.nan, np.float32)
        disparity = np.full(len(found.ids), np.nan, np.float32)
        disparity[has_depth] = cloud.disparity_px
        if reference is None:
            return Tracks.of(found.ids, found.features.uv, status=status, disparity_px=disparity)
        uv_prev = np.full((len(found.ids), 2), np.nan, np.float32)
        known = found.previous >= 0
        uv_prev[known] = reference.features.uv[found.previous[known]]
        if motion is not None:
            place = np.flatnonzero(has_depth)[pairs[1]]
            moved = motion.target_from_source.inverse().apply(reference.xyz_in_left[pairs[0]])
            seen = self.rig.camera("left").project(moved)
            residual[place] = np.linalg.norm(seen - found.features.uv[place], axis=1)
            status[place[~motion.inliers]] = TrackStatus.RIGID
        gone = found.ended != TrackStatus.ALIVE
        return Tracks.of(
            np.concatenate([found.ids, reference.ids[gone]]),
            np.concatenate([found.features.uv, reference.features.uv[gone]]),
            status=np.concatenate([status, found.ended[gone]]),
            uv_prev=np.concatenate([uv_prev, reference.features.uv[gone]]),
            residual_px=np.concatenate([residual, np.full(gone.sum(), np.nan, np.float32)]),
            disparity_px=np.concatenate([disparity, np.full(gone.sum(), np.nan, np.float32)]),
        )

    def _landmarks(self, exposure: StereoPair, cloud: Cloud, world_from_rig: Pose | None) -> Landmarks:
        if world_from_rig is None:
            return Landmarks.empty()
        near = cloud.xyz_in_left[:, 2] <= self.config.max_depth_baselines * self.rig.baseline_m
        xyz = (world_from_rig @ self.rig.rig_from_left).apply(cloud.xyz_in_left[near])
        return Landmarks(cloud.ids[near], xyz, colours_at(exposure.left, cloud.features.uv[near]))


def _refined(reference: Cloud, left: Image, features: sift.Features, pairs: NDArray[np.int64]) -> sift.Features:
    """The features with matched ones moved to where the patch about their partner is found, if that is near."""
    detected = features.uv[pairs[:, 1]]
    found, status = REFINE.track(reference.grey, left, reference.features.uv[pairs[:, 0]], detected)
    near = (status == TrackStatus.ALIVE) & (np.linalg.norm(found - detected, axis=1) < MAX_REFINEMENT_PX)
    uv = features.uv.copy()
    uv[pairs[near, 1]] = found[near]
    return replace(features, uv=uv)


def _renamed(cloud: Cloud, used: NDArray[np.int64], motion: RigidMotion | None, next_id: int) -> tuple[Cloud, int]:
    """The cloud with new ids for the points that did not fit the motion (their tracks ended), and the next free id."""
    if motion is None:
        return cloud, next_id
    ids, outliers = cloud.ids.copy(), used[~motion.inliers]
    ids[outliers] = next_id + np.arange(len(outliers))
    return replace(cloud, ids=ids), next_id + len(outliers)


@dataclass(frozen=True, eq=False)
class Found:
    """Points of one left image, and how they go on from the reference."""

    grey: Image
    features: sift.Features
    ids: NDArray[np.int64]
    previous: NDArray[np.int64]
    """(N,) index in the reference cloud, or -1."""
    ended: NDArray[np.uint8]
    """Of each reference point: ALIVE where found again, or why not."""
    next_id: int
