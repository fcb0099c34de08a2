"""The tracks of the monocular estimator: in the last image, in the new one, and those that ended as outliers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.rolling import RollingTracks, Speeds, late_px
from ispom.estimators.modern.second_motion import LEAST
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.features.patches import align
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.reductions import both, lengths
from ispom.types import Camera, Image, Tracks, TrackStatus

MIN_TRACKS = LEAST // 2
"""Least number of tracks that are followed: some are always wrong, and following costs as much as for twice as many."""
MIN_AGE, MAX_AGE = 2, 20
"""Number of images into which a track is followed before it counts, as wrong tracks mostly fail the forward-backward
check; and number of images after which it ends if no motion explains it, as tracks that slide along contours last long.
"""
MAX_BACKWARD_PX = 0.7
"""Largest forward-backward error [px], as `klt.Klt` requires for tracks without a map."""


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
    def rolling_tracks(self) -> RollingTracks:
        """The observations in the last image."""
        return RollingTracks(self.time_ns, self.ids, self.uv)


@dataclass(frozen=True, eq=False)
class MovedPoints:
    """Other points to track, from one image to their predicted or found positions in the next."""

    before: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(M, 2) [px] positions in the first image."""
    now: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(M, 2) [px] positions in the second one."""
    status: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(M,) TrackStatus, once tracked."""


NO_POINTS = MovedPoints()


@dataclass(frozen=True, eq=False)
class TrackingResult:
    """The tracks in a new image."""

    uv: NDArray[np.float32]
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    speed: NDArray[np.float32]
    """(N, 2) [px/s] velocities in it; 0 for a global shutter."""
    speeds: Speeds | None = None
    """Velocities in the last images, as known now; None for a global shutter."""
    others: MovedPoints = NO_POINTS
    """Other points that were tracked too."""
    bright: Image | None = None
    """The new image with the brightness of the last one; None if nothing was tracked."""


def at_middle_row(camera: Camera, tracks: LiveTracks | TrackingResult) -> NDArray[np.float32]:
    """Returns positions (N, 2) [px] as if all rows had been exposed with the middle one."""
    return tracks.uv - late_px(camera, tracks.uv, tracks.speed)


