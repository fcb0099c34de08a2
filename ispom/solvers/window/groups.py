"""Sandwich covariance of a window's poses from the scores of its tracks, for errors of any distribution.

The error of an estimate is H^-1 g, so its covariance is the sandwich H^-1 S H^-1 (Huber 1967; White 1982), with S the
covariance of the cost's gradient g at the true values. H has the loss's own second derivatives: if the loss is as
narrow as the errors, standard deviations are a fifth to a third larger than with fixed weights. S is the sum over
tracks of their squared scores, so errors within a track may be correlated, between views and with those of the rows.
Correlation between neighbours increases it (`neighbours.cluster_inflation`), by the positions of their newest
observations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.places import places
from ispom.solvers.neighbours import GROUPS, by_group, cells, cluster_inflation
from ispom.solvers.window.adjustment import Equations, Window, covariance
from ispom.solvers.window.kernels import Eliminated
from ispom.solvers.window.prior import POSE, PendingScores, Sandwich
from ispom.solvers.window.slopes import followed, slopes

BENDS = 2.0
"""Value of `bends` that selects the loss's own second derivatives, see kernels.reduce_points."""


@dataclass(frozen=True, eq=False)
class Groups:
    """Scores of a window's tracks for poses and corrections, D = 6 C + E unknowns."""

    window: Window
    scale: float
    """Scale of the loss."""
    eliminated: Eliminated
    """The eliminated points, with the loss's own second derivatives."""
    ids: NDArray[np.int64]
    """(M,) ids of the tracks."""
    slopes: Array
    """(M, D) score of each track, including its earlier ones."""
    others: PendingScores
    """Scores of tracks that have earlier ones but are not in the window."""
    curvature: Array
    """(D, D) H, including the prior's."""
    scatter: Array
    """(D, D) S of the prior."""

    @staticmethod
    def of(window: Window, ids: NDArray[np.int64], scale: float) -> Groups:
        """Computes the scores of a window with tracks `ids` (M,), ascending."""
        equations, prior = Equations.of(window, scale, bends=BENDS), window.prior
        size, known_to, corrections = len(equations.right), 0, POSE * len(window.rotations)
        curvature, others = equations.symmetric, PendingScores.none(size)
        scatter = np.zeros((size, size))
        said = slopes(window.observed, equations.eliminated, len(window.extra), scale)
        if prior is not None and prior.sandwich is not None:
            known_to = POSE * len(prior.rotations)
            at = np.concatenate([np.arange(known_to), np.arange(corrections, size)])
            curvature[np.ix_(at, at)] += prior.sandwich.curvature - prior.hessian
            scatter[np.ix_(at, at)] = prior.sandwich.scatter
            if prior.sandwich.lasting is not None:
                before = prior.sandwich.lasting
                then = np.zeros((len(before.ids), size))
                then[:, :known_to], then[:, corrections:] = np.split(before.slopes, [known_to], axis=1)
                place = places(ids, before.ids)
                said[place[place >= 0]] += then[place >= 0]
                others = PendingScores(before.ids[place < 0], then[place < 0])
        return Groups(window, scale, equations.eliminated, ids, said, others, curvature, scatter)

    @cached_property
    def covariance(self) -> Array:
        """Returns the covariance (D, D) for independent errors with the width of the loss."""
        try:
            np.linalg.cholesky(self.curvature)
        except np.linalg.LinAlgError:
            return covariance(self.window, self.scale)  # fixed weights, as H is not positive definite numerically
        return np.linalg.inv(self.curvature)

    def newest(self) -> Array:
        """Returns the sandwich covariance (6, 6) of the newest pose, as a left twist."""
        way = self._way(self.covariance)
        alone, others = self._alone(self.covariance) @ way, self.others.slopes @ way
        wider = self._wider(np.ones(len(self.ids), bool), self.covariance, alone)
        return wider * alone.T @ alone + way.T @ self.scatter @ way + others.T @ others

    def sandwich(self, lasting: NDArray[np.int64], known: Array) -> Sandwich:
        """Returns the sandwich of the marginalised part; tracks `lasting` (N,) continue, `known` (D, D) is the whole
        window's `covariance`."""
        go_on, others_go = (np.isin(own, lasting, kind="table") for own in (self.ids, self.others.ids))
        ended, alone = self.others.slopes[~others_go], self._alone(known)[~go_on]
        wider = self._wider(~go_on, known, alone @ self._way(known))
        scatter = self.scatter + wider * alone.T @ alone + ended.T @ ended
        left = PendingScores(self.others.ids[others_go], self.others.slopes[others_go])
        return Sandwich(self.curvature, scatter, left.and_of(self.ids[go_on], self.slopes[go_on]))

    def _way(self, known: Array) -> Array:
        """Returns the derivative (D, 6) of the newest pose by a score."""
        last = POSE * len(self.window.rotations)
        return known[:, last - POSE : last]

    def _alone(self, known: Array) -> Array:
        """Returns the score (M, D) of each track, as if it had not contributed to the estimate."""
        return self._without(np.arange(len(self.ids)), self.slopes, known)

    def _wider(self, use: NDArray[np.bool_], known: Array, alone: Array) -> float:
        """Returns the cluster inflation of the tracks in `use` (M,), which move the newest pose by `alone` (N, 6)."""
        if not use.any():
            return 1.0
        newest, groups = self.window.seen[np.append(np.flatnonzero(np.diff(self.window.owners)), -1), :2], list[Array]()
        for cell in cells(newest):
            cell[~use] = GROUPS
            said = by_group(GROUPS + 1, cell, self.slopes)
            said[GROUPS] = 0.0
            groups.append(self._without(cell, said, known)[:GROUPS] @ self._way(known))
        return cluster_inflation(alone, groups)

    def _without(self, groups: NDArray[np.int64], said: Array, known: Array) -> Array:
        """Returns the scores `said` (G, D) of groups of tracks, as if each had not contributed to the estimate."""
        return said + followed(self.window.observed, self.eliminated, self.scale, BENDS, groups, said @ known)
