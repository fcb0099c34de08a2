"""How sure a window is of its poses by what the tracks of each part of the image say, whatever their errors are like.

An estimate is off by H^-1 g, so its covariance is the sandwich H^-1 S H^-1 (Huber 1967; White 1982), S the covariance
of the slope g of the cost at the truth. H has the loss's own second derivatives: where the loss is as narrow as the
errors, poses are off by a fifth to a third more than with weights held. S is the sum over groups of tracks of the
squares of what each group says (Liang & Zeger 1986): within one, errors may hang together as they like, from view to
view, with those of the rows, and from neighbour to neighbour. Neighbours share pixels, a surface and what stands before
it: at the truth of sim:tiny and indoors, their slopes hang together up to some 90 px apart, which adds a fifth to the
variance.

What a group says is as it would be, to first order, had it had no part in the estimate (a jackknife: Bell & McCaffrey
2002), and S is as much larger as few groups leave open (Student's t).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.places import places
from ispom.solvers.window.adjustment import Equations, Window, covariance
from ispom.solvers.window.kernels import Eliminated
from ispom.solvers.window.prior import POSE, Lasting, Sandwich
from ispom.solvers.window.slopes import by_group, followed, slopes

CELLS = 8, 6
"""Of the image, across and down: tracks whose newest places are in one are a group. In images of 640 pixels a cell is
wider than neighbours hang together."""
SHIFTS = (0.0, 0.0), (0.5, 0.5)
"""Of the cells, in cells; S is the mean over them: neighbours on both sides of a border are a group in another."""
LEAST_SHARE = 0.1
"""Of groups that count, where there are hardly more than unknowns."""
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
    others: Lasting
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
        curvature, scatter, others = equations.symmetric, np.zeros((size, size)), Lasting.none(size)
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
                others = Lasting(before.ids[place < 0], then[place < 0])
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
        last, known = POSE * len(self.window.rotations), self.covariance
        way = known[:, last - POSE : last]
        others = self.others.slopes @ way
        squares, groups = self._squares(np.ones(len(self.ids), bool), known, way)
        return _open(groups) * squares + way.T @ self.scatter @ way + others.T @ others

    def sandwich(self, lasting: NDArray[np.int64], known: Array) -> Sandwich:
        """Of what is marginalised; tracks `lasting` (N,) go on. `known` (D, D): `covariance` of the whole window."""
        go_on, others_go = (np.isin(own, lasting, kind="table") for own in (self.ids, self.others.ids))
        ended = self.others.slopes[~others_go]
        scatter = self.scatter + self._squares(~go_on, known)[0] + ended.T @ ended
        left = Lasting(self.others.ids[others_go], self.others.slopes[others_go])
        return Sandwich(self.curvature, scatter, left.and_of(self.ids[go_on], self.slopes[go_on]))

    def _squares(self, use: NDArray[np.bool_], known: Array, way: Array | None = None) -> tuple[Array, float]:
        """(R, R) of what the groups of the tracks in `use` (M,) say, by `way` (D, R), or (D, D) by all, and how many
        groups they are: both the mean over SHIFTS."""
        size = len(known) if way is None else way.shape[1]
        total, count = np.zeros((size, size)), 0
        if not use.any():
            return total, 0.0
        newest = self.window.seen[np.append(np.flatnonzero(np.diff(self.window.owners)), -1), :2]
        low, high = newest.min(axis=0), newest.max(axis=0)
        place = (newest - low) / np.maximum(high - low, 1e-12) * (1 - 1e-9) * CELLS
        none = (CELLS[0] + 1) * (CELLS[1] + 1)
        for shift in SHIFTS:
            cell = (place + shift).astype(np.int64) @ (CELLS[1] + 1, 1)
            cell[~use] = none
            said = by_group(none + 1, cell, self.slopes)
            said[none] = 0.0
            said += followed(self.window.observed, self.eliminated, self.scale, BENDS, cell, said @ known)
            found = said[:none] if way is None else said[:none] @ way
            total += found.T @ found
            count += np.count_nonzero(np.bincount(cell, minlength=none)[:none])
        return total / len(SHIFTS), count / len(SHIFTS)


def _open(groups: float) -> float:
    """By how much the squares of deviations of a pose are larger than so many groups show: the mean of an inverse
    Wishart matrix."""
    return groups / max(groups - POSE - 1, LEAST_SHARE * groups) if groups else 1.0
