"""Covariance of a chain of motions whose tracks are seen in several of them.

A pose is the product of all motions since the start. The errors of a track in these motions are correlated: one
observation is in two successive motions, and an error of its disparity stays from pair to pair. So the changes of the
pose by a track are summed over its motions, and squared when it ends. This is a sandwich as in
`ispom.solvers.window.covariance`, with tracks as clusters (Liang and Zeger 1986), and with its factors for neighbours
and for few tracks. The sizes of errors are those of the residuals: no noise is assumed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.solvers.window.covariance import cells, cluster_inflation, sum_by_group

LEAST_LEFT = 1e-6
"""Least share of the information along an axis that is left without one group. Without any, the residuals of the group
show nothing."""


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of the present pose by each of N tracks."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) of the tracks, ascending."""
    twists: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """(N, 6) on the right of the pose [m, rad]."""
    settled: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) covariance of the pose by tracks that have ended, and by predictions."""

    @property
    def covariance(self) -> Array:
        """(6, 6) of the twist on the right of the pose."""
        return self.settled + self.twists.T @ self.twists

    def ended(self) -> Changes:
        """Returns them where all tracks end."""
        return Changes(settled=self.covariance)

    def after(self, step: Pose, ids: NDArray[np.int64], twists: Array, predicted: Array) -> Changes:
        """Returns the changes of the pose after one more motion.

        Args:
            step: before_from_now of the frame whose pose it is.
            ids: (M,) of its tracks, ascending; all others have ended.
            twists: (M, 6) by which each track changed the pose now.
            predicted: (6, 6) covariance of the pose now by the error of the prediction.
        """
        along = step.inverse().adjoint
        earlier, settled = self.twists @ along.T, along @ self.settled @ along.T + predicted
        both, mine = common(ids, self.ids)
        total = twists.copy()
        total[both] += earlier[mine]
        ended = np.delete(earlier, mine, axis=0)
        return Changes(ids, total, settled + ended.T @ ended)


@dataclass(frozen=True, eq=False)
class Linear:
    """A least-squares estimate of D unknowns from M tracks with R coordinates each."""

    inverse: Array
    """(D, D) inverse normal equations, including those of a prior."""
    derivatives: Array
    """(M, R, D) of the predicted coordinates, in standard deviations."""
    residuals: Array
    """(M, R) of the coordinates, in standard deviations."""

    def changes(self, uv: Array) -> Array:
        """Returns the changes (M, D) of the estimate by each track, whose squares add up to its covariance; `uv` (M, 2)
        are where the tracks are."""
        each = self._changes_by(np.arange(len(uv)))
        if not len(uv):
            return each
        grouped = [self._changes_by(np.unique(cell, return_inverse=True)[1]) for cell in cells(uv)]
        return np.sqrt(cluster_inflation(each, grouped)) * each

    def _changes_by(self, groups: NDArray[np.int64]) -> Array:
        """Returns the changes (G, D) by `groups` (M,) of tracks, from 0 on.

        An estimate follows its tracks, so that their residuals are too small. They are enlarged such that squares are
        right for independent errors (Bell and McCaffrey 2002).
        """
        size, count = len(self.inverse), int(groups.max(initial=-1)) + 1
        root = np.linalg.cholesky(self.inverse)
        derivatives = self.derivatives @ root
        scores = sum_by_group(count, groups, np.einsum("mrd,mr->md", derivatives, self.residuals))
        own = np.einsum("mra,mrb->mab", derivatives, derivatives).reshape(-1, size * size)
        shares, axes = np.linalg.eigh(sum_by_group(count, groups, own).reshape(-1, size, size))
        along = np.einsum("gab,ga->gb", axes, scores) / np.sqrt(np.maximum(1 - shares, LEAST_LEFT))
        return np.einsum("gab,gb->ga", axes, along) @ root.T
