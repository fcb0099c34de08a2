"""Position and orientation from stereo cameras: section 6.2 of Li, Liu and Yuan (2013).

The steps, in the order of the paper and of this file (Fig. 5):

1. Consecutive left images are matched: {P(i-1,i)} are the points that the pairs i-1 and i share.
2. Left and right image are matched and triangulated: a point cloud for each pair.
3. R(i-1,i) and T(i-1,i) are the rigid transformation between the two clouds, in closed form. T is metric, so that "each
   time only two consecutive stereo pairs need computation", without scale transfer.

Differences from the print: the transformation is fitted in RANSAC, to points within `max_depth_baselines` of the
camera. A pair is compared with the last localised one, which is the one before it unless that was lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method, require_frame
from ispom.estimators.paper import checks
from ispom.features.interfaces import Features
from ispom.features.klt import Klt
from ispom.features.row_search import RowSearch
from ispom.features.shi_tomasi import detect_corners
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.solvers.rigid import RigidMotion, rigid_motion
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Frame,
    Image,
    Landmarks,
    Measurement,
    Rig,
    Status,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
    as_grey,
    colours_at,
)

Matching = Literal["sift", "klt"]
MATCHER = replace(SIFT_MATCHER, max_ratio=0.9**2)
"""Takes more of the ambiguous matches than usual: RANSAC finds the motion, and matches must fit it in depth, too."""
REFINE = Klt(window_px=15, levels=0, max_forward_backward_px=0.3)
"""A detector places the same point some tenths of a pixel differently in every image; this aligns it with the last."""
MAX_REFINEMENT_PX = 1.0
"""A detector's error is some tenths of a pixel: a refinement beyond this found another point."""
MIN_DISPARITY_PX = 1.0
"""Points with a smaller disparity are far; their depth is unknown."""
FARTHER = (2, 4)
"""Multiples of the depth limit used where too few points are nearer; farther away, one pixel of disparity is most of
a point's depth."""
ENOUGH = 3
"""Farther points are used with fewer near points than this multiple of the least number of inliers."""


