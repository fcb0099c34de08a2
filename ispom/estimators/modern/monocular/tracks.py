"""The live tracks of the monocular estimator, and following them into the next frame where the motion puts them."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.frontends.exposure import as_bright
from ispom.frontends.klt import Klt
from ispom.frontends.patches import align, warps_of
from ispom.frontends.sift import detect_and_describe, match
from ispom.geometry import Array, Pose
from ispom.types import Image, Tracks, TrackStatus


@dataclass(frozen=True, eq=False)
class Live:
    """Points alive in the last image that could be tracked."""

    grey: Image | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px]."""
    flow: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] motion into that image; 0 where new."""
    origin_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) the image of `origins` whose patch each point is compared with: that of its first sight, mostly."""
    origin_uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] in that image."""
    origins: tuple[tuple[int, Image], ...] = ()
    """By time, those in use."""
    next_id: int = 0


@dataclass(frozen=True, eq=False)
class Followed:
    """The same points in a new image."""

    uv: NDArray[np.float32]
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""


GUIDED, UNGUIDED, BACK = Klt(levels=3, max_forward_backward_px=np.inf), Klt(levels=5), Klt(levels=1)
MIN_CORRELATION = 0.8
"""A patch that is found again looks at least so much like its origin."""
MAX_SHIFT_PX = 3.0
"""Alignment with the origin corrects tracking by no more."""
MIN_WARP, MAX_WARP = 0.35, 1.8
"""Change of area, origin per image, within which the patch of the origin can be used."""
MIN_CONTRAST = 0.2
"""Of the coarse image, over that of the last good one: less shows nothing."""
FEATURES, MIN_FEATURES = 1000, 15
"""How many are compared where tracking lost its way, and how many must agree."""


def follow(live: Live, grey: Image, predicted: NDArray[np.float32] | None) -> Followed:
    """Pyramidal KLT, from where each point is expected: `predicted` (N, 2) [px], else its last motion continued.

    Without a prediction checked forward and backward; with one the check follows, in `realigned`.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids):
        return Followed(live.uv, np.full(len(live.ids), TrackStatus.LOST, np.uint8))
    grey = as_bright(grey, live.grey)
    klt = UNGUIDED if predicted is None else GUIDED
    return Followed(*klt.track(live.grey, grey, live.uv, live.uv + live.flow if predicted is None else predicted))


def shows_something(grey: Image, other: Image | None) -> bool:
    """Whether the image has contrast beyond its noise, compared with another one."""
    if other is None:
        return True
    now, before = (
        float(cv2.resize(g, None, fx=1 / 8, fy=1 / 8, interpolation=cv2.INTER_AREA).std()) for g in (grey, other)
    )
    return now > MIN_CONTRAST * before


def displaced(live: Live, grey: Image) -> NDArray[np.float32] | None:
    """Where points (N, 2) [px] may be after a jump: each moves with the nearest feature that both images show.

    None where the images have too little in common.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids) or not shows_something(grey, live.grey):
        return None
    before, now = detect_and_describe(live.grey, FEATURES), detect_and_describe(grey, FEATURES)
    pairs = match(before, now, 0.8)
    if len(pairs) < MIN_FEATURES:
        return None
    at, motion = before.uv[pairs[:, 0]], now.uv[pairs[:, 1]] - before.uv[pairs[:, 0]]
    nearest = ((live.uv[:, None] - at[None]) ** 2).sum(axis=2).argmin(axis=1)
    return (live.uv + motion[nearest]).astype(np.float32)


def guessed(lens: Lens, uv: NDArray[np.float32], xyz_in_world: Array, world_from_camera: Pose) -> Array:
    """Scene points (N, 3) seen at uv (N, 2) [px]: the known ones, and for NaN at the depth of the nearest known one.

    Nearest in the image. All NaN where none is known.
    """
    depth = world_from_camera.inverse().apply(xyz_in_world)[:, 2]
    known, unknown = np.flatnonzero(depth > 0), np.flatnonzero(~(depth > 0))
    if not len(known):
        return np.full((len(uv), 3), np.nan)
    if len(unknown):
        near = uv[known].astype(float)
        nearness = uv[unknown] @ near.T - 0.5 * (near**2).sum(axis=1)  # the nearest has the largest
        depth[unknown] = depth[known[np.argmax(nearness, axis=1)]]
    ray = np.column_stack([lens.normalise(uv), np.ones(len(uv))])
    return world_from_camera.apply(ray * depth[:, None])


def projected(
    lens: Lens, xyz_in_world: Array, world_from_camera: Pose, otherwise: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Places (N, 2) [px] of points (N, 3); `otherwise` where they have none."""
    uv = lens.project(world_from_camera.inverse().apply(xyz_in_world))
    ok = np.asarray(np.isfinite(uv).all(axis=1) & (np.abs(uv) < 1e5).all(axis=1))
    return np.where(ok[:, None], uv, otherwise).astype(np.float32)


