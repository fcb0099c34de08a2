"""The closed-form motion between corresponding points (Umeyama 1991; Horn 1987 without scale)."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose, Similarity


def umeyama(source: Array, target: Array, with_scale: bool) -> Similarity:
    """target_from_source of points (N, 3) and (N, 3), N >= 1, that minimises the squared distances.

    Points on a line leave the turn about it open, a single point the whole rotation: one of the best is given.
    Without extent in the source the scale stays 1. Raises ValueError for no points or unequal numbers.
    """
    if source.shape != target.shape or not len(source):
        raise ValueError(f"alignment needs as many source as target points, not {source.shape} and {target.shape}")
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    from_mean, to_mean = source - mean_source, target - mean_target
    u, singular, vt = np.linalg.svd(to_mean.T @ from_mean / len(source))
    sign = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0 else -1.0])
    rotation = (u * sign) @ vt
    variance = float((from_mean**2).sum()) / len(source)
    scale = float(singular @ sign) / variance if with_scale and variance > 0 else 1.0
    return Similarity(scale, Pose(rotation, mean_target - scale * rotation @ mean_source))
