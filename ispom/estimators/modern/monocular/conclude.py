"""Finishes a frame: detects new corners, builds the next state and the Step, and applies loop closures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.loops.checks import LOOP_SHIFT
from ispom.estimators.modern.loops.loops import KeyFrameSeen, Loops, seen_again
from ispom.estimators.modern.loops.output_correction import Correction, corrected_step, next_range
from ispom.estimators.modern.loops.relative_pose import FEATURES, DescribedPoints, LoopCamera
from ispom.estimators.modern.monocular.lost_frames import next_lost_frames
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.match_keyframes import FEATURE_ERROR
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import BeforeMap, ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import (
    LiveTracks,
    NewImage,
    TrackingResult,
    as_tracks,
    next_live_tracks,
    speeds_at,
    tracks_with_speeds,
)
from ispom.estimators.modern.rolling import late_px
from ispom.geometry import Pose
from ispom.types import (
    Corrections,
    Frame,
    Image,
    Landmarks,
    LensCorrection,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
    colours_at,
)

CORNER_DISTANCE = 0.011
"""Least distance of a new corner from other points, relative to the longer side of the image: 7 px at 640, half a
tracking window."""


def detect_new_corners(setup: Setup, outcome: Outcome, grey: Image) -> NDArray[np.float32]:
    """Detects new corners (N, 2) [px] between the live points, at a keyframe or at the reference of an
    initialisation."""
    at_reference = outcome.start is not None and len(outcome.start.frames) == 1
    if not (outcome.key_frame or at_reference):
        return np.zeros((0, 2), np.float32)
    alive = outcome.tracked.status == TrackStatus.ALIVE
    distance_px = CORNER_DISTANCE * setup.camera.longer_side_px
    return setup.front_end.detector.detect(grey, setup.max_tracks, outcome.tracked.uv[alive], distance_px)


def _late_px(setup: Setup, outcome: Outcome, new_uv: NDArray[np.float32]) -> NDArray[np.float32]:
    return late_px(setup.camera, new_uv, speeds_at(outcome.tracked, new_uv))


def next_state(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, image: NewImage, new_uv: NDArray[np.float32]
) -> ModernMonocularState:
    """Returns the next state, with the new corners in the map or the initialisation, and the live tracks."""
    local_map, start, live, rolling_tracks = outcome.map, outcome.start, state.live, state.rolling_tracks
    segments, segment = _segment(state, outcome)
    if len(new_uv):
        ids, late = live.next_id + np.arange(len(new_uv), dtype=np.int64), _late_px(setup, outcome, new_uv)
        x = setup.camera.normalise(new_uv - late)
        if local_map is not None:
            local_map = local_map.with_new_tracks(ids, x)
        elif start is not None:
            start = start.with_new_tracks(ids, x)
    if outcome.missed == 0:
        all_compared = np.ones(len(outcome.tracked.status), bool)
        compared = all_compared if outcome.compared is None else outcome.compared
        if setup.camera.line_delay_s:
            begun = state.start.rolling_tracks if state.start is not None and local_map is not None else ()
            rolling_tracks = (*begun, live.rolling_tracks)
        live = next_live_tracks(live, outcome.tracked, image.grey, new_uv, image.time_ns, compared)
    moved = [(image.time_ns, outcome.pose)] if outcome.pose is not None else []
    if state.map is None and local_map is not None:
        moved = sorted(local_map.trajectory(), key=lambda item: item[0])
    database = _database(setup, state.database, outcome, image, segment)
    # In another world the motion before the last pose is unknown.
    recent = moved if outcome.segment is not None else [*state.recent, *moved]
    return ModernMonocularState(
        live=live,
        rolling_tracks=rolling_tracks,
        start=start,
        map=local_map,
        recent=tuple(recent[-2:]),
        missed=outcome.missed,
        uncertainty=state.uncertainty if outcome.uncertainty is None else outcome.uncertainty,
        depth_sigmas=_depth_sigmas(setup, state, outcome),
        covariance=state.covariance if outcome.covariance is None else outcome.covariance,
        settled=state.settled.extended(outcome.settled),
        database=database,
        segments=segments,
        segment=segment,
        outlier_tracks=outcome.outlier_tracks,
        agreeing=() if state.map is None else state.agreeing,
        before_map=_before_map(state, outcome),
        lost_frames=next_lost_frames(setup, state, outcome, image),
        worlds=state.worlds,
    )


def _before_map(state: ModernMonocularState, outcome: Outcome) -> BeforeMap | None:
    """Returns the state before the map, while that may be taken back: once for each initialisation, so that a scene
    where no map agrees for long gets one, with warnings."""
    if outcome.map is None or state.map is not None:
        return state.before_map if outcome.map is not None else None
    if state.start is None or state.start.taken_back or outcome.segment is not None:
        return None
    return BeforeMap(replace(state.start, before_loss=None), state.settled, state.database, state.loops)


def _depth_sigmas(setup: Setup, state: ModernMonocularState, outcome: Outcome) -> tuple[float, ...]:
    if outcome.map is None or outcome.uncertainty is None:
        return () if outcome.map is None else state.depth_sigmas
    continues = state.start is None or (state.start.depth is not None and state.start.joined)
    before = state.depth_sigmas if continues and not outcome.restarted else ()
    return (*before, outcome.uncertainty.depth_sigma)[-setup.key_frames :]


def _segment(state: ModernMonocularState, outcome: Outcome) -> tuple[int, int]:
    """Returns, after a frame, the number of segments so far, and the segment in whose world the pose is."""
    if not outcome.restarted:
        return state.segments, state.segment
    return state.segments + 1, state.segments if outcome.segment is None else outcome.segment


def _database(
    setup: Setup, database: KeyframeDatabase, outcome: Outcome, image: NewImage, segment: int
) -> KeyframeDatabase:
    """Updates the poses of all keyframes, and adds a new one."""
    local_map, pose = outcome.map, outcome.pose
    if outcome.restarted and outcome.start is not None and outcome.start.lost is None:
        return KeyframeDatabase()
    if local_map is None or pose is None or not outcome.key_frame:
        return database
    known = {k.time_ns: p.inverse() for k, p in zip(local_map.keys, local_map.poses, strict=True)}
    alive = outcome.tracked.status == TrackStatus.ALIVE
    moved = tracks_with_speeds(setup.camera, outcome.tracked.uv[alive], outcome.tracked.speed[alive])
    depth_sigma = 0.0 if outcome.uncertainty is None else outcome.uncertainty.depth_sigma
    keyframe = Keyframe.of(
        image.time_ns,
        pose.inverse(),
        (image.grey,),
        outcome.covariance,
        moving=moved,
        segment=segment,
        depth_sigma=depth_sigma,
    )
    return database.with_poses(known).with_keyframe(keyframe)


def as_step(
    setup: Setup,
    before: ModernMonocularState,
    after: ModernMonocularState,
    outcome: Outcome,
    exposure: Frame,
    new_uv: NDArray[np.float32],
    seconds: Mapping[str, float],
) -> Step:
    """Returns the Step of a frame, from the states before and after it."""
    tracked, adjusted = outcome.tracked, outcome.uncertainty
    unknown = np.full(len(tracked.status), np.nan, np.float32)
    residual = unknown if outcome.residual_px is None else outcome.residual_px
    revised, landmarks = Trajectory.empty("video"), Landmarks.empty()
    if adjusted is not None and after.map is not None:
        landmarks = _landmarks(exposure, after.live, after.map)
        revised = Trajectory.of([*outcome.settled, *after.map.trajectory()], "video")
    return Step(
        exposure.time_ns,
        outcome.status,
        "video",
        outcome.pose,
        outcome.covariance,
        outcome.key_frame,
        {"video": as_tracks(before.live, tracked, residual, new_uv)},
        landmarks,
        residual[np.zeros(len(residual), bool) if outcome.inliers is None else outcome.inliers],
        revised,
        outcome.scale,
        seconds,
        outcome.decisions,
        restarted=outcome.restarted,
        segment_age_ns=0 if outcome.segment_from_ns is None else exposure.time_ns - outcome.segment_from_ns,
        joins=outcome.segment if outcome.restarted else None,
        scale_sigma=None if adjusted is None else adjusted.scale_sigma,
        calibration=_calibration(setup, after),
        other_motion=_other_motion(outcome),
    )


def _other_motion(outcome: Outcome) -> dict[str, Tracks]:
    """Returns the tracks of a second motion, if there is one."""
    return {"video": outcome.other_motion} if outcome.other_motion is not None and len(outcome.other_motion) else {}


def _calibration(setup: Setup, after: ModernMonocularState) -> Corrections:
    """Returns the corrections of the lens."""
    if after.map is None:
        return Corrections()
    known = after.uncertainty.lens if after.uncertainty is not None and after.uncertainty.lens.any() else None
    lens = LensCorrection.of(after.map.extra, known)
    return Corrections(lens=lens, noise=after.map.noise.as_image_noise(setup.noise.sigma))


def _landmarks(exposure: Frame, live: LiveTracks, local_map: Map) -> Landmarks:
    """Returns the landmarks that are still tracked."""
    xyz = local_map.known(live.ids)
    known = np.isfinite(xyz[:, 0])
    return Landmarks(live.ids[known], xyz[known], colours_at(exposure.image, live.uv[known]))


def close_loops(
    setup: Setup,
    before: ModernMonocularState,
    after: ModernMonocularState,
    outcome: Outcome,
    image: NewImage,
    step: Step,
) -> tuple[ModernMonocularState, Step]:
    """Updates the loops after a frame; returns the state, and the Step in the corrected world."""
    camera, key = LoopCamera.of(setup.camera, FEATURE_ERROR * setup.noise.sigma, setup.front_end.matcher), None
    if outcome.key_frame and after.map is not None:
        joined = outcome.segment is not None or (
            not outcome.restarted and (before.start is None or before.start.joined)
        )
        key = _seen_keyframe(setup, after, after.map, outcome, image.grey, joined)
    loops, decisions = seen_again(before.loops, camera, key, len(after.settled), setup.asked)
    joins = step.joins if loops.joins is None else loops.joins
    step = replace(step, decisions=(*step.decisions, *decisions), joins=joins)
    if loops.closed:
        loops, step = _correct_step(loops, after, step)
    return replace(after, loops=loops), step


def correct_by_loops(loops: Loops, poses: Trajectory) -> Trajectory:
    """Returns all poses, corrected by the loops."""
    return Correction.of(loops).of_trajectory(poses) if loops.closed else poses


def _correct_step(loops: Loops, after: ModernMonocularState, step: Step) -> tuple[Loops, Step]:
    loops, again = next_range(loops, len(after.settled))
    earlier = after.settled.part(again.start, again.stop)
    if after.map is not None and any(d.key == LOOP_SHIFT.key for d in step.decisions):
        earlier += after.map.trajectory()
    odometry, variance = None, 0.0 if after.uncertainty is None else after.uncertainty.scale_sigma**2
    if step.world_from_frame is not None and step.covariance is not None:
        odometry = step.world_from_frame, step.covariance, variance
    return loops, corrected_step(loops, step, earlier, odometry, Pose())


def _seen_keyframe(
    setup: Setup, after: ModernMonocularState, local_map: Map, outcome: Outcome, grey: Image, joined: bool
) -> KeyFrameSeen:
    """Returns the newest keyframe of the map."""
    window = dict(sorted((*outcome.settled, *local_map.trajectory()), key=lambda item: item[0]))
    newest, pose = local_map.keys[-1], local_map.poses[-1]
    variance = 0.0 if after.uncertainty is None else after.uncertainty.scale_sigma**2
    describe = partial(
        _describe, setup, Lens(setup.camera, local_map.extra), outcome.tracked, grey, local_map.median_depth
    )
    return KeyFrameSeen(newest.time_ns, pose, outcome.covariance, variance, window, describe, joined, after.segment)


def _describe(setup: Setup, lens: Lens, tracked: TrackingResult, grey: Image, depth: float) -> DescribedPoints:
    """Describes a keyframe. With a rolling shutter, features are moved to the time of the middle row, with the
    velocities of the nearest tracks."""
    found = setup.front_end.descriptor.detect_and_describe(grey, FEATURES)
    uv = found.uv - late_px(lens.camera, found.uv, speeds_at(tracked, found.uv))
    return DescribedPoints.of(grey, lens.normalise(uv), found, depth=depth)
