"""Sampson distances: the errors of matches to first order, as a measure of relative poses in tests."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose, skew


def sampson_distance(second_from_first: Pose, x1: Array, x2: Array) -> Array:
    """Returns signed Sampson distances (N,), in normalised units, from the epipolar geometry of a relative pose."""
    essential = skew(second_from_first.translation) @ second_from_first.rotation
    h1, h2 = (np.column_stack([x, np.ones(len(x))]) for x in (x1, x2))
    line2, line1 = h1 @ essential.T, h2 @ essential
    scale = np.sqrt((line2[:, :2] ** 2).sum(1) + (line1[:, :2] ** 2).sum(1))
    return (h2 * line2).sum(1) / np.maximum(scale, 1e-12)
