"""Feature points tracked "in the whole video frames" (section 6.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.monocular.resection import Resected
from ispom.estimators.paper.monocular.state import MonocularState, Revision
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.features.interfaces import Tracker
from ispom.types import Camera, Image, Tracks, TrackStatus


@dataclass(frozen=True, eq=False)
class Followed:
    """The points of the previous image in the new one."""

    ids: NDArray[np.int64]
    uv_prev: NDArray[np.float32]
    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    residual_px: NDArray[np.float32]
    """(N,) NaN where a point took no part in the pose."""

    @property
    def alive(self) -> NDArray[np.bool_]:
        return self.status == TrackStatus.ALIVE

    def frame(self, camera: Camera, time_ns: int) -> TrackedFrame:
        """Those alive."""
        return TrackedFrame(time_ns, self.ids[self.alive], camera.normalise(self.uv[self.alive]))

    def without_outliers(self, located: Resected, revision: Revision, camera: Camera) -> Followed:
        """With those ended that fit the pose or the triple badly."""
        status, residual, alive = self.status.copy(), self.residual_px.copy(), np.flatnonzero(self.alive)
        if (found := located.resection) is not None:
            residual[alive[located.points]] = found.residuals * camera.fx
            status[alive[located.points[~found.inliers]]] = TrackStatus.REPROJECTION
        if revision.triple is not None:
            status[np.isin(self.ids, revision.ids[~revision.triple.epipolar])] = TrackStatus.EPIPOLAR
        return replace(self, status=status, residual_px=residual)

    def as_tracks(self, fresh: NDArray[np.float32], next_id: int) -> Tracks:
        """With the fresh ones (M, 2) [px]; of an ended track the last known place."""
        nan = np.full((len(fresh), 2), np.nan, np.float32)
        seen = self.alive[:, None] | (self.status >= TrackStatus.EPIPOLAR)[:, None]
        return Tracks.of(
            np.concatenate([self.ids, next_id + np.arange(len(fresh), dtype=np.int64)]),
            np.concatenate([np.where(seen, self.uv, self.uv_prev), fresh]),
            uv_prev=np.concatenate([self.uv_prev, nan]),
            status=np.concatenate([self.status, np.full(len(fresh), TrackStatus.NEW, np.uint8)]),
            residual_px=np.concatenate([self.residual_px, nan[:, 0]]),
        )


def follow(tracker: Tracker, state: MonocularState, grey: Image) -> Followed:
    """Tracks the points of the previous image into the new one; none into the first."""
    uv, status = np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
    if state.grey is not None:
        uv, status = tracker.track(state.grey, grey, state.uv)
    return Followed(state.ids, state.uv, uv, status, np.full(len(status), np.nan, np.float32))