@dataclass(frozen=True)
class StereoConfig:
    """Settings of the stereo estimator (section 6.2)."""

    matching: Annotated[Matching, WorthTrying(values=("sift", "klt"))] = "sift"
    """How consecutive left images are matched: descriptors bridge metres between pairs, tracking is faster."""
    max_points: Annotated[int, Range(50, 5000), WorthTrying((2, 0.5))] = 3000
    """Points described in each left image, with sift."""
    max_tracks: Annotated[int, Range(50, 5000), WorthTrying((2, 0.5))] = 1000
    """Points tracked into each left image, with klt."""
    max_depth_baselines: Annotated[float, Range(5, 500), WorthTrying((2, 0.5))] = 50.0
    """Points farther than this many baselines are excluded from the fit, which, unweighted, they would spoil;
    where too few are nearer, up to two and four times as far."""
    inlier_disparity_px: Annotated[float, Range(0.1, 10), WorthTrying((2,))] = 0.7
    """A point is an inlier of the rigid motion where its distance is within the depth error of this disparity error."""
    min_inliers: Annotated[int, Range(6, 500)] = 12
    """Least number of corresponding points; with fewer the pair is not localised."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last localised one before the next starts a new segment from the last pose."""

    def build(self, rig: Rig) -> Stereo:
        return Stereo(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Stereo:
    """Gives each stereo pair a metric pose from two consecutive pairs. World: the rig at the first pair."""

    rig: Rig
    config: StereoConfig

    def start(self) -> StereoState:
        return StereoState()

    def finish(self, state: StereoState) -> Trajectory:
        return Trajectory.of(list(state.poses))

    def step(self, state: StereoState, exposure: Measurement) -> tuple[StereoState, Step]:
        """Processes one stereo pair. Raises InputError for a video frame."""
        exposure = require_frame(exposure, STEREO, rig=self.rig)
        watch, reference, config = Stopwatch(), state.reference, self.config
        left, right = as_grey(exposure.left), as_grey(exposure.right)

        n_points = config.max_points if config.matching == "sift" else config.max_tracks
        matches = match_left_images(reference, left, config.matching, n_points, state.next_id)
        watch.lap("correspond")

        cloud, has_depth = triangulate_cloud(self.rig, left, right, matches)
        watch.lap("left-right")

        common = common_points(reference, cloud, self._depth_limit_m, config.min_inliers)
        motion = fit_motion(self.rig, reference, cloud, common, config.inlier_disparity_px)
        watch.lap("motion")

        is_localised, decisions = self._decide(state, cloud, common, motion)
        pose = self._moved(state, motion) if is_localised else None
        result = PairResult(
            matches=matches,
            has_depth=has_depth,
            cloud=cloud,
            common=common,
            motion=motion,
            world_from_rig=pose,
            decisions=decisions,
        )
        cloud, next_id = _with_new_ids(cloud, common, motion, matches.next_id)
        after = self._next_state(state, exposure.time_ns, cloud, pose, next_id)
        return after, as_step(self.rig, exposure, reference, result, cloud, self._depth_limit_m, watch.seconds)

    @property
    def _depth_limit_m(self) -> float:
        return self.config.max_depth_baselines * self.rig.baseline_m

    def _decide(
        self, state: StereoState, cloud: Cloud, common: CommonPoints, motion: RigidMotion | None
    ) -> tuple[bool, tuple[Decision, ...]]:
        """Returns whether the pair has a pose, and why."""
        least = self.config.min_inliers
        points = checks.DEPTH_POINTS.of(len(cloud), least)
        if state.reference is None:
            return points.passed, (replace(points, consequence="the first pair defines the world"),)
        inliers = 0 if motion is None else int(motion.inliers.sum())
        fits = checks.RIGID_POINTS.of(inliers, least)
        if not fits.passed:
            restarts = state.lost_pairs + 1 > self.config.max_lost_pairs
            then = (
                "a new segment starts from the last known pose"
                if restarts
                else "the last localised pair stays the reference"
            )
            fits = replace(fits, consequence=then)
        outliers = () if motion is None else (checks.RIGID_OUTLIERS.of(len(common) - inliers, len(common)),)
        return fits.passed, (points, checks.COMMON_POINTS.of(len(common), least), fits, *outliers)

    def _moved(self, state: StereoState, motion: RigidMotion | None) -> Pose:
        """Returns world_from_rig after the motion."""
        if state.world_from_rig is None or motion is None:
            return state.world_from_rig or Pose()
        rig_from_left = self.rig.rig_from_left
        return state.world_from_rig @ rig_from_left @ motion.target_from_source @ rig_from_left.inverse()

    def _next_state(
        self, state: StereoState, time_ns: int, cloud: Cloud, world_from_rig: Pose | None, next_id: int
    ) -> StereoState:
        """Makes a localised pair the reference, or, after too many lost ones, a pair with enough points."""
        if world_from_rig is not None:
            poses = state.poses.appended((time_ns, world_from_rig))
            return StereoState(cloud, world_from_rig, lost_pairs=0, next_id=next_id, poses=poses)
        if state.lost_pairs + 1 > self.config.max_lost_pairs and len(cloud) >= self.config.min_inliers:
            return replace(state, reference=cloud, lost_pairs=0, next_id=next_id)
        return replace(state, lost_pairs=state.lost_pairs + 1, next_id=next_id)


# State: what is kept from pair to pair


@dataclass(frozen=True, eq=False)
class Cloud:
    """The N points of one stereo pair, with the data to match them in the next left image."""

    grey: Image
    """The left image."""
    ids: NDArray[np.int64]
    features: Features
    disparity_px: NDArray[np.float32]
    xyz_in_left: Array
    """(N, 3) [m]."""

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class StereoState:
    """What is kept from pair to pair; `reference` and `world_from_rig` are those of the last localised pair."""

    reference: Cloud | None = None
    world_from_rig: Pose | None = None
    lost_pairs: int = 0
    next_id: int = 0
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
    """(time_ns, world_from_rig)."""


# Step 1: consecutive left images, {P(i-1,i)} of Fig. 5, by descriptors or by tracking


@dataclass(frozen=True, eq=False)
class Matches:
    """The N points of one left image, and their matches in the reference."""

    features: Features
    ids: NDArray[np.int64]
    previous: NDArray[np.int64]
    """(N,) index in the reference cloud, or -1."""
    ended: NDArray[np.uint8]
    """TrackStatus of each reference point: ALIVE where it was matched, or why not."""
    next_id: int


def match_left_images(
    reference: Cloud | None, left: Image, matching: Matching, max_points: int, next_id: int
) -> Matches:
    """Matches about `max_points` points of the left image with the reference; new points get ids from `next_id` on."""
    find = _match_descriptors if matching == "sift" else _track
    features, previous, ended = find(reference, left, max_points)
    known = previous >= 0
    ids = np.full(len(previous), -1, np.int64)
    if reference is not None:
        ids[known] = reference.ids[previous[known]]
    ids[~known] = next_id + np.arange((~known).sum())
    return Matches(features, ids, previous, ended, next_id + int((~known).sum()))


def _match_descriptors(
    reference: Cloud | None, left: Image, max_points: int
) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """Matches SIFT features and refines them. Points without descriptors, tracked before, are tracked once more."""
    features = SIFT.detect_and_describe(left, max_points)
    if reference is not None and not reference.features.described:
        return _track_and_add(reference, left, lambda _: features)
    previous = np.full(len(features), -1, np.int64)
    if reference is None:
        return features, previous, np.zeros(0, np.uint8)
    pairs, ended = MATCHER.match(reference.features, features), np.full(len(reference), TrackStatus.UNMATCHED, np.uint8)
    previous[pairs[:, 1]] = pairs[:, 0]
    ended[pairs[:, 0]] = TrackStatus.ALIVE
    return _refined(reference, left, features, pairs), previous, ended


def _track(
    reference: Cloud | None, left: Image, max_points: int
) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """Tracks the reference's points by KLT, and detects new corners between them."""

    def new_corners(uv: NDArray[np.float32]) -> Features:
        new = detect_corners(left, max_points - len(uv), uv)
        return Features(new, np.zeros((len(new), 0), np.float32))

    return _track_and_add(reference, left, new_corners)


def _track_and_add(
    reference: Cloud | None, left: Image, new_features: Callable[[NDArray[np.float32]], Features]
) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """Tracks the reference's points by KLT, and adds the features that `new_features` gives for their uv (M, 2)."""
    uv, ended, previous = np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.int64)
    if reference is not None:
        uv, ended = Klt(levels=4).track(reference.grey, left, reference.features.uv)
        previous = np.flatnonzero(ended == TrackStatus.ALIVE)
        uv = uv[previous]
    new = new_features(uv)
    return new.after(uv), np.concatenate([previous, np.full(len(new), -1, np.int64)]), ended


