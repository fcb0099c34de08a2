"""Tracks outliers of the static scene further: another rigid motion may explain them, and may turn out to be the
scene."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.tracks import Followed, LiveTracks, Moved
from ispom.estimators.modern.second_motion import LEAST
from ispom.features.patches import align
from ispom.numerics.places import places
from ispom.numerics.reductions import lengths
from ispom.types import Image, Tracks, TrackStatus

ENOUGH = LEAST // 2
"""Least number of tracks that are followed: some are always wrong, and following costs as much as for twice as many."""
LASTING, LONGEST = 2, 20
"""Number of images into which a track is followed before it counts, as wrong tracks mostly fail the forward-backward
check; and number of images after which it ends if no motion explains it, as tracks that slide along contours last long.
"""
BACK_PX = 0.7
"""Largest forward-backward error [px], as `klt.Klt` requires for tracks without a map."""


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
        return self.age >= LASTING

    @property
    def expected(self) -> Moved:
        """Predicted positions in the next image, with constant velocity: no map predicts them."""
        return Moved(self.uv, self.uv + self.flow)

    def followed(self, before: Image, now: Image, found: Moved) -> OutlierTracks:
        """Keeps the tracks found in the next image that pass the forward-backward check; none if the image size
        changed."""
        if not len(self.ids) or len(found.status) != len(self.ids):
            return OutlierTracks()
        kept = np.flatnonzero((found.status == TrackStatus.ALIVE) & (self.age < LONGEST))
        still = np.broadcast_to(np.eye(2), (len(kept), 2, 2))
        back, score = align(now, found.now[kept], before, self.uv[kept], still)
        kept = kept[(score > 0) & (lengths(back - self.uv[kept]) < BACK_PX)]
        uv = found.now[kept]
        return OutlierTracks(self.ids[kept], uv, uv - self.uv[kept], self.age[kept] + 1, max(self.rest - 1, 0))

    def joined(self, live: LiveTracks, followed: Followed, most: int) -> OutlierTracks:
        """Adds the tracks that end now; keeps none if they are too few, and the newest if they are too many."""
        ended = (followed.status == TrackStatus.EPIPOLAR) | (followed.status == TrackStatus.REPROJECTION)
        ended &= places(self.ids, live.ids) < 0
        ids = np.concatenate([self.ids, live.ids[ended]])
        if len(ids) < ENOUGH:
            return OutlierTracks()
        order = np.argsort(ids)[-most:]
        uv = np.concatenate([self.uv, followed.uv[ended]])
        flow = np.concatenate([self.flow, (followed.uv - live.uv)[ended]])
        age = np.concatenate([self.age, np.zeros(int(ended.sum()), np.int64)])
        return OutlierTracks(ids[order], uv[order], flow[order], age[order], self.rest)

    def explained(self, ids: NDArray[np.int64]) -> OutlierTracks:
        """Resets the age of explained tracks (M,)."""
        if not len(ids):
            return self
        return replace(self, age=np.where(np.isin(self.ids, ids), LASTING, self.age))

    def speed(self, live: LiveTracks, time_ns: int) -> NDArray[np.float32]:
        """Returns velocities (N, 2) [px/s] into the image at this time from that of `live`."""
        return self.flow / np.float32((time_ns - live.time_ns) * 1e-9)

    def tracks(self, ids: NDArray[np.int64]) -> Tracks:
        """Returns some of the tracks (M,) for the Step."""
        some = np.isin(self.ids, ids)
        return Tracks.of(self.ids[some], self.uv[some], uv_prev=(self.uv - self.flow)[some])
