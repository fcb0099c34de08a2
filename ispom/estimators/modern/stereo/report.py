"""Ends a frame: makes the next state, with the frame's covariance, and the Step that reports it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.stereo.level import as_given
from ispom.estimators.modern.stereo.localise import LocalisedFrame
from ispom.estimators.modern.stereo.pair import Setup, TrackingResult
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.rolling_window import rolling_with_frame_covariance
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome
from ispom.estimators.modern.stereo.window import with_frame_covariance
from ispom.estimators.tracked_frame import MOST_SHOWN_PX
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR
from ispom.types import Corrections, Frame, Landmarks, PairCorrection, Step, Tracks, TrackStatus, Trajectory, colours_at


def next_state(
    setup: Setup, state: ModernStereoState, frame: LocalisedFrame, tracked: TrackingResult, is_key: bool
) -> ModernStereoState:
    """Returns the state after a localised frame; as a keyframe it is in the map already."""
    newest, last, images = state.map.keys[-1], state.last, frame.images
    # A start from the prediction keeps the predicted motion, which is unknown if it was unknown before.
    unknown = last.left is None or (tracked.located is None and last.motion_s <= 0)
    pose = frame.left_from_world
    following = LastPair(
        images.left,
        images.left if is_key else last.key_left,
        images.half if is_key else last.key_half,
        frame.points,
        images.time_ns,
        pose,
        Pose() if unknown else pose @ last.left_from_world.inverse(),
        0.0 if unknown else (images.time_ns - last.time_ns) * 1e-9,
        _covariance(setup, state, frame, tracked, is_key),
    )
    relative = (images.time_ns, newest.time_ns, pose @ newest.left_from_world.inverse())
    database = _with_keyframe(state, frame) if is_key else state.database
    return replace(state, last=following, lost_pairs=0, poses=state.poses.appended(relative), database=database)


def _with_keyframe(state: ModernStereoState, frame: LocalisedFrame) -> KeyframeDatabase:
    """Returns the database with this keyframe, and with the current poses of those in the window."""
    images = (frame.images.left, frame.images.right)
    keyframe = Keyframe.of(
        frame.images.time_ns, frame.left_from_world, images, state.map.newest_covariance, frame.motion
    )
    return state.database.with_poses({k.time_ns: k.left_from_world for k in state.map.keys}).with_keyframe(keyframe)


def _covariance(
    setup: Setup, state: ModernStereoState, frame: LocalisedFrame, tracked: TrackingResult, is_key: bool
) -> Array | None:
    """Returns the covariance (6, 6) of left_from_world, as a left twist."""
    world = state.map
    if not is_key and tracked.located is not None and world.newest is not None:
        key = frame.as_key(setup, frame.points)
        world = (rolling_with_frame_covariance if setup.rolls else with_frame_covariance)(setup, world, key)
    return world.newest_covariance


def as_step(setup: Setup, measured: Frame, outcome: Outcome) -> Step:
    """Returns the Step of an outcome, without the durations of its stages."""
    tracked, state, has_pose = outcome.tracked, outcome.state, outcome.tracked_points is not None
    residual = np.full(len(tracked.status), np.nan, np.float32)
    if tracked.located is not None:
        pixels = tracked.located.distances * setup.camera.fx
        residual[tracked.took_part] = np.minimum(pixels, MOST_SHOWN_PX)
    pose, covariance = None, None
    if has_pose:
        pose = state.last.left_from_world.inverse() @ setup.left_from_rig
        covariance = _in_rig(setup, state.last.covariance)
    return Step(
        measured.time_ns,
        outcome.status,
        "rig",
        pose,
        covariance,
        outcome.keyframe,
        {"left": _tracks(setup, outcome, residual)},
        _landmarks(measured, state) if outcome.keyframe else Landmarks.empty(),
        residual[np.isfinite(residual) & (tracked.status == TrackStatus.ALIVE)],
        _revised(setup, state) if outcome.keyframe else Trajectory.empty(),
        decisions=outcome.decisions,
        restarted=outcome.restarted,
        calibration=_calibration(setup, state),
        other_motion={} if outcome.other_motion is None else {"left": outcome.other_motion},
    )


def _calibration(setup: Setup, state: ModernStereoState) -> Corrections:
    """Returns the corrections of the pair."""
    whole = state.map.covariance if setup.self_calibration else None
    pair = PairCorrection.of(state.map.corrected(state.level).extra, None if whole is None else whole[-PAIR:, -PAIR:])
    noise = state.map.noise.as_image_noise(setup.noise.sigma)
    return Corrections(pair=pair, noise=noise, pair_motion=state.last.rate)


def _in_rig(setup: Setup, covariance: Array | None) -> Array | None:
    """Returns the covariance (6, 6) of world_from_rig (right twist) from that of left_from_world (left twist).

    left_from_world grows by exp(d) on the left: world_from_rig by exp(-Ad(rig_from_left) d) on the right.
    """
    adjoint = setup.rig_from_left.adjoint
    return None if covariance is None else adjoint @ covariance @ adjoint.T


def _tracks(setup: Setup, outcome: Outcome, residual: NDArray[np.float32]) -> Tracks:
    """Returns all tracks with their status, and the new ones; none if the frame has no pose."""
    old, now, tracked = outcome.tracked_points, outcome.state.last.points, outcome.tracked
    if old is None:
        return Tracks.of(np.zeros(0), np.zeros((0, 2)))
    count, new = len(tracked.status), slice(len(now) - outcome.new_points, len(now))
    ended = (tracked.status != TrackStatus.ALIVE) & (tracked.status < TrackStatus.EPIPOLAR)
    uv = np.where(ended[:, None], old.uv[:count], tracked.uv)
    nan = np.full((outcome.new_points, 2), np.nan, np.float32)
    both, disparity = np.concatenate([uv, now.uv[new]]), np.concatenate([tracked.disparity_px, now.disparity_px[new]])
    return Tracks.of(
        np.concatenate([old.ids[:count], now.ids[new]]),
        both,
        uv_prev=np.concatenate([old.uv[:count], nan]),
        status=np.concatenate([tracked.status, np.full(outcome.new_points, TrackStatus.NEW, np.uint8)]),
        residual_px=np.concatenate([residual, nan[:, 0]]),
        disparity_px=as_given(setup, outcome.state.level, both, disparity),
    )


def _landmarks(measured: Frame, state: ModernStereoState) -> Landmarks:
    points = state.last.points
    xyz = state.map.xyz[state.map.places(points.ids)]
    return Landmarks(points.ids, xyz, colours_at(measured.left, points.uv))


def _revised(setup: Setup, state: ModernStereoState) -> Trajectory:
    """Returns world_from_rig of the keyframes before the newest one."""
    return Trajectory.of([(k.time_ns, k.left_from_world.inverse() @ setup.left_from_rig) for k in state.map.keys[:-1]])
