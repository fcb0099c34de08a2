"""A first reconstruction from tracks, for a lens that is a guess: two views, then one keyframe after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked.adjust import adjusted
from ispom.calibration.tracked.bundle import (
    Fixed,
    Observed,
    Prior,
    Scale,
    Scene,
    errors_px,
    in_camera,
    undistorted,
)
from ispom.calibration.tracked.tracks import Tracks
from ispom.geometry import Array, Pose
from ispom.solvers.multiview.two_view import hypotheses

FIRST_SHARE = 0.1
"""Median motion of points between the two initial views, as a share of the image's width."""
MOST_FIRST = 12
LEAST_SHARED = 50
ROUGH_PX, FINE_PX = 4.0, 1.0
"""Scale of the loss (at 750 px of width) at the beginning, and at the end."""
EPIPOLAR_PX = 3.0
EVERY = 4
"""Keyframes that are added before all is adjusted again."""
STEPS_FIRST, STEPS_ONE, STEPS_ALL = 15, 6, 5


def first_views(tracks: Tracks) -> int:
    """Returns the initial keyframes: up to the one with a wide enough motion, or few shared points."""
    for j in range(2, min(MOST_FIRST, len(tracks.views))):
        a, b = _shared(tracks, 0, j)
        if len(a) < LEAST_SHARED:
            return max(j, 2)
        if np.median(np.linalg.norm(tracks.uv[b] - tracks.uv[a], axis=1)) > FIRST_SHARE * tracks.size[0]:
            return j + 1
    return min(MOST_FIRST, len(tracks.views))


def begun(tracks: Tracks, lens: Array, prior: Prior, scale_px: float, count: int) -> tuple[Scene, float] | None:
    """The first `count` keyframes, by the best of the motions that their first and last one allow; and its cost.

    The other poses are the motion's share. None where too few points are shared.
    """
    a, b = _shared(tracks, 0, count - 1)
    if len(a) < 8:
        return None
    x1, x2 = undistorted(lens, tracks.uv[a]), undistorted(lens, tracks.uv[b])
    part = tracks.in_views(0, count)
    seen = Observed(part.view, part.point, part.uv)
    best: tuple[Scene, float] | None = None
    for motion in hypotheses(x1, x2, EPIPOLAR_PX / np.exp(lens[0])).second_from_first:
        poses = [Pose.exp(v / (count - 1) * motion.log()) for v in range(count)]
        scene = _scene(lens, poses, len(tracks.views), tracks.points)
        scene = with_points(scene, seen, np.unique(seen.point))
        fixed = Fixed(np.arange(len(tracks.views)) % len(tracks.views) == 0)
        found = adjusted_part(scene, seen, prior, fixed, ROUGH_PX * scale_px, STEPS_FIRST)
        found = adjusted_part(found[0], seen, prior, fixed, FINE_PX * scale_px, STEPS_FIRST)
        if best is None or found[1] < best[1]:
            best = found
    return best


def grown(scene: Scene, tracks: Tracks, prior: Prior, scale_px: float, count: int) -> Scene:
    """Adds all keyframes, from the first `count` on."""
    views = len(tracks.views)
    for v in range(count, views):
        before, now = tracks.in_views(0, v), tracks.in_views(v, v + 1)
        known = np.isin(now.point, before.point)
        scene = _located(scene, v, now.point[known], now.uv[known], scale_px)
        part = tracks.in_views(0, v + 1)
        counts = np.bincount(part.point, minlength=tracks.points)
        fresh = now.point[counts[now.point] == 2]
        all_seen = Observed(part.view, part.point, part.uv)
        scene = with_points(scene, all_seen, fresh)
        if (v - count) % EVERY == EVERY - 1 or v == views - 1:
            fixed = Fixed(np.arange(views) == 0)
            scene = adjusted_part(scene, all_seen, prior, fixed, FINE_PX * scale_px, STEPS_ALL)[0]
    return scene


def _located(scene: Scene, v: int, points: NDArray[np.int64], uv: Array, scale_px: float) -> Scene:
    """Adds view v by the points that it observes, starting from the pose of the view before."""
    alone = Scene(scene.lens, scene.rotations[v - 1 : v], scene.translations[v - 1 : v], scene.points[points])
    seen = Observed(np.zeros(len(points), np.int64), np.arange(len(points)), uv)
    still, free = Prior(scene.lens, np.zeros(len(scene.lens))), Fixed(np.zeros(1, bool), points=True)
    for scale in (4 * ROUGH_PX, ROUGH_PX, FINE_PX):
        alone = adjusted(alone, seen, still, free, scale * scale_px, STEPS_ONE)[0]
    rotations, translations = scene.rotations.copy(), scene.translations.copy()
    rotations[v], translations[v] = alone.rotations[0], alone.translations[0]
    return replace(scene, rotations=rotations, translations=translations)


