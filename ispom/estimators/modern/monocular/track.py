"""Tracks features into the new image, starting from the positions that the motion model predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState
from ispom.estimators.modern.monocular.tracks import (
    NO_POINTS,
    LiveTracks,
    MovedPoints,
    NewImage,
    TrackingResult,
)
from ispom.estimators.modern.rolling import Flow, Speeds, late_px
from ispom.features.images import as_bright, has_contrast
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array, Pose
from ispom.numerics.reductions import both, squares
from ispom.numerics.twist import twist_of
from ispom.types import Image, TrackStatus

COASTING_S = 2.0
"""Time constant [s] of the decay: a vehicle's speed changes on that scale."""
COASTING_SHARE = 0.5
"""Standard deviation of an unobserved motion, as a share of it."""
MAX_FEATURES, MIN_MATCHES = 1000, 15
"""Number of features compared when tracking failed, and least number of matches: as many as for a pose."""


def predict_pose(recent: tuple[tuple[int, Pose], ...], time_ns: int) -> Pose:
    """Predicts world_from_camera with the decaying velocity of the last two poses."""
    (before_ns, before), (last_ns, last) = recent[0], recent[-1]
    if before_ns == last_ns:
        return last
    share = COASTING_S * -np.expm1(-(time_ns - last_ns) * 1e-9 / COASTING_S) / ((last_ns - before_ns) * 1e-9)
    return last @ Pose.exp(twist_of(before.inverse() @ last) * share)


def predict_covariance(covariance: Array, before_from_now: Pose) -> Array:
    """Returns the covariance of a predicted pose, from that of the last estimated one, with an error of COASTING_SHARE
    of the motion."""
    adjoint = before_from_now.inverse().adjoint
    way, turn = np.linalg.norm(before_from_now.translation), np.linalg.norm(before_from_now.rotvec)
    return adjoint @ covariance @ adjoint.T + np.diag(
        [(COASTING_SHARE * way) ** 2] * 3 + [(COASTING_SHARE * turn) ** 2] * 3
    )


def track_features(
    setup: Setup,
    live: LiveTracks,
    time_ns: int,
    grey: Image,
    predicted: NDArray[np.float32] | None = None,
    others: MovedPoints = NO_POINTS,
) -> TrackingResult:
    """Tracks points from their predicted positions: `predicted` (N, 2) [px], or constant velocity.

    `others` are tracked in the same call, as building the images' pyramids takes most of the time.

    Without a prediction, points are checked forward and backward; with one the check follows in `align_with_map`.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids):
        return TrackingResult(live.uv, np.full(len(live.ids), TrackStatus.LOST, np.uint8), live.speed)
    bright = as_bright(grey, live.grey)
    front_end, camera = setup.front_end, setup.camera
    tracker, expected = (front_end.tracker, live.uv + live.flow) if predicted is None else (front_end.guided, predicted)
    starts, goals = np.concatenate([live.uv, others.before]), np.concatenate([expected, others.now])
    uv, status = tracker.track(live.grey, bright, starts, goals)
    n = len(live.uv)
    others, uv, status = MovedPoints(others.before, uv[n:], status[n:]), uv[:n], status[:n]
    if not camera.line_delay_s:
        return TrackingResult(uv, status, live.speed, others=others, bright=bright)
    last = Flow(uv - live.uv, (time_ns - live.time_ns) * 1e-9)
    speeds = Speeds.of(camera, last, Flow(live.flow, (live.time_ns - live.before_ns) * 1e-9))
    alive = (status == TrackStatus.ALIVE)[:, None]
    return TrackingResult(
        uv, status, np.where(alive, speeds.now, live.speed).astype(np.float32), speeds, others, bright
    )


def with_corrected_coordinates(
    setup: Setup, state: ModernMonocularState, tracked: TrackingResult
) -> ModernMonocularState:
    """Corrects the stored coordinates of the last two images by the motion after them, if the shutter is rolling.

    In the image before the last one, these are the tracks new in it; in the last one, all others.
    """
    if tracked.speeds is None:
        return state
    camera, live = setup.camera, state.live
    alive, moved = tracked.status == TrackStatus.ALIVE, live.flow.any(axis=1)
    first, last = alive & live.second & (live.origin_ns == live.before_ns), alive & moved
    old = live.origin_uv[first] - late_px(camera, live.origin_uv[first], tracked.speeds.before[first])
    uv = live.uv[last] - late_px(camera, live.uv[last], tracked.speeds.last[last])
    state = state.with_updated_coordinates(live.before_ns, live.ids[first], camera.normalise(old))
    return state.with_updated_coordinates(live.time_ns, live.ids[last], camera.normalise(uv))


def predict_by_features(front_end: FrontEnd, live: LiveTracks, grey: Image) -> NDArray[np.float32] | None:
    """Predicts positions (N, 2) [px] after a jump: each point moves like the nearest feature matched in both images.

    None for too few matches.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids) or not has_contrast(grey, live.grey):
        return None
    before, now = (front_end.descriptor.detect_and_describe(each, MAX_FEATURES) for each in (live.grey, grey))
    pairs = front_end.matcher.match(before, now)
    if len(pairs) < MIN_MATCHES:
        return None
    at, motion = before.uv[pairs[:, 0]], now.uv[pairs[:, 1]] - before.uv[pairs[:, 0]]
    nearest = ((live.uv[:, None] - at[None]) ** 2).sum(axis=2).argmin(axis=1)
    return (live.uv + motion[nearest]).astype(np.float32)


