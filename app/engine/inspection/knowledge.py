"""Ages of the tracks of a frame, and depths of their points, from the frames before it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Rig, Tracks

from .colouring import SCALES, Colouring, relative_depths
from .sightings import Seen, camera_pose


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Ages and depths of the live tracks of one camera."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) increasing."""
    ages: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) frames of the camera since they began; 0 where new."""
    xyz_in_world: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) the newest positions; NaN where there is none."""
    depths: Array = field(default_factory=lambda: np.zeros(0))
    """(N,) of the points in the camera, in the unit of the method; NaN where unknown."""

    def after(self, seen: Seen, rig: Rig) -> Knowledge:
        """Returns the knowledge after the camera's next frame."""
        order = np.argsort(seen.tracks.ids, kind="stable")
        ids = seen.tracks.ids[order]
        known, at = _found(self.ids, ids)
        ages, xyz = np.zeros(len(ids), np.int64), np.full((len(ids), 3), np.nan)
        ages[known], xyz[known] = self.ages[at[known]] + 1, self.xyz_in_world[at[known]]
        points = seen.step.landmarks
        by_id = np.argsort(points.ids, kind="stable")
        located, at = _found(points.ids[by_id], ids)
        xyz[located] = points.xyz_in_world[by_id][at[located]]
        return Knowledge(ids, ages, xyz, _depths(seen, xyz, seen.tracks.disparity_px[order], rig))

    def values(self, tracks: Tracks, by: Colouring) -> Array:
        """Returns (N,) the values that colour these tracks; NaN where unknown."""
        if by == "residual":
            return tracks.residual_px.astype(float)
        known, at = _found(self.ids, tracks.ids)
        of = (self.ages.astype(float) + 1) if by == "age" else relative_depths(self.depths)
        found = np.full(len(tracks), np.nan)
        found[known] = of[at[known]]
        return found

    def bins(self, tracks: Tracks, by: Colouring) -> NDArray[np.int64]:
        """Returns (N,) the bins of these values in the colour scale."""
        return SCALES[by].bins(self.values(tracks, by))


def known_from(exposures: Iterable[Seen], rig: Rig) -> Knowledge:
    """Returns the knowledge after these frames of one camera, oldest first."""
    found = Knowledge()
    for seen in exposures:
        found = found.after(seen, rig)
    return found


def _depths(seen: Seen, xyz_in_world: Array, disparity_px: Array, rig: Rig) -> Array:
    """Returns depths (N,) by the disparity where there is one, else of the landmark by the camera's pose."""
    camera, pose = rig.camera(seen.camera), camera_pose(seen.step, rig, seen.camera)
    away = np.full(len(xyz_in_world), np.nan) if pose is None else pose.inverse().apply(xyz_in_world)[:, 2]
    away = np.where(away > 0, away, np.nan)
    if not rig.has_stereo or seen.camera != "left":
        return away
    measured = np.isfinite(disparity_px) & (disparity_px > 0)
    return np.where(measured, camera.fx * rig.baseline_m / np.where(measured, disparity_px, 1.0), away)


def _found(sorted_ids: NDArray[np.int64], ids: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Returns which of `ids` are in `sorted_ids`, and their indices there."""
    if not len(sorted_ids):
        return np.zeros(len(ids), bool), np.zeros(len(ids), np.int64)
    at = np.minimum(np.searchsorted(sorted_ids, ids), len(sorted_ids) - 1)
    return sorted_ids[at] == ids, at