def adjusted_part(
    scene: Scene,
    seen: Observed,
    prior: Prior,
    fixed: Fixed,
    scale_px: Scale,
    iterations: int,
    tolerance: float = 1e-4,
    by: Callable[[Scene, Observed, Prior, Fixed, Scale, int, float], tuple[Scene, float]] = adjusted,
) -> tuple[Scene, float]:
    """Adjusts the views, and the points observed at least twice."""
    often = (np.bincount(seen.point, minlength=len(scene.points)) >= 2)[seen.point]
    seen = seen.select(often)
    scale_px = scale_px[often] if isinstance(scale_px, np.ndarray) else scale_px
    points, owner = np.unique(seen.point, return_inverse=True)
    views = int(seen.view.max()) + 1
    part = Scene(scene.lens, scene.rotations[:views], scene.translations[:views], scene.points[points])
    own, own_fixed = Observed(seen.view, owner, seen.uv), Fixed(fixed.views[:views], fixed.points)
    found, cost = by(part, own, prior, own_fixed, scale_px, iterations, tolerance)
    rotations, translations, places = scene.rotations.copy(), scene.translations.copy(), scene.points.copy()
    rotations[:views], translations[:views], places[points] = found.rotations, found.translations, found.points
    return Scene(found.lens, rotations, translations, places), cost


def with_points(scene: Scene, seen: Observed, points: NDArray[np.int64]) -> Scene:
    """Adds these points where their first and last rays meet (linear, homogeneous; Hartley & Zisserman 12.2), in
    front of both cameras; at infinity along the first ray where they do not."""
    first = np.searchsorted(seen.point, points)
    last = np.searchsorted(seen.point, points, side="right") - 1
    rows, rays = [], []
    for at in (first, last):
        x = undistorted(scene.lens, seen.uv[at])
        pose = np.concatenate([scene.rotations[seen.view[at]], scene.translations[seen.view[at]][..., None]], axis=2)
        rows += [x[:, :1] * pose[:, 2] - pose[:, 0], x[:, 1:] * pose[:, 2] - pose[:, 1]]
        rays.append(np.concatenate([x, np.ones((len(x), 1))], axis=1))
    found = np.linalg.svd(np.stack(rows, axis=1))[2][:, 3]
    found *= np.where(found[:, 3:] < 0, -1.0, 1.0)
    places = scene.points.copy()
    places[points] = found
    trial = replace(scene, points=places)
    ahead = [in_camera(trial, seen.select(at))[:, 2] > 0 for at in (first, last)]
    far = np.zeros((len(points), 4))
    far[:, :3] = (np.swapaxes(scene.rotations[seen.view[first]], 1, 2) @ rays[0][..., None])[..., 0]
    far /= np.linalg.norm(far, axis=1, keepdims=True)
    places[points] = np.where((ahead[0] & ahead[1])[:, None], found, far)
    return replace(scene, points=places)


def outliers(scene: Scene, seen: Observed, limit: float) -> NDArray[np.bool_]:
    """Returns which observations (K,) exceed `limit` times the median error, if that is more than a pixel."""
    errors = errors_px(scene, seen)
    return errors > max(limit * float(np.median(errors)), 1.0)


def _shared(tracks: Tracks, one: int, other: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Observations of the same points in two views."""
    a, b = np.flatnonzero(tracks.view == one), np.flatnonzero(tracks.view == other)
    _, i, j = np.intersect1d(tracks.point[a], tracks.point[b], return_indices=True)
    return a[i], b[j]


def _scene(lens: Array, poses: list[Pose], views: int, points: int) -> Scene:
    rotations, translations = np.tile(np.eye(3), (views, 1, 1)), np.zeros((views, 3))
    for v, pose in enumerate(poses):
        rotations[v], translations[v] = pose.rotation, pose.translation
    places = np.zeros((points, 4))
    places[:, 2] = 1.0
    return Scene(lens.copy(), rotations, translations, places)
