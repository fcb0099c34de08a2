"""Sandwich covariance of a window's poses and corrections, for errors of any size and distribution.

The error of an estimate is H^-1 g, so its covariance is H^-1 S H^-1 (Huber 1967; White 1982). g is the gradient of the
cost at the true values, S its covariance. The inverse normal equations alone assume independent errors of one size and
fixed weights: in simulations they overestimate the precision, in some directions by half.

1. Curvature. H has the loss's own second derivatives (`kernels.reduce_points`), the points eliminated. If the loss is
   as narrow as the errors, standard deviations are a fifth to a third larger than with fixed weights.
2. Scores. The score of a track is its part of g. S is the sum of the squared scores: errors of one track may be
   correlated between its views (Liang & Zeger 1986). Tracks that continue after marginalisation keep their scores in
   the prior (`prior.PendingScores`), and are squared with their later ones.
3. Leaving out. The estimate follows its tracks, so their residuals are too small. A score is taken, to first order, as
   if its track had not contributed to the estimate (a jackknife; Bell & McCaffrey 2002).
4. Clusters. Neighbours share pixels, a surface and what lies in front of it: in sim:tiny and sim:indoor their scores
   are correlated up to 90 px apart, which adds a tenth to the variance of a pose. So S is multiplied by the ratio of
   the squared scores of groups of neighbours to those of single tracks. The squares of groups alone would be too noisy:
   a pose depends mostly on fifteen of them, and has six axes.
5. Small sample. The squares of few scores are a noisy covariance; its inverse is too large on average (the mean of an
   inverse Wishart matrix), as in Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel
from ispom.numerics.places import places
from ispom.solvers.window.adjustment import Equations, Window
from ispom.solvers.window.kernels import LEAST_SHARE, OWN_CURVATURE, Eliminated
from ispom.solvers.window.prior import POSE, PendingScores, Sandwich
from ispom.solvers.window.scores import score_changes, track_scores

IMAGE_CELLS = 7, 5
"""Number of cells of the image along x and y: the tracks of a cell are a group. In images of 640 pixels a cell is 90 px
wide, the distance up to which scores are correlated (see 4.)."""
CELL_OFFSETS = (0.0, 0.0), (0.5, 0.5)
"""Offsets of two groupings, in cells, which are averaged: neighbours across a border of one are in a group of the
other."""
MAX_GROUPS = (IMAGE_CELLS[0] + 1) * (IMAGE_CELLS[1] + 1)
"""Largest number of groups."""
MIN_EIGENVALUE = 1e-15
"""Smallest eigenvalue of the normal equations, as a share of the largest, that is not rounding."""
MIN_FREEDOM = 0.1
"""Least degrees of freedom of the small-sample factor, as a share of the effective number of tracks."""


@dataclass(frozen=True, eq=False)
class WindowCovariance:
    """Covariance of a window, D = 6 C + E unknowns: left twists of the poses, and corrections."""

    window: Window
    scale: float
    """Width of the loss."""
    ids: NDArray[np.int64]
    """(M,) ids of the tracks."""
    eliminated: Eliminated
    """The eliminated points, with the loss's own second derivatives."""
    curvature: Array
    """(D, D) H, including the prior's."""
    scores: Array
    """(M, D) score of each track, including its earlier ones."""
    pending: PendingScores
    """Scores of tracks that have earlier ones but are not in the window."""
    prior_scatter: Array
    """(D, D) S of the prior."""

    @staticmethod
    def of(window: Window, ids: NDArray[np.int64], scale: float) -> WindowCovariance:
        """Computes curvature and scores of a window with tracks `ids` (M,), ascending; `scale`: width of the loss."""
        equations, prior = Equations.of(window, scale, second_order=OWN_CURVATURE), window.prior
        size, curvature, last = len(equations.right), equations.symmetric, POSE * len(window.rotations)
        scores = track_scores(window.observed, equations.eliminated, len(window.extra), scale)
        pending, scatter = PendingScores.none(size), np.zeros((size, size))
        if prior is not None:
            known = POSE * len(prior.rotations)
            at = np.concatenate([np.arange(known), np.arange(last, size)])
            sandwich = prior.sandwich or Sandwich(prior.hessian, prior.hessian)
            curvature[np.ix_(at, at)] += sandwich.curvature - prior.hessian
            scatter[np.ix_(at, at)] = sandwich.scatter
            if sandwich.pending is not None:
                earlier = np.zeros((len(sandwich.pending.ids), size))
                earlier[:, at] = sandwich.pending.scores
                place = places(ids, sandwich.pending.ids)
                scores[place[place >= 0]] += earlier[place >= 0]
                pending = PendingScores(sandwich.pending.ids[place < 0], earlier[place < 0])
        return WindowCovariance(window, scale, ids, equations.eliminated, curvature, scores, pending, scatter)

    @cached_property
    def inverse(self) -> Array:
        """Returns H^-1 (D, D): the covariance for independent errors with the width of the loss."""
        return inverse_curvature(self.curvature, Equations.of(self.window, self.scale).symmetric)

    @cached_property
    def left_out(self) -> Array:
        """Returns the score (M, D) of each track as if it had not contributed to the estimate."""
        return self._left_out(np.arange(len(self.ids)), self.scores, self.inverse)

    @cached_property
    def inflation(self) -> float:
        """Returns the factor of the squared scores, for their correlation and for the small sample."""
        return self._inflation(np.ones(len(self.ids), bool), self.left_out, self.inverse)

    @property
    def whole(self) -> Array:
        """Returns the covariance (D, D) of all poses and corrections."""
        own, pending = self.left_out, self.pending.scores
        scatter = self.prior_scatter + self.inflation * own.T @ own + pending.T @ pending
        found = self.inverse @ scatter @ self.inverse
        return (found + found.T) / 2

    @property
    def newest(self) -> Array:
        """Returns the covariance (6, 6) of the newest pose, as a left twist."""
        by_score = self._by_score(self.inverse)
        own, pending = self.left_out @ by_score, self.pending.scores @ by_score
        return by_score.T @ self.prior_scatter @ by_score + self.inflation * own.T @ own + pending.T @ pending

    def marginal(self, continuing: NDArray[np.int64], inverse: Array) -> Sandwich:
        """Returns the sandwich of this window as the marginalised part of a larger one.

        Tracks `continuing` (N,) are not squared yet. `inverse` (D, D) is that of the whole window; with zeros the
        scores stay as they are.
        """
        ends, pending_ends = (~np.isin(own, continuing, kind="table") for own in (self.ids, self.pending.ids))
        own = self._left_out(np.arange(len(self.ids)), self.scores, inverse)
        ended, last = self.pending.scores[pending_ends], own[ends]
        inflation = self._inflation(ends, own, inverse)
        left = PendingScores(self.pending.ids[~pending_ends], self.pending.scores[~pending_ends])
        return Sandwich(
            self.curvature,
            self.prior_scatter + inflation * last.T @ last + ended.T @ ended,
            left.and_of(self.ids[~ends], self.scores[~ends]),
        )

    def point_jacobians(self, chosen: NDArray[np.bool_]) -> Array:
        """Returns the Jacobians (N, 3, D) of the points of the mask `chosen` (M,) by poses and corrections."""
        window, eliminated = self.window, self.eliminated
        last, shown = POSE * len(window.rotations), window.shown
        rows = np.flatnonzero(chosen[window.owners])
        number = (np.cumsum(chosen) - 1)[window.owners[rows]]
        q, by_q = np.split(eliminated.mixed[rows], [3], axis=1)
        by_q = by_q.reshape(-1, 3, 3)
        mixed = np.zeros((int(chosen.sum()), len(self.curvature), 3))
        at = POSE * window.cameras[rows, None] + np.arange(POSE)
        mixed[number[:, None], at] = np.concatenate([by_q, np.cross(q[:, :, None], by_q, axis=1)], axis=1)
        mixed[:, last : last + shown] = eliminated.mixed_extra[chosen, :, :shown].transpose(0, 2, 1)
        symmetric = eliminated.inverses[chosen][:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        return -symmetric @ mixed.transpose(0, 2, 1)

    def _by_score(self, inverse: Array) -> Array:
        """Returns the derivative (D, 6) of the newest pose by a score."""
        last = POSE * len(self.window.rotations)
        return inverse[:, last - POSE : last]

    def _inflation(self, use: NDArray[np.bool_], left_out: Array, inverse: Array) -> float:
        """Returns the cluster inflation of the newest pose by the tracks of the mask `use` (M,); groups are by the
        positions of their newest observations."""
        if not use.any():
            return 1.0
        newest = self.window.seen[np.append(np.flatnonzero(np.diff(self.window.owners)), -1), :2]
        by_score, grouped = self._by_score(inverse), list[Array]()
        for cell in cells(newest):
            cell[~use] = MAX_GROUPS
            scores = sum_by_group(MAX_GROUPS + 1, cell, self.scores)
            scores[MAX_GROUPS] = 0.0
            grouped.append(self._left_out(cell, scores, inverse)[:MAX_GROUPS] @ by_score)
        return cluster_inflation(left_out[use] @ by_score, grouped)

    def _left_out(self, groups: NDArray[np.int64], scores: Array, inverse: Array) -> Array:
        """Returns the `scores` (G, D) of groups (M,) of tracks, as if each had not contributed to the estimate."""
        moved = scores @ inverse
        observed, eliminated = self.window.observed, self.eliminated
        return scores + score_changes(observed, eliminated, self.scale, OWN_CURVATURE, groups, moved)


def inverse_curvature(own: Array, fixed: Array) -> Array:
    """Inverts `own` (D, D), the loss's own second derivatives, which may be indefinite.

    Each direction keeps at least LEAST_SHARE of `fixed` (D, D), those with fixed weights, which are positive
    semidefinite; directions in which these vanish get 0.
    """
    diagonal = fixed.diagonal()
    unit = np.where(diagonal > 0, 1 / np.sqrt(np.maximum(diagonal, 1e-300)), 0.0)  # a gauge prior is 1e12 times larger
    fixed, own = unit[:, None] * fixed * unit, unit[:, None] * own * unit
    inverse = _plain_inverse(own, fixed)
    if inverse is not None:
        return unit[:, None] * inverse * unit
    values, vectors = np.linalg.eigh(fixed)
    known = values > MIN_EIGENVALUE * values[-1]
    root = vectors[:, known] / np.sqrt(values[known])
    share, turn = np.linalg.eigh(root.T @ own @ root)
    found = unit[:, None] * (root @ turn)
    return found / np.maximum(share, LEAST_SHARE) @ found.T


def _plain_inverse(own: Array, fixed: Array) -> Array | None:
    """Returns the inverse (D, D) of `own`; None where a direction keeps less than LEAST_SHARE of `fixed`, or where
    `own`, whose diagonal is of the size of 1, is close to singular."""
    try:
        np.linalg.cholesky(own - LEAST_SHARE * fixed)
        inverse = np.linalg.inv(own)
    except np.linalg.LinAlgError:
        return None
    return (inverse + inverse.T) / 2 if inverse.trace() < 1e-3 / MIN_EIGENVALUE else None


def cells(seen: Array) -> list[NDArray[np.int64]]:
    """Returns, for each of CELL_OFFSETS, the group (M,) below MAX_GROUPS of each position (M, 2)."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    place = (seen - low) / np.maximum(high - low, 1e-12) * (1 - 1e-9) * IMAGE_CELLS
    return [(place + shift).astype(np.int64) @ (IMAGE_CELLS[1] + 1, 1) for shift in CELL_OFFSETS]


def sum_by_group(count: int, groups: NDArray[np.int64], rows: Array) -> Array:
    """Returns the sums (G, D) of `rows` (M, D) over each of `count` groups; `groups` (M,)."""
    out = np.zeros((count, rows.shape[1]))
    _sum(groups, rows, out)
    return out


def cluster_inflation(left_out: Array, grouped: Sequence[Array]) -> float:
    """Returns the factor of a pose's variance from single tracks, for correlated neighbours and the small sample.

    `left_out` (N, D) are the changes of the pose by each track, `grouped` (G, D) those by groups of neighbours, for one
    or more groupings.
    """
    inverse = np.linalg.pinv(left_out.T @ left_out, rtol=1e-12, hermitian=True)
    squares = sum(float(np.sum(inverse * (each.T @ each))) for each in grouped)
    together = max(squares / (len(grouped) * left_out.shape[1]), 1.0)
    return together * _small_sample_factor(left_out, inverse, together)


def _small_sample_factor(left_out: Array, inverse: Array, together: float) -> float:
    """Returns the factor of a pose's variance from the squares of few changes `left_out` (N, D), by their `inverse`.

    It is the mean of the inverse Wishart matrix of as many equal contributions, by their fourth moments. If
    contributions are correlated, so that their squares are `together` times as large, their number is divided by that.
    """
    axes = left_out.shape[1]
    sizes = ((left_out @ inverse) * left_out).sum(axis=1)
    if not sizes.any():
        return 1.0
    count = axes * (axes + 2) / float(sizes @ sizes) / together
    return count / max(count - axes - 1, MIN_FREEDOM * count)


@kernel()
def _sum(groups, rows, out):
    for m in range(len(rows)):
        row, into = rows[m], out[groups[m]]
        for d in range(len(into)):
            into[d] += row[d]
