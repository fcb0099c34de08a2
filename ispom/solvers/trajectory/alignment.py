"""Aligns corresponding points in closed form (Umeyama 1991; Horn 1987 without scale)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ispom.geometry import Array, Pose, Similarity


def umeyama(source: Array, target: Array, with_scale: bool) -> Similarity:
    """Returns target_from_source of points (N, 3) and (N, 3), N >= 1, that minimises the squared distances.

    Points on a line do not determine the rotation about it, a single point no rotation: one of the best is returned.
    Without extent in the source the scale stays 1. Raises ValueError for no points or unequal numbers.
    """
    if source.shape != target.shape or not len(source):
        raise ValueError(f"alignment needs as many source as target points, not {source.shape} and {target.shape}")
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    from_mean, to_mean = source - mean_source, target - mean_target
    covariance, variance = to_mean.T @ from_mean / len(source), float((from_mean**2).sum()) / len(source)
    return _of_moments(mean_source, mean_target, covariance, variance, with_scale)


def _of_moments(
    mean_source: Array, mean_target: Array, covariance: Array, variance: float, with_scale: bool
) -> Similarity:
    u, singular, vt = np.linalg.svd(covariance)
    sign = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0 else -1.0])
    rotation = (u * sign) @ vt
    scale = float(singular @ sign) / variance if with_scale and variance > 0 else 1.0
    return Similarity(scale, Pose(rotation, mean_target - scale * rotation @ mean_source))


@dataclass
class RunningAlignment:
    """The alignment of points that arrive one by one, at constant cost for each, from running sums."""

    with_scale: bool = True
    count: int = 0
    _origins: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(3), np.zeros(3)))
    """The first points: sums relative to them avoid rounding errors."""
    _sums: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(3), np.zeros(3)))
    _products: Array = field(default_factory=lambda: np.zeros((3, 3)))
    _squares: float = 0.0

    def add(self, source: Array, target: Array) -> None:
        """Adds a pair of corresponding points (3,)."""
        if not self.count:
            self._origins = source.copy(), target.copy()
        a, b = source - self._origins[0], target - self._origins[1]
        self._sums = self._sums[0] + a, self._sums[1] + b
        self._products, self._squares = self._products + np.outer(b, a), self._squares + float(a @ a)
        self.count += 1

    @property
    def target_from_source(self) -> Similarity:
        """Returns the result of `umeyama` for all points so far, at least one."""
        mean_a, mean_b = self._sums[0] / self.count, self._sums[1] / self.count
        covariance = self._products / self.count - np.outer(mean_b, mean_a)
        variance = self._squares / self.count - float(mean_a @ mean_a)
        means = self._origins[0] + mean_a, self._origins[1] + mean_b
        return _of_moments(*means, covariance, variance, self.with_scale)
