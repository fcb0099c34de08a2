"""The live tracks of the monocular estimator, and their tracking into the next frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.rolling import Flow, Sight, Speeds, late_px
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.features.images import as_bright, has_contrast
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array, Pose
from ispom.numerics.reductions import both, squares
from ispom.types import Camera, Image, Tracks, TrackStatus


@dataclass(frozen=True, eq=False)
class LiveTracks:
    """Live tracks in the last image with tracking."""

    grey: Image | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ids, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] positions."""
    flow: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] motion into that image; 0 for new tracks."""
    before_ns: int = 0
    """Time of the image from which they moved."""
    speed: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px/s] velocities in that image; 0 for a global shutter."""
    time_ns: int = 0
    second: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    """(N,) which were new in the image before."""
    origin_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) time of the image in `origins` with the patch of each track: mostly that of its first observation."""
    origin_uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] positions in that image."""
    origins: tuple[tuple[int, Image], ...] = ()
    """Images in use, ordered by time."""
    next_id: int = 0

    def with_new(self, uv: NDArray[np.float32], origin_ns: int) -> LiveTracks:
        """Adds new tracks at (M, 2) [px] in an image of this time."""
        count, still = len(uv), np.zeros((len(uv), 2), np.float32)
        return replace(
            self,
            ids=np.concatenate([self.ids, self.next_id + np.arange(count, dtype=np.int64)]),
            uv=np.concatenate([self.uv, uv]),
            flow=np.concatenate([self.flow, still]),
            speed=np.concatenate([self.speed, still]),
            second=np.concatenate([self.second, np.zeros(count, bool)]),
            origin_ns=np.concatenate([self.origin_ns, np.full(count, origin_ns)]),
            origin_uv=np.concatenate([self.origin_uv, uv]),
            next_id=self.next_id + count,
        )

    def only(self, keep: NDArray[np.bool_]) -> LiveTracks:
        """Returns the tracks of the mask `keep` (N,)."""
        return replace(
            self,
            ids=self.ids[keep],
            uv=self.uv[keep],
            flow=self.flow[keep],
            speed=self.speed[keep],
            second=self.second[keep],
            origin_ns=self.origin_ns[keep],
            origin_uv=self.origin_uv[keep],
        )

    @property
    def sight(self) -> Sight:
        """The observations in the last image."""
        return Sight(self.time_ns, self.ids, self.uv)


@dataclass(frozen=True, eq=False)
class Moved:
    """Other points to track, from one image to their predicted or found positions in the next."""

    before: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(M, 2) [px] positions in the first image."""
    now: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(M, 2) [px] positions in the second one."""
    status: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(M,) TrackStatus, once tracked."""


@dataclass(frozen=True, eq=False)
class Followed:
    """The tracks in a new image."""

    uv: NDArray[np.float32]
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    speed: NDArray[np.float32]
    """(N, 2) [px/s] velocities in it; 0 for a global shutter."""
    speeds: Speeds | None = None
    """Velocities in the last images, as known now; None for a global shutter."""
    others: Moved = Moved()
    """Other points that were tracked too."""
    bright: Image | None = None
    """The new image with the brightness of the last one; None if nothing was tracked."""


FEATURES, MIN_FEATURES = 1000, 15
"""Number of features compared when tracking failed, and least number of matches: as many as for a pose."""


def follow(
    front_end: FrontEnd,
    camera: Camera,
    live: LiveTracks,
    time_ns: int,
    grey: Image,
    predicted: NDArray[np.float32] | None,
    others: Moved = Moved(),
) -> Followed:
    """Tracks points from their predicted positions: `predicted` (N, 2) [px], or constant velocity.

    `others` are tracked in the same call, as building the images' pyramids takes most of the time.

    Without a prediction, points are checked forward and backward; with one the check follows in `realign.realigned`.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids):
        return Followed(live.uv, np.full(len(live.ids), TrackStatus.LOST, np.uint8), live.speed)
    bright = as_bright(grey, live.grey)
    tracker, expected = (front_end.tracker, live.uv + live.flow) if predicted is None else (front_end.guided, predicted)
    starts, goals = np.concatenate([live.uv, others.before]), np.concatenate([expected, others.now])
    uv, status = tracker.track(live.grey, bright, starts, goals)
    n = len(live.uv)
    others, uv, status = Moved(others.before, uv[n:], status[n:]), uv[:n], status[:n]
    if not camera.line_delay_s:
        return Followed(uv, status, live.speed, others=others, bright=bright)
    last = Flow(uv - live.uv, (time_ns - live.time_ns) * 1e-9)
    speeds = Speeds.of(camera, last, Flow(live.flow, (live.time_ns - live.before_ns) * 1e-9))
    alive = (status == TrackStatus.ALIVE)[:, None]
    return Followed(uv, status, np.where(alive, speeds.now, live.speed).astype(np.float32), speeds, others, bright)


def updated_coordinates(
    camera: Camera, live: LiveTracks, followed: Followed
) -> tuple[tuple[int, NDArray[np.int64], Array], ...]:
    """Returns coordinates of the last two images at the time of the middle row, corrected by the motion after them:
    time, ids (K,), and normalised coordinates (K, 2). Empty for a global shutter.

    For the image before the last one, these are the tracks new in it; for the last one, all others.
    """
    if followed.speeds is None:
        return ()
    alive, moved = followed.status == TrackStatus.ALIVE, live.flow.any(axis=1)
    first, last = alive & live.second & (live.origin_ns == live.before_ns), alive & moved
    old = live.origin_uv[first] - late_px(camera, live.origin_uv[first], followed.speeds.before[first])
    uv = live.uv[last] - late_px(camera, live.uv[last], followed.speeds.last[last])
    return (
        (live.before_ns, live.ids[first], camera.normalise(old)),
        (live.time_ns, live.ids[last], camera.normalise(uv)),
    )


