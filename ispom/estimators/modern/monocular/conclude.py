"""Finishes a frame: detects new corners, and builds the next state and the Step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import BeforeMap, ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import LiveTracks, as_tracks, moving, next_live_tracks, speed_where
from ispom.estimators.modern.rolling import late_px
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


def corners_for(setup: Setup, outcome: Outcome, grey: Image) -> NDArray[np.float32]:
    """Detects new corners (N, 2) [px] between the live points, at a keyframe or at the reference of an
    initialisation."""
    at_reference = outcome.start is not None and len(outcome.start.frames) == 1
    if not (outcome.key_frame or at_reference):
        return np.zeros((0, 2), np.float32)
    alive = outcome.followed.status == TrackStatus.ALIVE
    distance_px = CORNER_DISTANCE * setup.camera.longer_side_px
    return setup.front_end.detector.detect(grey, setup.max_tracks, outcome.followed.uv[alive], distance_px)


def _late(setup: Setup, outcome: Outcome, fresh: NDArray[np.float32]) -> NDArray[np.float32]:
    return late_px(setup.camera, fresh, speed_where(outcome.followed, fresh))


def next_state(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, new: NewImage, fresh: NDArray[np.float32]
) -> ModernMonocularState:
    """Returns the next state, with the new corners in the map or the initialisation, and the live tracks."""
    world, start, live, sights = outcome.map, outcome.start, state.live, state.sights
    segments, segment = _segment(state, outcome)
    if len(fresh):
        ids, late = live.next_id + np.arange(len(fresh), dtype=np.int64), _late(setup, outcome, fresh)
        x = setup.camera.normalise(fresh - late)
        if world is not None:
            world = world.with_new_tracks(ids, x)
        elif start is not None:
            start = start.with_new_tracks(ids, x)
    if outcome.missed == 0:
        all_compared = np.ones(len(outcome.followed.status), bool)
        compared = all_compared if outcome.compared is None else outcome.compared
        if setup.camera.line_delay_s:
            begun = state.start.sights if state.start is not None and world is not None else ()
            sights = (*begun, live.sight)
        live = next_live_tracks(live, outcome.followed, new.grey, fresh, new.time_ns, compared)
    moved = [(new.time_ns, outcome.pose)] if outcome.pose is not None else []
    if state.map is None and world is not None:
        moved = sorted(world.trajectory(), key=lambda item: item[0])
    database = _database(setup, state.database, outcome, new, segment)
    # In another world the motion before the last pose is unknown.
    recent = moved if outcome.segment is not None else [*state.recent, *moved]
    return ModernMonocularState(
        live=live,
        sights=sights,
        start=start,
        map=world,
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
    )


def _before_map(state: ModernMonocularState, outcome: Outcome) -> BeforeMap | None:
    """Returns the state before the map, while that may be taken back: once for each initialisation, so that a scene
    where no map agrees for long gets one, with warnings."""
    if outcome.map is None or state.map is not None:
        return state.before_map if outcome.map is not None else None
    if state.start is None or state.start.taken_back or outcome.segment is not None:
        return None
    return BeforeMap(state.start, state.settled, state.database, state.loops)


def _depth_sigmas(setup: Setup, state: ModernMonocularState, outcome: Outcome) -> tuple[float, ...]:
    if outcome.map is None or outcome.restarted:
        return ()
    new = () if outcome.uncertainty is None else (outcome.uncertainty.depth_sigma,)
    return (*state.depth_sigmas, *new)[-setup.key_frames :]


def _segment(state: ModernMonocularState, outcome: Outcome) -> tuple[int, int]:
    """Returns, after a frame, the number of segments so far, and the segment in whose world the pose is."""
    if not outcome.restarted:
        return state.segments, state.segment
    return state.segments + 1, state.segments if outcome.segment is None else outcome.segment


def _database(
    setup: Setup, database: KeyframeDatabase, outcome: Outcome, new: NewImage, segment: int
) -> KeyframeDatabase:
    """Updates the poses of all keyframes, and adds a new one."""
    world, pose = outcome.map, outcome.pose
    if outcome.restarted and outcome.start is not None and outcome.start.lost is None:
        return KeyframeDatabase()
    if world is None or pose is None or not outcome.key_frame:
        return database
    known = {k.time_ns: p.inverse() for k, p in zip(world.keys, world.poses, strict=True)}
    alive = outcome.followed.status == TrackStatus.ALIVE
    moved = moving(setup.camera, outcome.followed.uv[alive], outcome.followed.speed[alive])
    return database.with_poses(known).with_keyframe(
        Keyframe.of(new.time_ns, pose.inverse(), (new.grey,), outcome.covariance, moving=moved, segment=segment)
    )


def as_step(
    setup: Setup,
    before: ModernMonocularState,
    after: ModernMonocularState,
    outcome: Outcome,
    exposure: Frame,
    fresh: NDArray[np.float32],
    seconds: Mapping[str, float],
) -> Step:
    """Returns the Step of a frame, from the states before and after it."""
    followed, adjusted = outcome.followed, outcome.uncertainty
    unknown = np.full(len(followed.status), np.nan, np.float32)
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
        {"video": as_tracks(before.live, followed, residual, fresh)},
        landmarks,
        residual[np.zeros(len(residual), bool) if outcome.inliers is None else outcome.inliers],
        revised,
        outcome.scale,
        seconds,
        outcome.decisions,
        restarted=outcome.restarted,
        joins=outcome.segment,
        scale_sigma=None if adjusted is None else adjusted.scale_sigma,
        calibration=_calibration(setup, after),
        other_motion=_told(outcome),
    )


def _told(outcome: Outcome) -> dict[str, Tracks]:
    """Returns the tracks of a second motion, if there is one."""
    return {"video": outcome.other_motion} if outcome.other_motion is not None and len(outcome.other_motion) else {}


def _calibration(setup: Setup, after: ModernMonocularState) -> Corrections:
    """Returns the corrections of the lens."""
    if after.map is None:
        return Corrections()
    known = after.uncertainty.lens if after.uncertainty is not None and after.uncertainty.lens.any() else None
    lens = LensCorrection.of(after.map.extra, known)
    return Corrections(lens=lens, noise=after.map.noise.as_image_noise(setup.noise.sigma))


def _landmarks(exposure: Frame, live: LiveTracks, world: Map) -> Landmarks:
    """Returns the landmarks that are still tracked."""
    xyz = world.known(live.ids)
    known = np.isfinite(xyz[:, 0])
    return Landmarks(live.ids[known], xyz[known], colours_at(exposure.image, live.uv[known]))
