"""A first reconstruction from tracks, for a lens that is a guess: two views, then one keyframe after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked.scene import LensPrior, Observations, Scene, adjust_scene, localisation
from ispom.calibration.tracked.tracks import Tracks
from ispom.geometry import Array, Pose
from ispom.solvers.least_squares import adjust
from ispom.solvers.multiview.two_view import hypotheses

FIRST_SHARE = 0.1
"""Median motion of points between the two initial views, as a share of the image's width."""
MOST_FIRST = 12
LEAST_SHARED = 50
ROUGH_PX, FINE_PX = 4.0, 1.0
"""Widths of the loss (at 750 px of width) at the beginning, and at the end."""
EPIPOLAR_PX = 3.0
EVERY = 4
"""Keyframes that are added before all is adjusted again."""
STEPS_FIRST, STEPS_ONE, STEPS_ALL = 15, 6, 5
TOLERANCE = 1e-4


def count_first_views(tracks: Tracks) -> int:
    """Returns the number of initial keyframes: up to the one with a wide enough motion, or few shared points."""
    for j in range(2, min(MOST_FIRST, len(tracks.views))):
        a, b = _shared(tracks, 0, j)
        if len(a) < LEAST_SHARED:
            return max(j, 2)
        if np.median(np.linalg.norm(tracks.uv[b] - tracks.uv[a], axis=1)) > FIRST_SHARE * tracks.size[0]:
            return j + 1
    return min(MOST_FIRST, len(tracks.views))


def initialise(tracks: Tracks, lens: Array, prior: LensPrior, unit_px: float, count: int) -> tuple[Scene, float] | None:
    """Returns the first `count` keyframes, by the best of the motions that their first and last one allow; and its
    cost.

    The poses between start at their share of the motion. None where too few points are shared.
    """
    a, b = _shared(tracks, 0, count - 1)
    if len(a) < 8:
        return None
    still = np.tile(np.eye(3), (len(tracks.views), 1, 1)), np.zeros((len(tracks.views), 3))
    start = Scene(lens.copy(), *still, np.tile([0, 0, 1.0, 0], (tracks.points, 1)))
    pinhole = replace(start.camera, distortion=())  # the guess has no distortion
    x1, x2 = (pinhole.normalise(tracks.uv[each]) for each in (a, b))
    seen = tracks.in_views(0, count).observations
    best: tuple[Scene, float] | None = None
    for motion in hypotheses(x1, x2, EPIPOLAR_PX / np.exp(lens[0])).second_from_first:
        rotations, translations = (each.copy() for each in still)
        for v in range(count):
            pose = Pose.exp(v / (count - 1) * motion.log())
            rotations[v], translations[v] = pose.rotation, pose.translation
        scene = replace(start, rotations=rotations, translations=translations)
        scene = triangulate(scene, seen, np.unique(seen.point))
        scene, _ = adjust_scene(scene, seen, prior, ROUGH_PX * unit_px, STEPS_FIRST)
        found = adjust_scene(scene, seen, prior, FINE_PX * unit_px, STEPS_FIRST)
        if best is None or found[1] < best[1]:
            best = found
    return best


def add_keyframes(scene: Scene, tracks: Tracks, prior: LensPrior, unit_px: float, count: int) -> Scene:
    """Adds all keyframes, from the first `count` on."""
    views = len(tracks.views)
    for v in range(count, views):
        before, now = tracks.in_views(0, v), tracks.in_views(v, v + 1)
        scene = _localise(scene, v, now.observations.select(np.isin(now.point, before.point)), unit_px)
        seen = tracks.in_views(0, v + 1).observations
        counts = np.bincount(seen.point, minlength=tracks.points)
        scene = triangulate(scene, seen, now.point[counts[now.point] == 2])
        if (v - count) % EVERY == EVERY - 1 or v == views - 1:
            scene, _ = adjust_scene(scene, seen, prior, FINE_PX * unit_px, STEPS_ALL)
    return scene


def _localise(scene: Scene, v: int, seen: Observations, unit_px: float) -> Scene:
    """Adds view v by the points that it observes, starting from the pose of the view before."""
    alone = Scene(scene.lens, scene.rotations[v - 1 : v], scene.translations[v - 1 : v], scene.points[seen.point])
    own = Observations(np.zeros_like(seen.view), np.arange(len(seen.uv)), seen.uv)
    for width in (4 * ROUGH_PX, ROUGH_PX, FINE_PX):
        problem = localisation(alone, own, width * unit_px)
        alone = adjust(problem, alone, STEPS_ONE, TOLERANCE).values
    rotations, translations = scene.rotations.copy(), scene.translations.copy()
    rotations[v], translations[v] = alone.rotations[0], alone.translations[0]
    return replace(scene, rotations=rotations, translations=translations)


def triangulate(scene: Scene, seen: Observations, points: NDArray[np.int64]) -> Scene:
    """Places these points where their first and last rays meet (linear, homogeneous; Hartley & Zisserman 12.2), in
    front of both cameras; at infinity along the first ray where they do not."""
    first = np.searchsorted(seen.point, points)
    last = np.searchsorted(seen.point, points, side="right") - 1
    rows, rays = [], []
    for at in (first, last):
        x = scene.camera.normalise(seen.uv[at])
        pose = np.concatenate([scene.rotations[seen.view[at]], scene.translations[seen.view[at]][..., None]], axis=2)
        rows += [x[:, :1] * pose[:, 2] - pose[:, 0], x[:, 1:] * pose[:, 2] - pose[:, 1]]
        rays.append(np.concatenate([x, np.ones((len(x), 1))], axis=1))
    found = np.linalg.svd(np.stack(rows, axis=1))[2][:, 3]
    found *= np.where(found[:, 3:] < 0, -1.0, 1.0)
    places = scene.points.copy()
    places[points] = found
    trial = replace(scene, points=places)
    ahead = [trial.in_camera(seen.select(at))[:, 2] > 0 for at in (first, last)]
    far = np.zeros((len(points), 4))
    far[:, :3] = (np.swapaxes(scene.rotations[seen.view[first]], 1, 2) @ rays[0][..., None])[..., 0]
    far /= np.linalg.norm(far, axis=1, keepdims=True)
    places[points] = np.where((ahead[0] & ahead[1])[:, None], found, far)
    return replace(scene, points=places)


def _shared(tracks: Tracks, one: int, other: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the observations of the same points in two views."""
    a, b = np.flatnonzero(tracks.view == one), np.flatnonzero(tracks.view == other)
    _, i, j = np.intersect1d(tracks.point[a], tracks.point[b], return_indices=True)
    return a[i], b[j]
