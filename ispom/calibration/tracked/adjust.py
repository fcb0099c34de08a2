"""Bundle adjustment of keyframes, points and lens along bent valleys, and realignment of drifted corners.

Where a scene is nearly flat or a camera moves nearly straight, focal length, depths and rotations are correlated along
a valley that is narrow and bent: a straight step leaves it after half a pixel of focal length and is refused, and
hundreds of damped ones would be needed. Geodesic acceleration (Transtrum & Sethna, arXiv:1201.5885) corrects a step by
the residuals' second derivative along it, with the same normal equations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.calibration.tracked.bundle import (
    LENS,
    MIN_DEPTH,
    POSE,
    Fixed,
    Normal,
    Observed,
    Prior,
    Scale,
    Scene,
    cost,
    in_camera,
    normal_equations,
    projected,
    reduced,
)
from ispom.calibration.tracked.tracks import Tracks
from ispom.features.patches import align
from ispom.geometry import Array
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.twist import moved

SHORT = 0.1
"""Share of a step over which its second derivative is a finite difference."""
FINE_FIRST, FINE_LOWEST = 1e-7, 1e-12
"""Damping at the start of `settled`, and its least: along such a valley the cost is bent 1e-9 as much as across it, or
less."""


def adjusted(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: Scale, iterations: int, tolerance: float = 1e-4
) -> tuple[Scene, float]:
    """Returns the scene of least cost, and that cost (in squares of the scale of the Cauchy loss)."""
    found = minimise(
        scene,
        lambda values: cost(values, seen, prior, scale_px),
        lambda values, damping: _stepped(values, seen, prior, fixed, scale_px, damping, bent=False),
        iterations,
        tolerance,
        highest=1e6,
    )
    return found.values, found.cost


def settled(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: Scale, iterations: int, tolerance: float
) -> tuple[Scene, float]:
    """Continues `adjusted` from near the least cost to it, along bent valleys as well."""
    found = minimise(
        scene,
        lambda values: cost(values, seen, prior, scale_px),
        lambda values, damping: _stepped(values, seen, prior, fixed, scale_px, damping, bent=True),
        iterations,
        tolerance,
        highest=1e6,
        first=FINE_FIRST,
        lowest=FINE_LOWEST,
    )
    return found.values, found.cost


def _stepped(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: Scale, damping: float, bent: bool
) -> Scene:
    normal = normal_equations(scene, seen, prior, fixed, scale_px, damping)
    matrix, gradient = reduced(normal)
    matrix = matrix + np.diag(damping * np.diag(normal.matrix) + 1e-9)
    step = -np.linalg.solve(matrix, gradient)
    along = _of_points(normal, normal.by_point, step)
    if bent:
        second = _second_derivative(scene, seen, normal, step, along)
        pull, by_point = normal.jacobian.gradient(second, seen, len(scene.rotations), len(scene.points))
        pull[normal.fixed] = 0.0
        inner = (normal.inverse @ by_point[..., None])[..., 0]
        turn = -np.linalg.solve(matrix, pull - np.tensordot(inner, normal.mixed, 2))
        step, along = step + 0.5 * turn, along + 0.5 * _of_points(normal, by_point, turn)
    return _gone(scene, normal, step, along)


def _of_points(normal: Normal, by_point: Array, step: Array) -> Array:
    """Returns the steps (M, 3) of the points with gradients (M, 3), after a step (P,) of lens and poses."""
    return -(normal.inverse @ (by_point + normal.mixed @ step)[..., None])[..., 0]


def _gone(scene: Scene, normal: Normal, step: Array, along: Array) -> Scene:
    points = scene.points + (normal.tangents @ along[..., None])[..., 0]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    rotations, translations = moved(scene.rotations, scene.translations, step[LENS:].reshape(-1, POSE))
    return replace(scene, lens=scene.lens + step[:LENS], rotations=rotations, translations=translations, points=points)


def _second_derivative(scene: Scene, seen: Observed, normal: Normal, step: Array, along: Array) -> Array:
    """Returns second derivatives (K, 2) of the weighted residuals along a step; 0 for points that it moves behind a
    camera."""
    places, ahead = [], np.ones(len(seen.uv), bool)
    for sign in (-1, 0, 1):
        there = _gone(scene, normal, sign * SHORT * step, sign * SHORT * along)
        q = in_camera(there, seen)
        ahead &= q[:, 2] > MIN_DEPTH
        places.append(projected(there.lens, np.where(q[:, 2:] > MIN_DEPTH, q, [0, 0, 1.0])))
    bend = (places[0] - 2 * places[1] + places[2]) / SHORT**2
    return np.where(ahead[:, None], normal.jacobian.root * bend, 0.0)


ALIKE = 0.8
"""Least correlation of two patches that show the same,"""
NEAR_PX = 2.0
"""which is so near to where the track was."""
ITERATIONS = 15
SMALL_STEP = 1e-3
"""Share of a point's distance over which a surface is flat and a lens has constant scale."""


def realigned(tracks: Tracks, scene: Scene) -> Tracks:
    """Aligns each corner with the patch of its first keyframe, warped by the geometry; drops those that do not
    match.

    Tracking from image to image drifts, and with growing or rotating surfaces it drifts in one direction: all tracks of
    a camera together, like a wrong lens. `scene` has the poses, points and lens by the tracks so far. Returns the
    tracks unchanged without `images`.
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
    """Returns pixels (N, 2, 2) of view `first` per pixel of view `now` around points (N, 4), on surfaces that face
    `now`."""
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