def displaced_by_features(front_end: FrontEnd, live: LiveTracks, grey: Image) -> NDArray[np.float32] | None:
    """Predicts positions (N, 2) [px] after a jump: each point moves like the nearest feature matched in both images.

    None for too few matches.
    """
    if live.grey is None or live.grey.shape != grey.shape or not len(live.ids) or not has_contrast(grey, live.grey):
        return None
    before, now = (front_end.descriptor.detect_and_describe(image, FEATURES) for image in (live.grey, grey))
    pairs = front_end.matcher.match(before, now)
    if len(pairs) < MIN_FEATURES:
        return None
    at, motion = before.uv[pairs[:, 0]], now.uv[pairs[:, 1]] - before.uv[pairs[:, 0]]
    nearest = ((live.uv[:, None] - at[None]) ** 2).sum(axis=2).argmin(axis=1)
    return (live.uv + motion[nearest]).astype(np.float32)


def unrolled(camera: Camera, tracks: LiveTracks | Followed) -> NDArray[np.float32]:
    """Returns positions (N, 2) [px] as if all rows had been exposed with the middle one."""
    return tracks.uv - late_px(camera, tracks.uv, tracks.speed)


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


def projected(
    lens: Lens, xyz_in_world: Array, world_from_camera: Pose, otherwise: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Projects points (N, 3) to pixels (N, 2); `otherwise` for points without a projection."""
    uv = lens.project(world_from_camera.inverse().apply(xyz_in_world))
    near = both(np.abs(uv) < 1e5)  # False for NaN
    return np.where(near[:, None], uv, otherwise).astype(np.float32)


def moving(
    camera: Camera, uv: NDArray[np.float32], speed: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Returns the tracks (N, 2) [px] and speeds [px/s] that a Keyframe stores; None for a global shutter."""
    return (uv, speed) if camera.line_delay_s else None


def tracked_frame(camera: Camera, live: LiveTracks, followed: Followed, time_ns: int) -> TrackedFrame:
    """Returns the live tracks in the new image."""
    alive = followed.status == TrackStatus.ALIVE
    return TrackedFrame(time_ns, live.ids[alive], camera.normalise(unrolled(camera, followed)[alive]))


def as_tracks(
    live: LiveTracks, followed: Followed, residual_px: NDArray[np.float32], fresh: NDArray[np.float32]
) -> Tracks:
    """Returns the tracks for the Step: all that were tracked, with their status, and the new ones."""
    n, status = len(fresh), followed.status
    seen = (status == TrackStatus.ALIVE) | (status >= TrackStatus.EPIPOLAR)
    return Tracks.of(
        np.concatenate([live.ids, live.next_id + np.arange(n)]),
        np.concatenate([np.where(seen[:, None], followed.uv, live.uv), fresh]),
        uv_prev=np.concatenate([live.uv, np.full((n, 2), np.nan, np.float32)]),
        status=np.concatenate([status, np.full(n, TrackStatus.NEW, np.uint8)]),
        residual_px=np.concatenate([residual_px, np.full(n, np.nan, np.float32)]),
    )


def speed_where(followed: Followed, fresh: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns velocities (M, 2) [px/s] of new points at (M, 2): those of the nearest track."""
    alive = followed.status == TrackStatus.ALIVE
    return nearest_speed(followed.uv[alive], followed.speed[alive], fresh)


def nearest_speed(
    tracks_uv: NDArray[np.float32], speed: NDArray[np.float32], uv: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns velocities (M, 2) [px/s] at (M, 2) [px]: those (N, 2) of the nearest of the tracks at (N, 2)."""
    if not speed.any():
        return np.zeros((len(uv), 2), np.float32)
    return speed[((uv[:, None] - tracks_uv[None]) ** 2).sum(axis=2).argmin(axis=1)]


def next_live_tracks(
    live: LiveTracks,
    followed: Followed,
    grey: Image,
    fresh: NDArray[np.float32],
    time_ns: int,
    compared: NDArray[np.bool_],
) -> LiveTracks:
    """Returns the tracks alive in the new image, and the new ones.

    At a keyframe (with new tracks), tracks that could not be compared with their origin get a new one.
    """
    alive, n = followed.status == TrackStatus.ALIVE, len(fresh)
    origin_ns, origin_uv = live.origin_ns.copy(), live.origin_uv.copy()
    if n:
        origin_ns[~compared], origin_uv[~compared] = time_ns, followed.uv[~compared]
    origin_ns = np.concatenate([origin_ns[alive], np.full(n, time_ns)])
    used = set(origin_ns.tolist())
    images = (*live.origins, (time_ns, grey))
    return LiveTracks(
        grey,
        np.concatenate([live.ids[alive], live.next_id + np.arange(n, dtype=np.int64)]),
        np.concatenate([followed.uv[alive], fresh]),
        np.concatenate([(followed.uv - live.uv)[alive], np.zeros((n, 2), np.float32)]),
        live.time_ns,
        np.concatenate([followed.speed[alive], speed_where(followed, fresh)]),
        time_ns,
        np.concatenate([both(live.flow[alive] == 0), np.zeros(n, bool)]),
        origin_ns,
        np.concatenate([origin_uv[alive], fresh]),
        tuple(item for item in images if item[0] in used),
        live.next_id + n,
    )
