"""Stereo (section 6.2): left/right matches, a point cloud each, the rigid transformation between consecutive clouds.

Where this differs from the print: the motion is fitted in RANSAC, to points within `max_depth_baselines` of the camera;
a pair is compared with the last one that was located, which is the one before it unless that was lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ispom.estimators.paper import checks
from ispom.estimators.paper.stereo.conclude import Outcome, as_step
from ispom.estimators.paper.stereo.correspondence import Matching, correspondences, triangulated
from ispom.estimators.paper.stereo.rigid_transformation import CommonPoints, common_points, transformation
from ispom.estimators.paper.stereo.state import Cloud, StereoState
from ispom.geometry import Pose
from ispom.settings import Range
from ispom.solvers.rigid import RigidMotion
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Exposure, Rig, Step, StereoPair, Trajectory, as_grey


@dataclass(frozen=True)
class StereoConfig:
    """Settings of the stereo estimator (section 6.2)."""

    matching: Matching = "sift"
    """How consecutive left images correspond: descriptors survive metres between pairs, tracking is faster."""
    max_points: Annotated[int, Range(50, 5000)] = 3000
    """Points described in each left image, with sift."""
    max_tracks: Annotated[int, Range(50, 5000)] = 1000
    """Points tracked into each left image, with klt."""
    max_depth_baselines: Annotated[float, Range(5, 500)] = 50.0
    """Points farther than this many baselines are excluded from the fit, which, unweighted, they would spoil;
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
        watch, reference, config = Stopwatch(), state.reference, self.config
        left, right = as_grey(exposure.left), as_grey(exposure.right)
        most = config.max_points if config.matching == "sift" else config.max_tracks
        found = correspondences(reference, left, config.matching, most, state.next_id)
        watch.lap("correspond")
        cloud, has_depth = triangulated(self.rig, left, right, found)
        watch.lap("left-right")
        common = common_points(reference, cloud, self._depth_limit_m, config.min_inliers)
        motion = transformation(self.rig, reference, cloud, common, config.inlier_disparity_px)
        watch.lap("motion")
        located, decisions = self._decide(state, cloud, common, motion)
        world_from_rig = self._moved(state, motion) if located else None
        outcome = Outcome(found, has_depth, cloud, common, motion, world_from_rig, decisions)
        cloud, next_id = _with_new_ids(cloud, common, motion, found.next_id)
        after = self._next_state(state, exposure.time_ns, cloud, world_from_rig, next_id)
        return after, as_step(self.rig, exposure, reference, outcome, cloud, self._depth_limit_m, watch.seconds)

    @property
    def _depth_limit_m(self) -> float:
        return self.config.max_depth_baselines * self.rig.baseline_m

    def _decide(
        self, state: StereoState, cloud: Cloud, common: CommonPoints, motion: RigidMotion | None
    ) -> tuple[bool, tuple[Decision, ...]]:
        """Whether the pair has a pose, and why."""
        least = self.config.min_inliers
        points = checks.DEPTH_POINTS.of(len(cloud), least)
        if state.reference is None:
            return points.passed, (replace(points, consequence="the first pair defines the world"),)
        inliers = 0 if motion is None else int(motion.inliers.sum())
        fitting = checks.RIGID_POINTS.of(inliers, least)
        if not fitting.passed:
            afresh = state.lost_pairs + 1 > self.config.max_lost_pairs
            then = (
                "a new segment starts from the last known pose"
                if afresh
                else "the last localised pair stays the reference"
            )
            fitting = replace(fitting, consequence=then)
        outliers = () if motion is None else (checks.RIGID_OUTLIERS.of(len(common) - inliers, len(common)),)
        return fitting.passed, (points, checks.COMMON_POINTS.of(len(common), least), fitting, *outliers)

    def _moved(self, state: StereoState, motion: RigidMotion | None) -> Pose:
        """world_from_rig after the motion."""
        if state.world_from_rig is None or motion is None:
            return state.world_from_rig or Pose()
        rig_from_left = self.rig.rig_from_left
        return state.world_from_rig @ rig_from_left @ motion.target_from_source @ rig_from_left.inverse()

    def _next_state(
        self, state: StereoState, time_ns: int, cloud: Cloud, world_from_rig: Pose | None, next_id: int
    ) -> StereoState:
        """A located pair is the next reference; so is, after too many lost ones, one that has enough points."""
        if world_from_rig is not None:
            return StereoState(cloud, world_from_rig, 0, next_id, state.poses.appended((time_ns, world_from_rig)))
        if state.lost_pairs + 1 > self.config.max_lost_pairs and len(cloud) >= self.config.min_inliers:
            return replace(state, reference=cloud, lost_pairs=0, next_id=next_id)
        return replace(state, lost_pairs=state.lost_pairs + 1, next_id=next_id)


def _with_new_ids(cloud: Cloud, common: CommonPoints, motion: RigidMotion | None, next_id: int) -> tuple[Cloud, int]:
    """The cloud with new ids for the points that did not fit the motion (their tracks ended), and the next free id."""
    if motion is None:
        return cloud, next_id
    ids, outliers = cloud.ids.copy(), common.cloud[~motion.inliers]
    ids[outliers] = next_id + np.arange(len(outliers))
    return replace(cloud, ids=ids), next_id + len(outliers)
