"""Relocalises a lost frame, and continues in the old world and scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import FEATURES, Keyframe
from ispom.estimators.modern.monocular.localise import SURE, Localisation, located_by, set_right
from ispom.estimators.modern.monocular.map import Map, views
from ispom.estimators.modern.monocular.recognise import Recognised, at_middle, recognised, resighted
from ispom.estimators.modern.monocular.setup import LOSS, Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage
from ispom.estimators.modern.monocular.tracks import Followed, LiveTracks, moving
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.features.images import has_contrast
from ispom.geometry import Array, Pose
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich
from ispom.types import TrackStatus

HELD_SHARE = 1e-3
"""Standard deviation of the first keyframe's pose where it is the world, relative to a track's noise: small, but large
enough for the numerics."""


@dataclass(frozen=True, eq=False)
class Relocated:
    """A relocalised frame, with the state and the map in which it is localised."""

    state: ModernMonocularState
    map: Map
    found: Localisation
    segment: int
    """The segment of the matched keyframe."""


def relocated(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage
) -> tuple[ModernMonocularState, Relocated | None]:
    """Relocalises the frame in the last localised image and in keyframes; the returned state has the new
    descriptions."""
    (last_ns, last), grey = state.recent[-1], state.live.grey
    if not setup.relocalise or grey is None or not has_contrast(new.grey, grey):
        return state, None
    moved = moving(setup.camera, state.live.uv, state.live.speed)
    newest = Keyframe.of(last_ns, last.inverse(), (grey,), None, moving=moved, segment=state.segment)
    before = (state.database.at(last_ns) or newest).described(setup.front_end.descriptor)
    return _relocated(setup, state, world, new, before, state.missed)


def relocated_after_loss(
    setup: Setup, state: ModernMonocularState, new: NewImage
) -> tuple[ModernMonocularState, Relocated | None]:
    """Relocalises a frame in the keyframes of earlier segments, before the new map exists."""
    start, live = state.start, state.live
    if start is None or start.lost is None or not setup.relocalise or not state.database.keyframes:
        return state, None
    if live.grey is None or not has_contrast(new.grey, live.grey):
        return state, None
    # Tracks since the loss, and guessed poses, belong to the map that was being initialised.
    none = LiveTracks(live.grey, before_ns=live.before_ns, time_ns=live.time_ns, next_id=live.next_id)
    other = replace(state, live=none, settled=state.settled.extended(start.held if start.joined else ()))
    new = replace(new, scene=np.zeros((0, 3)))
    before, found = _relocated(setup, other, start.lost, new, None, len(start.frames))
    return replace(state, database=before.database), found


def _relocated(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, before: Keyframe | None, turn: int
) -> tuple[ModernMonocularState, Relocated | None]:
    now = setup.front_end.descriptor.detect_and_describe(new.grey, FEATURES)
    database, found = recognised(setup, state.database, world.extra, new, now, before, turn)
    state = replace(state, database=database)
    if found is None:
        return state, None
    found = resighted(setup, database, world, found)
    joint, grown, again = _by_points(setup, state, world, new, found)
    place, _ = found.views[-1]
    return state, Relocated(joint, grown, again, place.segment) if again.count >= SURE else None


def _by_points(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, found: Recognised
) -> tuple[ModernMonocularState, Map, Localisation]:
    """Localises by the existing tracks, searched with the pose, and by the matched features."""
    tracked, compared = _tracks_at(setup, state, world, new, found.world_from_camera)
    joint, grown = joined(setup, state, world, found)
    count = len(found.uv)
    followed = Followed(
        np.concatenate([tracked.uv, found.uv]),
        np.concatenate([tracked.status, np.full(count, TrackStatus.ALIVE, np.uint8)]),
        np.concatenate([tracked.speed, np.zeros((count, 2), np.float32)]),
    )
    again = located_by(setup, joint.live, grown, followed, found.world_from_camera)
    return joint, grown, replace(again, compared=np.concatenate([compared, np.zeros(count, bool)]))


def _tracks_at(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, world_from_camera: Pose
) -> tuple[Followed, NDArray[np.bool_]]:
    """Searches the existing tracks by their patches with a pose; also returns which (N,) were compared."""
    lost = np.full(len(state.live.ids), TrackStatus.LOST, np.uint8)
    followed = Followed(state.live.uv, lost, np.zeros_like(state.live.uv))
    return set_right(setup, state.live, world, new, followed, world_from_camera, world.known(state.live.ids))


def joined(
    setup: Setup, state: ModernMonocularState, world: Map, found: Recognised
) -> tuple[ModernMonocularState, Map]:
    """Adds the features that the frame and the keyframes share as tracks, after the existing ones, and as points.

    Keyframes that have left the window form a new one, with the covariance that the first of them had.
    """
    live, count = state.live, len(found.uv)
    ids = live.next_id + np.arange(count, dtype=np.int64)
    place, _ = found.views[-1]
    if not {p.time_ns for p, _ in found.views} & {k.time_ns for k in world.keys}:
        state = replace(state, settled=state.settled.extended(world.trajectory()))
        world = _from_places(setup, world, found)
    seen = {p.time_ns: at_middle(setup, p, uv) for p, uv in found.views}
    keys = tuple(_seeing(setup, k, ids, seen[k.time_ns]) if k.time_ns in seen else k for k in world.keys)
    world = replace(world, keys=keys, points=world.points.merged(ScenePoints(ids, found.xyz)))
    _, before = found.views[-1]
    live = live.with_new(before.astype(np.float32), place.time_ns)
    return replace(state, live=live), world


def _seeing(setup: Setup, key: TrackedFrame, ids: NDArray[np.int64], uv: Array) -> TrackedFrame:
    """Adds those of the points (N,) to a keyframe that it observes, at (N, 2) [px]."""
    has = np.isfinite(uv[:, 0])
    return key.with_new(ids[has], setup.camera.normalise(uv[has]))


def _from_places(setup: Setup, world: Map, found: Recognised) -> Map:
    """Returns a window of the matched keyframes, without points."""
    none = np.zeros(0, np.int64), np.zeros((0, 2))
    places = sorted((p for p, _ in found.views), key=lambda p: p.time_ns)
    poses = tuple(p.camera_from_world.inverse() for p in places)
    keys = tuple(TrackedFrame(p.time_ns, *none, pose) for p, pose in zip(places, poses, strict=True))
    known = np.zeros((6, 6)) if places[0].covariance is None else places[0].covariance
    near = places[-1].camera_from_world.apply(found.xyz)
    # In the units of the cost, a loss as wide as initially corresponds to errors of `noise`.
    sigma = setup.noise.sigma
    widened, depth = world.loss / sigma, float(np.median(near[:, 2]))
    prior = prior_of_keyframes(poses, world.extra_sigma, widened**2 * known, widened * sigma, depth)
    return replace(world, keys=keys, points=ScenePoints(), prior=prior, relative_frames=())


def prior_of_keyframes(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, sigma: float, depth: float) -> Prior:
    """Returns a prior that fixes keyframes relative to each other, as optimised before: they define the scale.

    Args:
        poses: world_from_camera of each.
        extra_sigma: (2,) prior standard deviations of the lens correction; 0 fixes it.
        first: (6, 6) covariance of the first pose, left twist of camera_from_world.
        sigma: of a track, normalised: that of each rotation [rad] relative to the first, and, times `depth`, position.
        depth: of the points that they observe.
    """
    rotations, translations = views(poses)
    size = POSE * len(poses) + LENS
    hessian = np.zeros((size, size))
    hessian[:POSE, :POSE] = np.linalg.inv(
        first + sigma**2 * np.diag([(HELD_SHARE * depth) ** 2] * 3 + [HELD_SHARE**2] * 3)
    )
    information = np.diag([(sigma * depth) ** -2.0] * 3 + [sigma**-2.0] * 3)
    for i, pose in enumerate(poses[1:], 1):
        moved = np.zeros((POSE, size))
        moved[:, POSE * i : POSE * (i + 1)] = np.eye(POSE)
        moved[:, :POSE] = -(pose.inverse() @ poses[0]).adjoint
        hessian += moved.T @ information @ moved
    hessian[size - LENS :, size - LENS :] = np.diag(np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0)
    sandwich = Sandwich(hessian, hessian / LOSS**2)
    return Prior(rotations, translations, np.zeros(LENS), hessian, np.zeros(size), sandwich=sandwich)
