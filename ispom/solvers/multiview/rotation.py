"""Finds the rotation that explains most of an image motion, and the remaining displacement: the parallax."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.numerics.reductions import lengths, median, squares
from ispom.numerics.robust import robust_weights
from ispom.solvers.rigid import horn

TURN_LOSS = 3.0
"""Width of the loss for a pure rotation, relative to that for a pose: parallax is an error there, too."""


def rotate(rotation: Array, x: Array) -> Array:
    """Returns normalised coordinates (N, 2) after a pure rotation (3, 3) second_from_first."""
    ray = x @ rotation[:, :2].T + rotation[:, 2]
    return ray[:, :2] / np.maximum(ray[:, 2:], 1e-6)


def dominant_rotation(x1: Array, x2: Array, scale: float, iterations: int = 5, weights: Array | None = None) -> Array:
    """Finds the rotation second_from_first (3, 3) that best maps rays (N, 2) to rays (N, 2), N >= 3: robust Wahba.

    Rays that move otherwise (near points of a moving camera) get low robust weights; `scale` is the width of the loss
    in normalised units. `weights` (N,) are prior weights of the rays, equal by default.
    """
    rays1, rays2 = _rays(x1), _rays(x2)
    given = np.ones(len(x1)) if weights is None else weights
    weight = given
    rotation = np.eye(3)
    for _ in range(iterations):
        w = np.sqrt(weight)[:, None]
        # Mirrored copies keep the centroids at the origin, so that Horn's method fits the rotation alone.
        rotation, _ = horn(np.concatenate([w * rays1, -w * rays1]), np.concatenate([w * rays2, -w * rays2]))
        weight = given * robust_weights(squares(rotate(rotation, x1) - x2), scale)
    return rotation


def median_displacement(rotation: Array, x1: Array, x2: Array) -> float:
    """Returns the median distance, in normalised units, of points from their positions by the rotation only."""
    return median(lengths(rotate(rotation, x1) - x2))


def _rays(x: Array) -> Array:
    rays = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)
