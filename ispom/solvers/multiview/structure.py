"""Triangulates all points from all observations and given poses: a map that is consistent with its poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import intersect
from ispom.types import Camera, Trajectory

MIN_SIGNIFICANCE = 2.0
"""Least ratio of the inverse depth and its standard deviation (for an error of 1 px) of a point of known distance."""


def intersected(
    views: Trajectory,
    camera: Camera,
    seen_from: NDArray[np.int64],
    seen_ids: NDArray[np.int64],
    seen_uv: NDArray[np.floating],
    disparity_px: NDArray[np.floating],
    baseline_m: float = 0.0,
) -> tuple[NDArray[np.int64], Array]:
    """Returns ids (M,), ascending, and positions (M, 3), in the views' world, of all points of known distance.

    Observation n (of N) is pixel seen_uv[n] (2,) of point seen_ids[n] in views[seen_from[n]], world_from_camera.
    If disparity_px[n] is finite, a second camera, baseline_m to the right of the first, also observed the point.
    """
    paired = np.flatnonzero(np.isfinite(disparity_px))
    seen = camera.normalise(seen_uv)
    right = seen[paired] - np.column_stack([disparity_px[paired] / camera.fx, np.zeros(len(paired))])
    ids = np.concatenate([seen_ids, seen_ids[paired]])
    cameras = np.concatenate([seen_from, len(views) + seen_from[paired]])
    order = np.lexsort((cameras, ids))
    known, owners, counts = np.unique(ids[order], return_inverse=True, return_counts=True)
    often = counts >= 2
    known, owners, order = known[often], (np.cumsum(often) - 1)[owners][often[owners]], order[often[owners]]
    if not len(known):
        return known, np.zeros((0, 3))
    rotations = np.swapaxes(views.rotations, 1, 2)
    translations = -np.einsum("nij,nj->ni", rotations, views.translations)
    found = intersect(
        np.concatenate([rotations, rotations]),
        np.concatenate([translations, translations - (baseline_m, 0, 0)]),
        cameras[order],
        owners,
        np.concatenate([seen, right])[order],
        len(known),
        Noise(1.0 / camera.fx),
    )
    sure = (found.depth > 0) & (found.significance >= MIN_SIGNIFICANCE)
    return known[sure], found.xyz_in_world[sure]