def realigned(
    lens: Lens,
    live: Live,
    grey: Image,
    followed: Followed,
    expected: NDArray[np.float32],
    scene: Array,
    pose: Pose,
    origins: dict[int, Pose],
) -> tuple[Followed, NDArray[np.bool_]]:
    """Each point where its patch of origin, warped as the scene (N, 3) says, fits best; which ones (N,) were compared.

    Looked for around `expected` (N, 2) [px]. `pose` of the image, and `origins` by time: world_from_camera. What does
    not look like its origin is lost; what cannot be compared is checked forward and backward.
    """
    uv, status = followed.uv.copy(), followed.status.copy()
    in_camera = pose.inverse().apply(scene)
    height, width = grey.shape
    inside = np.asarray((expected >= 6) & (expected < (width - 7, height - 7))).all(axis=1)
    usable = [(time_ns, image) for time_ns, image in live.origins if time_ns in origins]
    of = np.searchsorted([t for t, _ in usable], live.origin_ns)
    of[~np.isin(live.origin_ns, [t for t, _ in usable])] = -1
    mine = np.flatnonzero((of >= 0) & inside & (in_camera[:, 2] > 0))
    motions = [origins[time_ns].inverse() @ pose for time_ns, _ in usable]
    compared = np.zeros(len(uv), bool)
    if len(mine):
        turns, ways = np.stack([m.rotation for m in motions]), np.stack([m.translation for m in motions])
        warps = warps_of(lens.camera, turns[of[mine]], ways[of[mine]], in_camera[mine])
        area = np.abs(warps[:, 0, 0] * warps[:, 1, 1] - warps[:, 0, 1] * warps[:, 1, 0])
        fit = (area > MIN_WARP) & (area < MAX_WARP)
        mine, warps = mine[fit], warps[fit]
        found, score = np.empty((len(mine), 2)), np.empty(len(mine))
        for i in np.unique(of[mine]).tolist():
            at = of[mine] == i
            found[at], score[at] = align(usable[i][1], live.origin_uv[mine[at]], grey, expected[mine[at]], warps[at])
        good = (score > MIN_CORRELATION) & (np.linalg.norm(found - expected[mine], axis=1) < MAX_SHIFT_PX)
        uv[mine[good]] = found[good]
        status[mine[~good & (status[mine] == TrackStatus.ALIVE)]] = TrackStatus.LOST
        status[mine[good]] = TrackStatus.ALIVE
        compared[mine] = True
    other = np.flatnonzero(~compared & (status == TrackStatus.ALIVE))
    if len(other) and live.grey is not None:
        uv[other], status[other] = BACK.track(live.grey, as_bright(grey, live.grey), live.uv[other], uv[other])
    return Followed(uv, status), compared


def as_tracks(live: Live, followed: Followed, residual_px: NDArray[np.float32], fresh: NDArray[np.float32]) -> Tracks:
    """What a Step shows: all points followed, with what became of them, and the fresh ones."""
    n, status = len(fresh), followed.status
    seen = (status == TrackStatus.ALIVE) | (status >= TrackStatus.EPIPOLAR)
    return Tracks.of(
        np.concatenate([live.ids, live.next_id + np.arange(n)]),
        np.concatenate([np.where(seen[:, None], followed.uv, live.uv), fresh]),
        uv_prev=np.concatenate([live.uv, np.full((n, 2), np.nan, np.float32)]),
        status=np.concatenate([status, np.full(n, TrackStatus.NEW, np.uint8)]),
        residual_px=np.concatenate([residual_px, np.full(n, np.nan, np.float32)]),
    )


def renewed(
    live: Live, followed: Followed, grey: Image, fresh: NDArray[np.float32], time_ns: int, compared: NDArray[np.bool_]
) -> Live:
    """Those alive in the new image, and the fresh ones.

    At a key frame (where there are fresh ones) points that could not be compared with their origin get a new one.
    """
    alive, n = followed.status == TrackStatus.ALIVE, len(fresh)
    origin_ns, origin_uv = live.origin_ns.copy(), live.origin_uv.copy()
    if n:
        origin_ns[~compared], origin_uv[~compared] = time_ns, followed.uv[~compared]
    origin_ns = np.concatenate([origin_ns[alive], np.full(n, time_ns)])
    used = set(np.unique(origin_ns).tolist())
    images = (*live.origins, (time_ns, grey))
    return Live(
        grey,
        np.concatenate([live.ids[alive], live.next_id + np.arange(n, dtype=np.int64)]),
        np.concatenate([followed.uv[alive], fresh]),
        np.concatenate([(followed.uv - live.uv)[alive], np.zeros((n, 2), np.float32)]),
        origin_ns,
        np.concatenate([origin_uv[alive], fresh]),
        tuple(item for item in images if item[0] in used),
        live.next_id + n,
    )
