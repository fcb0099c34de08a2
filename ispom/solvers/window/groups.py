"""How sure a window is of its poses by what the tracks of each part of the image say, whatever their errors are like.

An estimate is off by H^-1 g, so its covariance is the sandwich H^-1 S H^-1 (Huber 1967; White 1982), S the covariance
of the slope g of the cost at the truth. H has the loss's own second derivatives: where the loss is as narrow as the
errors, poses are off by a fifth to a third more than with weights held. S is the sum over tracks of the squares of what
each says: within one, errors may hang together as they like, from view to view, with those of the rows. What neighbours
share makes it larger (`neighbours.widened`), by where their newest places are.
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
"""See kernels.reduce_points: the loss's own second derivatives."""


@dataclass(frozen=True, eq=False)
class Groups:
    """What the tracks of a window say of poses and corrections, D = 6 C + E."""

    window: Window
    scale: float
    """Of the loss."""
    eliminated: Eliminated
    """The points, by the loss's own second derivatives."""
    ids: NDArray[np.int64]
    """(M,) of the tracks."""
    slopes: Array
    """(M, D) what each says, with what it said before."""
    others: PendingScores
    """Of tracks that said something before, and are not in the window."""
    curvature: Array
    """(D, D) H, with the prior's."""
    scatter: Array
    """(D, D) S of the prior."""

    @staticmethod
    def of(window: Window, ids: NDArray[np.int64], scale: float) -> Groups:
        """Of a window whose tracks are `ids` (M,), ascending."""
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
        """(D, D) were all errors independent and as large as the loss says."""
        try:
            np.linalg.cholesky(self.curvature)
        except np.linalg.LinAlgError:
            return covariance(self.window, self.scale)  # weights held: no minimum, to the last digits
        return np.linalg.inv(self.curvature)

    def newest(self) -> Array:
        """(6, 6) covariance of the left twist of the newest pose."""
        way = self._way(self.covariance)
        alone, others = self._alone(self.covariance) @ way, self.others.slopes @ way
        wider = self._wider(np.ones(len(self.ids), bool), self.covariance, alone)
        return wider * alone.T @ alone + way.T @ self.scatter @ way + others.T @ others

    def sandwich(self, lasting: NDArray[np.int64], known: Array) -> Sandwich:
        """Of what is marginalised; tracks `lasting` (N,) go on. `known` (D, D): `covariance` of the whole window."""
        go_on, others_go = (np.isin(own, lasting, kind="table") for own in (self.ids, self.others.ids))
        ended, alone = self.others.slopes[~others_go], self._alone(known)[~go_on]
        wider = self._wider(~go_on, known, alone @ self._way(known))
        scatter = self.scatter + wider * alone.T @ alone + ended.T @ ended
        left = PendingScores(self.others.ids[others_go], self.others.slopes[others_go])
        return Sandwich(self.curvature, scatter, left.and_of(self.ids[go_on], self.slopes[go_on]))

    def _way(self, known: Array) -> Array:
        """(D, 6) how the newest pose follows a slope."""
        last = POSE * len(self.window.rotations)
        return known[:, last - POSE : last]

    def _alone(self, known: Array) -> Array:
        """(M, D) what each track says, as if it had had no part in the estimate."""
        return self._without(np.arange(len(self.ids)), self.slopes, known)

    def _wider(self, use: NDArray[np.bool_], known: Array, alone: Array) -> float:
        """See neighbours.widened, of the tracks in `use` (M,), which move the newest pose by `alone` (N, 6)."""
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
        """(G, D) what groups of tracks say, `said` (G, D), as if each had had no part in the estimate."""
        return said + followed(self.window.observed, self.eliminated, self.scale, BENDS, groups, said @ known)
