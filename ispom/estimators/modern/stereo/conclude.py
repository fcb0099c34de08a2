"""Makes the next state and the Step from the outcome of a stereo frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.stereo.key_frame import Current
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.pair import TrackingResult
from ispom.estimators.modern.stereo.rolling_window import with_pair
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome
from ispom.estimators.modern.stereo.window import newest_covariance
from ispom.estimators.tracked_frame import MOST_SHOWN_PX
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR
from ispom.types import Corrections, Frame, Landmarks, PairCorrection, Step, Tracks, TrackStatus, Trajectory, colours_at


def next_state(
    setup: Setup,
    before: ModernStereoState,
    state: ModernStereoState,
    now: Current,
    sighting: TrackingResult,
    is_key: bool,
) -> ModernStereoState:
    """Returns the next state. Tracking started from `before`; `state` has the map after this frame."""
    newest, last, new = state.map.keys[-1], before.last, now.new
    # A start from the prediction keeps the predicted motion, which is unknown if it was unknown before.
    unknown = last.left is None or (sighting.located is None and last.motion_s <= 0)
    following = LastPair(
        new.left,
        new.left if is_key else last.key_left,
        new.half if is_key else last.key_half,
        now.points,
        new.time_ns,
        now.pose,
        Pose() if unknown else now.pose @ last.left_from_world.inverse(),
        0.0 if unknown else (new.time_ns - last.time_ns) * 1e-9,
        _covariance(setup, state, now, sighting, is_key),
    )
    relative = (new.time_ns, newest.time_ns, now.pose @ newest.left_from_world.inverse())
    database = _with_keyframe(state, now) if is_key else state.database
    return replace(state, last=following, lost_pairs=0, poses=state.poses.appended(relative), database=database)


def _with_keyframe(state: ModernStereoState, now: Current) -> KeyframeDatabase:
    """Returns the database with this keyframe, and with the current poses of those in the window."""
    here = (now.new.left, now.new.right)
    keyframe = Keyframe.of(now.new.time_ns, now.pose, here, newest_covariance(state.map), now.motion)
    return state.database.with_poses({k.time_ns: k.left_from_world for k in state.map.keys}).with_keyframe(keyframe)


def _covariance(
    setup: Setup, state: ModernStereoState, now: Current, sighting: TrackingResult, is_key: bool
) -> Array | None:
    """Returns the covariance (6, 6) of left_from_world, as a left twist."""
    world = state.map
    if not is_key and sighting.located is not None and world.newest is not None:
        pair = now.as_key(setup, now.points)
        world = with_pair(setup, world, pair)
    return newest_covariance(world)


def as_step(setup: Setup, exposure: Frame, outcome: Outcome) -> Step:
    """Returns the Step of an outcome, without the durations of its stages."""
    sighting, after, has_pose = outcome.sighting, outcome.after, outcome.before is not None
    residual = np.full(len(sighting.status), np.nan, np.float32)
    if sighting.located is not None:
        pixels = sighting.located.distances * setup.camera.fx
        residual[sighting.took_part] = np.minimum(pixels, MOST_SHOWN_PX)
    pose, covariance = None, None
    if has_pose:
        pose = after.last.left_from_world.inverse() @ setup.left_from_rig
        covariance = _in_rig(setup, after.last.covariance)
    return Step(
        exposure.time_ns,
        outcome.status,
        "rig",
        pose,
        covariance,
        outcome.key_frame,
        {"left": _tracks(outcome, residual)},
        _landmarks(exposure, after) if outcome.key_frame else Landmarks.empty(),
        residual[np.isfinite(residual) & (sighting.status == TrackStatus.ALIVE)],
        _revised(setup, after) if outcome.key_frame else Trajectory.empty(),
        decisions=outcome.decisions,
        restarted=outcome.restarted,
        calibration=_calibration(setup, after),
        other_motion={} if outcome.other_motion is None else {"left": outcome.other_motion},
    )


def _calibration(setup: Setup, after: ModernStereoState) -> Corrections:
    """Returns the corrections of the pair."""
    whole = after.map.covariance if setup.self_calibration else None
    pair = PairCorrection.of(after.map.extra, None if whole is None else whole[-PAIR:, -PAIR:])
    noise = after.map.noise.as_image_noise(setup.noise.sigma)
    return Corrections(pair=pair, noise=noise, pair_motion=after.last.rate)


def _in_rig(setup: Setup, covariance: Array | None) -> Array | None:
    """Returns the covariance (6, 6) of world_from_rig (right twist) from that of left_from_world (left twist).

    left_from_world grows by exp(d) on the left: world_from_rig by exp(-Ad(rig_from_left) d) on the right.
    """
    adjoint = setup.rig_from_left.adjoint
    return None if covariance is None else adjoint @ covariance @ adjoint.T


def _tracks(outcome: Outcome, residual: NDArray[np.float32]) -> Tracks:
    """Returns all tracks with their status, and the new ones; none if the frame has no pose."""
    if outcome.before is None:
        return Tracks.of(np.zeros(0), np.zeros((0, 2)))
    sighting, fresh = outcome.sighting, outcome.fresh
    old, new = outcome.before.last.points, outcome.after.last.points
    count, last = len(sighting.status), len(new) - fresh
    ended = (sighting.status != TrackStatus.ALIVE) & (sighting.status < TrackStatus.EPIPOLAR)
    uv = np.where(ended[:, None], old.uv[:count], sighting.uv)
    nan = np.full((fresh, 2), np.nan, np.float32)
    return Tracks.of(
        np.concatenate([old.ids[:count], new.ids[last:]]),
        np.concatenate([uv, new.uv[last:]]),
        uv_prev=np.concatenate([old.uv[:count], nan]),
        status=np.concatenate([sighting.status, np.full(fresh, TrackStatus.NEW, np.uint8)]),
        residual_px=np.concatenate([residual, nan[:, 0]]),
        disparity_px=np.concatenate([sighting.disparity_px, new.disparity_px[last:]]),
    )


def _landmarks(exposure: Frame, after: ModernStereoState) -> Landmarks:
    points = after.last.points
    xyz = after.map.xyz[after.map.places(points.ids)]
    return Landmarks(points.ids, xyz, colours_at(exposure.left, points.uv))


def _revised(setup: Setup, after: ModernStereoState) -> Trajectory:
    """Returns world_from_rig of the keyframes before the newest one."""
    return Trajectory.of([(k.time_ns, k.left_from_world.inverse() @ setup.left_from_rig) for k in after.map.keys[:-1]])