def _refined(reference: Cloud, left: Image, features: Features, pairs: NDArray[np.int64]) -> Features:
    """Aligns each matched feature with the patch around its match, unless that moves it far. `pairs` (M, 2)."""
    detected = features.uv[pairs[:, 1]]
    aligned, status = REFINE.track(reference.grey, left, reference.features.uv[pairs[:, 0]], detected)
    near = (status == TrackStatus.ALIVE) & (np.linalg.norm(aligned - detected, axis=1) < MAX_REFINEMENT_PX)
    uv = features.uv.copy()
    uv[pairs[near, 1]] = aligned[near]
    return replace(features, uv=uv)


# Step 2: left and right image, a point cloud in the left camera


def triangulate_cloud(rig: Rig, left: Image, right: Image, matches: Matches) -> tuple[Cloud, NDArray[np.bool_]]:
    """Matches the points along the rows of the right image; returns the cloud, and which (N,) points are in it."""
    disparity, _ = RowSearch().disparity(left, right, matches.features.uv)
    has_depth = disparity >= MIN_DISPARITY_PX
    features = matches.features[has_depth]
    xyz = points_from_disparity(rig.camera("left"), rig.baseline_m, features.uv, disparity[has_depth])
    return Cloud(left, matches.ids[has_depth], features, disparity[has_depth], xyz), has_depth


# Step 3: the rigid transformation R(i-1,i), T(i-1,i) between the clouds


@dataclass(frozen=True, eq=False)
class CommonPoints:
    """The K points that two clouds share and that are near enough to be used; indices (K,) into each."""

    reference: NDArray[np.int64]
    cloud: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cloud)


def common_points(reference: Cloud | None, cloud: Cloud, limit_m: float, min_inliers: int) -> CommonPoints:
    """Returns the shared points up to the depth `limit_m` in both clouds, or farther ones where those are too few."""
    if reference is None:
        return CommonPoints(np.zeros(0, np.int64), np.zeros(0, np.int64))
    _, old, new = np.intersect1d(reference.ids, cloud.ids, assume_unique=True, return_indices=True)
    depth = np.maximum(reference.xyz_in_left[old, 2], cloud.xyz_in_left[new, 2])
    near = depth <= limit_m
    for factor in FARTHER:
        if near.sum() < ENOUGH * min_inliers:
            near = depth <= factor * limit_m
    return CommonPoints(old[near], new[near])


def fit_motion(
    rig: Rig, reference: Cloud | None, cloud: Cloud, common: CommonPoints, inlier_disparity_px: float
) -> RigidMotion | None:
    """Fits reference_left_from_left in RANSAC; inliers are within the depth error of `inlier_disparity_px`.

    The depth Z = f b / d has the error Z^2 / (f b) per pixel of disparity.
    """
    if reference is None:
        return None
    source, target = cloud.xyz_in_left[common.cloud], reference.xyz_in_left[common.reference]
    per_px = inlier_disparity_px / (rig.camera("left").fx * rig.baseline_m)
    lateral = 2 * inlier_disparity_px / rig.camera("left").fx
    tolerance = per_px * (source[:, 2] ** 2 + target[:, 2] ** 2) + lateral * target[:, 2]
    return rigid_motion(source, target, tolerance)


