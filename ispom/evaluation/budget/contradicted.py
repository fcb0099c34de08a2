"""Tracks that contradict the true poses: those of moving objects, and false matches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.essential import sampson_distance
from ispom.types import Camera, Tracks, TrackStatus

FAR_PX = 2.0
"""A track that is no farther from its true epipolar line is none that contradicts: inliers of a pose are as far."""
OUTLYING = 4.0
"""Least distance of such a track, in medians of the distances: with a wrong calibration or clock, all tracks have large
distances."""


@dataclass(frozen=True, eq=False)
class FirstSeen:
    """The first observations of the tracks of one camera."""

    views: tuple[Pose, ...] = ()
    """True world_from_camera of frames in which tracks began."""
    points: Mapping[int, tuple[int, Array]] = field(default_factory=dict)
    """By id of a track: the number of its view, and normalised coordinates (2,)."""

    def contradicting(
        self, camera: Camera, world_from_camera: Pose, tracks: Tracks
    ) -> tuple[FirstSeen, NDArray[np.int64]]:
        """Returns the first observations including these tracks, and the ids (M,) of tracks that contradict the true
        poses. Tracks that ended are removed."""
        alive = np.isin(tracks.status, (TrackStatus.ALIVE, TrackStatus.NEW))
        ids, x = tracks.ids[alive], camera.normalise(np.asarray(tracks.uv[alive], float))
        away = np.full(len(ids), np.nan)
        views = np.array([self.points[i][0] if i in self.points else -1 for i in ids.tolist()], int)
        for view in np.unique(views[views >= 0]):
            mine = np.flatnonzero(views == view)
            first = np.array([self.points[int(i)][1] for i in ids[mine]])
            away[mine] = _away_px(world_from_camera.inverse() @ self.views[view], first, x[mine], camera.fx)
        known = np.isfinite(away)
        limit = max(FAR_PX, OUTLYING * float(np.median(away[known]))) if known.any() else np.inf
        bad = ids[known & (np.nan_to_num(away) > limit)]
        return self._after(ids, x, views, world_from_camera), bad

    def _after(self, ids: NDArray[np.int64], x: Array, views: NDArray[np.int64], here: Pose) -> FirstSeen:
        """Returns it with the new ones, and the views that some track began in."""
        used = sorted(set(views[views >= 0].tolist()))
        place = {view: k for k, view in enumerate(used)}
        points = {
            int(i): (len(used), xy) if view < 0 else (place[view], self.points[int(i)][1])
            for i, xy, view in zip(ids, x, views.tolist(), strict=True)
        }
        return FirstSeen((*(self.views[view] for view in used), here), points)


def _away_px(now_from_first: Pose, first: Array, now: Array, focal_px: float) -> Array:
    """Returns distances (N,) from the true epipolar lines; NaN where the camera did not move between the two."""
    if not np.linalg.norm(now_from_first.translation) > 0:
        return np.full(len(now), np.nan)
    return np.abs(sampson_distance(now_from_first, first, now)) * focal_px