def scene_points(lens: Lens, uv: NDArray[np.float32], xyz_in_world: Array, world_from_camera: Pose) -> Array:
    """Returns scene points (N, 3) observed at uv (N, 2) [px]; unknown ones (NaN) get the depth of the nearest known
    point in the image.

    All are NaN if none is known.
    """
    depth = world_from_camera.inverse().apply(xyz_in_world)[:, 2]
    known, unknown = np.flatnonzero(depth > 0), np.flatnonzero(~(depth > 0))
    if not len(known):
        return np.full((len(uv), 3), np.nan)
    if len(unknown):
        near = uv[known].astype(float)
        nearness = uv[unknown] @ near.T - 0.5 * squares(near)  # largest for the nearest
        depth[unknown] = depth[known[np.argmax(nearness, axis=1)]]
    ray = np.column_stack([lens.normalise(uv), np.ones(len(uv))])
    return world_from_camera.apply(ray * depth[:, None])


def project_points(
    lens: Lens, xyz_in_world: Array, world_from_camera: Pose, otherwise: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Projects points (N, 3) to pixels (N, 2); `otherwise` for points without a projection."""
    uv = lens.project(world_from_camera.inverse().apply(xyz_in_world))
    near = both(np.abs(uv) < 1e5)  # False for NaN
    return np.where(near[:, None], uv, otherwise).astype(np.float32)


def track(setup: Setup, state: ModernMonocularState, time_ns: int, grey: Image) -> NewImage:
    """Tracks all features into the new image; with a map, starts from the positions that the motion model predicts."""
    live = state.live
    if state.map is None:
        tracked = track_features(setup, live, time_ns, grey)
        return NewImage(time_ns, grey, None, tracked, np.full((len(live.ids), 3), np.nan))
    predicted, lens = predict_pose(state.recent, time_ns), Lens(setup.camera, state.map.extra)
    late = late_px(setup.camera, live.uv, live.speed)
    scene = scene_points(lens, live.uv - late, state.map.known(live.ids), state.recent[-1][1])
    expected = project_points(lens, scene, predicted, live.uv - late) + late
    tracked = track_features(setup, live, time_ns, grey, expected, state.outlier_tracks.expected)
    return NewImage(time_ns, grey, predicted, tracked, scene)
