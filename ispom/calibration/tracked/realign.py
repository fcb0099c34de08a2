"""Corners found again from the key frame that saw them first, as the scene's geometry says that they look.

What is followed from image to image drifts, and where a surface grows, as before a camera that drives, or turns in the
image, it drifts one way: all tracks of a camera together, as a wrong lens would have it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.calibration.tracked.bundle import Scene, projected
from ispom.calibration.tracked.tracks import Tracks
from ispom.features.patches import align
from ispom.geometry import Array

ALIKE = 0.8
"""Least correlation of two patches that show the same,"""
NEAR_PX = 2.0
"""which is so near to where the track was."""
ITERATIONS = 15
SMALL_STEP = 1e-3
"""Of a point's distance: over so much, a surface is flat and a lens has a scale."""


def realigned(tracks: Tracks, scene: Scene) -> Tracks:
    """The same, with places by the patches of each corner's first key frame; those that do not look like it are gone.

    `scene` has the poses, points and lens that the tracks tell so far. As they are, where there are no `images`.
    """
    if not tracks.images:
        return tracks
    first = np.searchsorted(tracks.point, tracks.point)
    begins = tracks.view[first]
    uv, keep = tracks.uv.copy(), begins == tracks.view
    for v in range(1, len(tracks.images)):
        for u in np.unique(begins[tracks.view == v]).tolist():
            if u == v:
                continue
            here = np.flatnonzero((tracks.view == v) & (begins == u))
            warps = _warps(scene, scene.points[tracks.point[here]], u, v)
            found, score = align(
                tracks.images[u], tracks.uv[first[here]], tracks.images[v], tracks.uv[here], warps, ITERATIONS
            )
            good = (score > ALIKE) & (np.linalg.norm(found - tracks.uv[here], axis=1) < NEAR_PX)
            uv[here[good]], keep[here[good]] = found[good], True
    return replace(tracks, view=tracks.view[keep], point=tracks.point[keep], uv=uv[keep])


def _warps(scene: Scene, points: Array, first: int, now: int) -> Array:
    """(N, 2, 2) pixels of view `first` per pixel of view `now` about points (N, 4), on surfaces that face `now`."""
    xyz, w = points[:, :3], points[:, 3:]
    here = xyz @ scene.rotations[now].T + w * scene.translations[now]
    across = scene.rotations[first] @ scene.rotations[now].T
    there = xyz @ scene.rotations[first].T + w * scene.translations[first]
    step = SMALL_STEP * np.linalg.norm(here, axis=1, keepdims=True)
    by_here, by_there = np.empty((len(points), 2, 2)), np.empty((len(points), 2, 2))
    for axis in range(2):
        along = step * np.eye(3)[axis]
        by_here[:, :, axis] = projected(scene.lens, here + along) - projected(scene.lens, here)
        by_there[:, :, axis] = projected(scene.lens, there + along @ across.T) - projected(scene.lens, there)
    return by_there @ np.linalg.inv(by_here)
