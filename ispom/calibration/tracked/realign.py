"""Realignment of tracked corners with the patches of their first keyframes, which takes their drift away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked.scene import Observations, Scene
from ispom.calibration.tracked.tracks import Tracks
from ispom.features.patches import align
from ispom.geometry import Array

LEAST_CORRELATION = 0.8
"""Least correlation of two patches that show the same corner,"""
MOST_MOVED_PX = 2.0
"""and largest distance of its position from that of the track."""
ITERATIONS = 15


def realign(tracks: Tracks, scene: Scene) -> Tracks:
    """Aligns each corner with the patch of its first keyframe, warped by the geometry; drops those that do not
    match.

    Tracking from image to image drifts, and with growing or rotating surfaces it drifts in one direction: all tracks of
    a camera together, like a wrong lens. `scene` has the poses, points and lens by the tracks so far. Returns the
    tracks unchanged without `images`.
    """
    if not tracks.images:
        return tracks
    first = np.searchsorted(tracks.point, tracks.point)
    first_view = tracks.view[first]
    uv, keep = tracks.uv.copy(), first_view == tracks.view
    for v in range(1, len(tracks.images)):
        again = np.flatnonzero((tracks.view == v) & (first_view != v))
        warps = _warps(scene, tracks.observations.select(again), first_view[again])
        for u in np.unique(first_view[again]).tolist():
            mine = first_view[again] == u
            here = again[mine]
            found, score = align(
                tracks.images[u], tracks.uv[first[here]], tracks.images[v], tracks.uv[here], warps[mine], ITERATIONS
            )
            moved_px = np.linalg.norm(found - tracks.uv[here], axis=1)
            good = (score > LEAST_CORRELATION) & (moved_px < MOST_MOVED_PX)
            uv[here[good]], keep[here[good]] = found[good], True
    return replace(tracks, view=tracks.view[keep], point=tracks.point[keep], uv=uv[keep])


def _warps(scene: Scene, now: Observations, first: NDArray[np.int64]) -> Array:
    """Returns pixels (K, 2, 2) of the views `first` (K,) per pixel of those `now`, around points on surfaces that face
    the views `now`; the identity for points behind one of them."""
    by_pixel, facing = [], np.swapaxes(scene.rotations[now.view], 1, 2)[..., :2]
    for views in (first, now.view):
        in_camera = scene.in_camera(replace(now, view=views))
        along = scene.rotations[views] @ facing  # the image's axes of `now`, in these cameras
        by_pixel.append(scene.camera.project_jacobian(in_camera) @ along)
    behind = ~np.isfinite(by_pixel).all((0, 2, 3))
    for jacobian in by_pixel:
        jacobian[behind] = np.eye(2)
    return by_pixel[0] @ np.linalg.inv(by_pixel[1])
