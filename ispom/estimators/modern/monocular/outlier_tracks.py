"""Tracks that ended because nothing that stands still moves like them, followed on by themselves: one other rigid
motion may explain them, and then the scene may be the other one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.tracks import Followed, LiveTracks, Moved
from ispom.estimators.modern.motions import LEAST
from ispom.features.patches import align
from ispom.numerics.places import places
from ispom.numerics.reductions import lengths
from ispom.types import Image, Tracks, TrackStatus

ENOUGH = LEAST // 2
"""Fewer tracks are not followed on: some always go astray, and following costs as much as for twice as many."""
LASTING, LONGEST = 2, 20
"""Images that a track is followed on into before it counts: what went astray is mostly not found forwards and
backwards; and after which it is given up, where no motion has explained it: contours that slide last long."""
BACK_PX = 0.7
"""A patch found again leads back to where it was within so much, as `klt.Klt` wants it of tracks without a map."""


@dataclass(frozen=True, eq=False)
class OutlierTracks:
    """Tracks that ended as no images of a still point, at most as many as are tracked in all."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ascending; those that the tracks had."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] in the last image."""
    flow: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px] motion into it."""
    age: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) images since the track ended, or was explained."""
    rest: int = 0
    """Images to come in which no motion is sought."""

    @property
    def lasting(self) -> NDArray[np.bool_]:
        """(N,) which ones count."""
        return self.age >= LASTING

    @property
    def expected(self) -> Moved:
        """In the next image, each where its last motion leads: no map says where it should be."""
        return Moved(self.uv, self.uv + self.flow)

    def followed(self, before: Image, now: Image, found: Moved) -> OutlierTracks:
        """Those found in the next image that lead back to where they were; none in one of another size."""
        if not len(self.ids) or len(found.status) != len(self.ids):
            return OutlierTracks()
        kept = np.flatnonzero((found.status == TrackStatus.ALIVE) & (self.age < LONGEST))
        still = np.broadcast_to(np.eye(2), (len(kept), 2, 2))
        back, score = align(now, found.now[kept], before, self.uv[kept], still)
        kept = kept[(score > 0) & (lengths(back - self.uv[kept]) < BACK_PX)]
        uv = found.now[kept]
        return OutlierTracks(self.ids[kept], uv, uv - self.uv[kept], self.age[kept] + 1, max(self.rest - 1, 0))

    def joined(self, live: LiveTracks, followed: Followed, most: int) -> OutlierTracks:
        """With the tracks that end now; none where there are too few, the newest where there are too many."""
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
        """Some of them (M,) are followed on for as long again."""
        if not len(ids):
            return self
        return replace(self, age=np.where(np.isin(self.ids, ids), LASTING, self.age))

    def speed(self, live: LiveTracks, time_ns: int) -> NDArray[np.float32]:
        """(N, 2) [px/s] into the image at that time from the one of `live`."""
        return self.flow / np.float32((time_ns - live.time_ns) * 1e-9)

    def tracks(self, ids: NDArray[np.int64]) -> Tracks:
        """Some of them (M,) as a Step shows them."""
        some = np.isin(self.ids, ids)
        return Tracks.of(self.ids[some], self.uv[some], uv_prev=(self.uv - self.flow)[some])