def _with_new_ids(cloud: Cloud, common: CommonPoints, motion: RigidMotion | None, next_id: int) -> tuple[Cloud, int]:
    """Gives the outliers of the motion new ids, as their tracks ended; returns the next free id, too."""
    if motion is None:
        return cloud, next_id
    ids, outliers = cloud.ids.copy(), common.cloud[~motion.inliers]
    ids[outliers] = next_id + np.arange(len(outliers))
    return replace(cloud, ids=ids), next_id + len(outliers)


# The Step that reports the pair


@dataclass(frozen=True, eq=False)
class PairResult:
    """The results of all steps for one pair."""

    matches: Matches
    has_depth: NDArray[np.bool_]
    """(N,) of the matches' points."""
    cloud: Cloud
    common: CommonPoints
    motion: RigidMotion | None
    world_from_rig: Pose | None
    decisions: tuple[Decision, ...]


def as_step(
    rig: Rig,
    pair: Frame,
    reference: Cloud | None,
    result: PairResult,
    cloud: Cloud,
    depth_limit_m: float,
    seconds: Mapping[str, float],
) -> Step:
    """Reports the pair. `cloud` is that of the result with the ids that its points have from now on."""
    tracks, is_localised = _tracks(rig, reference, result), result.world_from_rig is not None
    residuals = tracks.residual_px[tracks.status == TrackStatus.ALIVE]
    no_pose = Status.INITIALISING if reference is None else Status.LOST
    return Step(
        pair.time_ns,
        Status.TRACKING if is_localised else no_pose,
        "rig",
        result.world_from_rig,
        key_frame=is_localised,
        tracks={"left": tracks},
        landmarks=_landmarks(rig, pair, cloud, result.world_from_rig, depth_limit_m),
        residuals_px=residuals[np.isfinite(residuals)],
        decisions=result.decisions,
        seconds=seconds,
    )


def _tracks(rig: Rig, reference: Cloud | None, result: PairResult) -> Tracks:
    """Returns the points of this pair, and those of the reference that were not matched."""
    matches, has_depth, motion, common = result.matches, result.has_depth, result.motion, result.common
    known, nan = matches.previous >= 0, np.full(len(matches.ids), np.nan, np.float32)
    status = np.where(known, TrackStatus.ALIVE, TrackStatus.NEW).astype(np.uint8)
    status[~has_depth] = TrackStatus.NO_DISPARITY
    residual, disparity = nan.copy(), nan.copy()
    disparity[has_depth] = result.cloud.disparity_px
    if reference is None:
        return Tracks.of(matches.ids, matches.features.uv, status=status, disparity_px=disparity)
    uv_prev = np.column_stack([nan, nan])
    uv_prev[known] = reference.features.uv[matches.previous[known]]
    if motion is not None:
        index = np.flatnonzero(has_depth)[common.cloud]
        xyz_in_left = motion.target_from_source.inverse().apply(reference.xyz_in_left[common.reference])
        projected = rig.camera("left").project(xyz_in_left)
        residual[index] = np.linalg.norm(projected - matches.features.uv[index], axis=1)
        status[index[~motion.inliers]] = TrackStatus.RIGID
    gone = matches.ended != TrackStatus.ALIVE
    unknown = np.full(gone.sum(), np.nan, np.float32)
    return Tracks.of(
        np.concatenate([matches.ids, reference.ids[gone]]),
        np.concatenate([matches.features.uv, reference.features.uv[gone]]),
        status=np.concatenate([status, matches.ended[gone]]),
        uv_prev=np.concatenate([uv_prev, reference.features.uv[gone]]),
        residual_px=np.concatenate([residual, unknown]),
        disparity_px=np.concatenate([disparity, unknown]),
    )


def _landmarks(rig: Rig, pair: Frame, cloud: Cloud, world_from_rig: Pose | None, limit_m: float) -> Landmarks:
    """Returns the points of the cloud up to the depth `limit_m`; none where the pair has no pose."""
    if world_from_rig is None:
        return Landmarks.empty()
    near = cloud.xyz_in_left[:, 2] <= limit_m
    xyz = (world_from_rig @ rig.rig_from_left).apply(cloud.xyz_in_left[near])
    return Landmarks(cloud.ids[near], xyz, colours_at(pair.left, cloud.features.uv[near]))


METHOD = Method(
    "stereo.paper",
    STEREO,
    StereoConfig,
    "metric",
    "Li, Liu and Yuan 2013, section 6.2",
    checks=checks.STEREO,
    stages=checks.STEREO_STAGES,
)