def tracks_with_speeds(
    camera: Camera, uv: NDArray[np.float32], speed: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Returns the tracks (N, 2) [px] and speeds [px/s] that a Keyframe stores; None for a global shutter."""
    return (uv, speed) if camera.line_delay_s else None


def tracked_frame(camera: Camera, live: LiveTracks, tracked: TrackingResult, time_ns: int) -> TrackedFrame:
    """Returns the live tracks in the new image."""
    alive = tracked.status == TrackStatus.ALIVE
    return TrackedFrame(time_ns, live.ids[alive], camera.normalise(at_middle_row(camera, tracked)[alive]))


def as_tracks(
    live: LiveTracks, tracked: TrackingResult, residual_px: NDArray[np.float32], new_uv: NDArray[np.float32]
) -> Tracks:
    """Returns the tracks for the Step: all that were tracked, with their status, and the new ones."""
    n, status = len(new_uv), tracked.status
    seen = (status == TrackStatus.ALIVE) | (status >= TrackStatus.EPIPOLAR)
    return Tracks.of(
        np.concatenate([live.ids, live.next_id + np.arange(n)]),
        np.concatenate([np.where(seen[:, None], tracked.uv, live.uv), new_uv]),
        uv_prev=np.concatenate([live.uv, np.full((n, 2), np.nan, np.float32)]),
        status=np.concatenate([status, np.full(n, TrackStatus.NEW, np.uint8)]),
        residual_px=np.concatenate([residual_px, np.full(n, np.nan, np.float32)]),
    )


def speeds_at(tracked: TrackingResult, new_uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns velocities (M, 2) [px/s] of new points at (M, 2): those of the nearest track."""
    alive = tracked.status == TrackStatus.ALIVE
    return nearest_speeds(tracked.uv[alive], tracked.speed[alive], new_uv)


def nearest_speeds(
    tracks_uv: NDArray[np.float32], speed: NDArray[np.float32], uv: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns velocities (M, 2) [px/s] at (M, 2) [px]: those (N, 2) of the nearest of the tracks at (N, 2)."""
    if not speed.any():
        return np.zeros((len(uv), 2), np.float32)
    return speed[((uv[:, None] - tracks_uv[None]) ** 2).sum(axis=2).argmin(axis=1)]


def next_live_tracks(
    live: LiveTracks,
    tracked: TrackingResult,
    grey: Image,
    new_uv: NDArray[np.float32],
    time_ns: int,
    compared: NDArray[np.bool_],
) -> LiveTracks:
    """Returns the tracks alive in the new image, and the new ones.

    At a keyframe (with new tracks), tracks that could not be compared with their origin get a new one.
    """
    alive, n = tracked.status == TrackStatus.ALIVE, len(new_uv)
    origin_ns, origin_uv = live.origin_ns.copy(), live.origin_uv.copy()
    if n:
        origin_ns[~compared], origin_uv[~compared] = time_ns, tracked.uv[~compared]
    origin_ns = np.concatenate([origin_ns[alive], np.full(n, time_ns)])
    used = set(origin_ns.tolist())
    images = (*live.origins, (time_ns, grey))
    return LiveTracks(
        grey,
        np.concatenate([live.ids[alive], live.next_id + np.arange(n, dtype=np.int64)]),
        np.concatenate([tracked.uv[alive], new_uv]),
        np.concatenate([(tracked.uv - live.uv)[alive], np.zeros((n, 2), np.float32)]),
        live.time_ns,
        np.concatenate([tracked.speed[alive], speeds_at(tracked, new_uv)]),
        time_ns,
        np.concatenate([both(live.flow[alive] == 0), np.zeros(n, bool)]),
        origin_ns,
        np.concatenate([origin_uv[alive], new_uv]),
        tuple(item for item in images if item[0] in used),
        live.next_id + n,
    )


@dataclass(frozen=True, eq=False)
class NewImage:
    """An image with the tracks in it, before it is localised."""

    time_ns: int
    grey: Image
    predicted: Pose | None
    """world_from_camera by the motion model; None without a map."""
    tracked: TrackingResult
    scene: Array
    """(N, 3) points of the tracks, those untriangulated at a guessed depth; NaN without a map."""


@dataclass(frozen=True, eq=False)
class OutlierTracks:
    """Tracks that ended because they do not observe a static point, at most as many as are tracked in all."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ids that they had as tracks, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] positions in the last image."""
    flow: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] motion into it."""
    age: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) number of images since the track ended, or was explained."""
    rest: int = 0
    """Number of images in which no motion is searched."""

    @property
    def lasting(self) -> NDArray[np.bool_]:
        """(N,) which tracks count."""
        return self.age >= MIN_AGE

    @property
    def expected(self) -> MovedPoints:
        """Predicted positions in the next image, with constant velocity: no map predicts them."""
        return MovedPoints(self.uv, self.uv + self.flow)

    def after_tracking(self, before: Image, now: Image, found: MovedPoints) -> OutlierTracks:
        """Keeps the tracks found in the next image that pass the forward-backward check; none if the image size
        changed."""
        if not len(self.ids) or len(found.status) != len(self.ids):
            return OutlierTracks()
        kept = np.flatnonzero((found.status == TrackStatus.ALIVE) & (self.age < MAX_AGE))
        still = np.broadcast_to(np.eye(2), (len(kept), 2, 2))
        back, score = align(now, found.now[kept], before, self.uv[kept], still)
        kept = kept[(score > 0) & (lengths(back - self.uv[kept]) < MAX_BACKWARD_PX)]
        uv = found.now[kept]
        return OutlierTracks(self.ids[kept], uv, uv - self.uv[kept], self.age[kept] + 1, max(self.rest - 1, 0))

    def joined(self, live: LiveTracks, tracked: TrackingResult, most: int) -> OutlierTracks:
        """Adds the tracks that end now; keeps none if they are too few, and the newest if they are too many."""
        ended = (tracked.status == TrackStatus.EPIPOLAR) | (tracked.status == TrackStatus.REPROJECTION)
        ended &= places(self.ids, live.ids) < 0
        ids = np.concatenate([self.ids, live.ids[ended]])
        if len(ids) < MIN_TRACKS:
            return OutlierTracks()
        order = np.argsort(ids)[-most:]
        uv = np.concatenate([self.uv, tracked.uv[ended]])
        flow = np.concatenate([self.flow, (tracked.uv - live.uv)[ended]])
        age = np.concatenate([self.age, np.zeros(int(ended.sum()), np.int64)])
        return OutlierTracks(ids[order], uv[order], flow[order], age[order], self.rest)

    def explained(self, ids: NDArray[np.int64]) -> OutlierTracks:
        """Resets the age of explained tracks (M,)."""
        if not len(ids):
            return self
        return replace(self, age=np.where(np.isin(self.ids, ids), MIN_AGE, self.age))

    def speed(self, live: LiveTracks, time_ns: int) -> NDArray[np.float32]:
        """Returns velocities (N, 2) [px/s] into the image at this time from that of `live`."""
        return self.flow / np.float32((time_ns - live.time_ns) * 1e-9)

    def tracks(self, ids: NDArray[np.int64]) -> Tracks:
        """Returns some of the tracks (M,) for the Step."""
        some = np.isin(self.ids, ids)
        return Tracks.of(self.ids[some], self.uv[some], uv_prev=(self.uv - self.flow)[some])
