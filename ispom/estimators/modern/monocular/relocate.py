"""Finding a frame again that tracking lost, and going on from there in the old place and unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import FEATURES, Keyframe
from ispom.estimators.modern.monocular.first_map import anchored_prior
from ispom.estimators.modern.monocular.localise import SURE, Localisation, located_by, set_right
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.recognise import Recognised, at_middle, recognised, resighted
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage
from ispom.estimators.modern.monocular.tracks import Followed, moving
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.features.images import has_contrast
from ispom.geometry import Array, Pose
from ispom.types import TrackStatus


def relocated(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage
) -> tuple[ModernMonocularState, Map, Localisation | None]:
    """The frame located from an image that shows what it shows, and the state and map in which it is; else None."""
    (last_ns, last), grey = state.recent[-1], state.live.grey
    if not setup.relocalise or grey is None or not has_contrast(new.grey, grey):
        return state, world, None
    moved = moving(setup.camera, state.live.uv, state.live.speed)
    newest = Keyframe.of(last_ns, last.inverse(), (grey,), None, moving=moved)
    before = (state.database.at(last_ns) or newest).described(setup.front_end.descriptor)
    now = setup.front_end.descriptor.detect_and_describe(new.grey, FEATURES)
    database, found = recognised(setup, state.database, world.extra, new, now, before, state.missed)
    state = replace(state, database=database)
    if found is None:
        return state, world, None
    found = resighted(setup, database, world, found)
    joint, grown, again = _by_points(setup, state, world, new, found)
    return (joint, grown, again) if again.count >= SURE else (state, world, None)


def _by_points(
    setup: Setup, state: ModernMonocularState, world: Map, new: NewImage, found: Recognised
) -> tuple[ModernMonocularState, Map, Localisation]:
    """By the tracks there are, where the pose puts them, and by what both images show besides."""
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
    """The tracks there are, found again by their patches where a pose puts them; which ones (N,) were compared."""
    lost = np.full(len(state.live.ids), TrackStatus.LOST, np.uint8)
    followed = Followed(state.live.uv, lost, np.zeros_like(state.live.uv))
    return set_right(setup, state.live, world, new, followed, world_from_camera, world.known(state.live.ids))


def joined(
    setup: Setup, state: ModernMonocularState, world: Map, found: Recognised
) -> tuple[ModernMonocularState, Map]:
    """The state and the map with what the frame and the key frames have in common as tracks, after those there are.

    Key frames that have left the window begin a new one, as sure of the first's pose as it was.
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
    live = replace(
        live,
        ids=np.concatenate([live.ids, ids]),
        uv=np.concatenate([live.uv, before.astype(np.float32)]),
        flow=np.concatenate([live.flow, np.zeros((count, 2), np.float32)]),
        speed=np.concatenate([live.speed, np.zeros((count, 2), np.float32)]),
        second=np.concatenate([live.second, np.zeros(count, bool)]),
        origin_ns=np.concatenate([live.origin_ns, np.full(count, place.time_ns)]),
        origin_uv=np.concatenate([live.origin_uv, before.astype(np.float32)]),
        next_id=live.next_id + count,
    )
    return replace(state, live=live), world


def _seeing(setup: Setup, key: TrackedFrame, ids: NDArray[np.int64], uv: Array) -> TrackedFrame:
    """A key frame with those of the points (N,) that it has at (N, 2) [px]."""
    has = np.isfinite(uv[:, 0])
    return key.with_new(ids[has], setup.camera.normalise(uv[has]))


def _from_places(setup: Setup, world: Map, found: Recognised) -> Map:
    """A window of the key frames found, without any points yet."""
    none = np.zeros(0, np.int64), np.zeros((0, 2))
    places = sorted((p for p, _ in found.views), key=lambda p: p.time_ns)
    poses = tuple(p.camera_from_world.inverse() for p in places)
    keys = tuple(TrackedFrame(p.time_ns, *none, pose) for p, pose in zip(places, poses, strict=True))
    known = np.zeros((6, 6)) if places[0].covariance is None else places[0].covariance
    # In the unit of the cost, in which a loss as wide as before any data stands for errors of `noise`.
    prior = anchored_prior(poses, world.extra_sigma, (world.loss / setup.noise) ** 2 * known, 0.0)
    return replace(world, keys=keys, points=ScenePoints(), prior=prior, relative_frames=())
