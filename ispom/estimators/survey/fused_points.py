"""Points that the nodes of a window observe: inverse depths, residuals and derivatives of all tracks at once.

A point is (a, b, r): (a, b, 1) is its direction in the camera of the first node that sees it, r the inverse of its
depth there [1/m]. So a point far away, or one that has not moved yet, is no special case (Civera, Davison, Montiel
2008). Points are eliminated (Schur complement), so that only information about the poses remains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ispom.geometry import Array
from ispom.sensors.fusion import Node
from ispom.types import LensCorrection

LOSS = 3.0
"""Width of the robust loss of an observation [standard deviations]."""
INVERSE_DEPTH = 1.0
"""Standard deviation of an inverse depth that nothing has shown yet [1/m]: of points a metre away or farther."""
FEWEST_VIEWS = 2
"""Nodes that see a track that takes part."""
NEAREST = 1e-3
"""A point this near to the plane of a camera, or behind it, has no image there."""
MOST_TRACKS = 150
"""Tracks that take part at once, those with the most views first: more cost time, and hardly add to the poses."""
WORST = 1e3
"""Residual of a point behind the camera [standard deviations]."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Observations about the present estimate, in standard deviations."""

    residuals: Array
    """(O, 2)."""
    weights: Array
    """(O,) of the loss."""
    by_view: Array
    """(O, 2, 6) derivatives by the twist (phi, rho) of the camera that observes the point."""
    by_anchor: Array
    """(O, 2, 6) derivatives by the twist of the camera that observed it first."""
    by_point: Array
    """(O, 2, 3) derivatives by the point."""


class Sights:
    """The observations of a window, sorted by track."""

    def __init__(
        self,
        nodes: tuple[Node, ...],
        sigma: float,
        among: NDArray[np.int64] | None = None,
        most: int = MOST_TRACKS,
        lens: LensCorrection | None = None,
    ) -> None:
        """`sigma`: standard deviation of a normalised coordinate. `most`: largest number of tracks, those with the most
        views. `among`: ids of tracks to which they are restricted. `lens`: correction of the calibration."""
        ids = np.concatenate([n.points.ids for n in nodes])
        points = [n.points if lens is None else n.points.corrected(lens) for n in nodes]
        xy = np.concatenate([each.xy for each in points]).astype(float)
        view = np.repeat(np.arange(len(nodes)), [len(n.points) for n in nodes])
        _, track, counts = np.unique(ids, return_inverse=True, return_counts=True)
        rank = np.empty(len(counts), np.int64)
        rank[np.argsort(-counts, kind="stable")] = np.arange(len(counts))
        kept = (counts[track] >= FEWEST_VIEWS) & (rank[track] < most)
        if among is not None:
            kept &= np.isin(ids, among)
        order = np.flatnonzero(kept)
        order = order[np.argsort(ids[order], kind="stable")]
        self.ids, first, self.track = np.unique(ids[order], return_index=True, return_inverse=True)
        self.view, self.xy, self._sigma = view[order], xy[order], sigma
        self.anchor = self.view[first][self.track] if len(order) else self.view
        self.start = np.hstack([self.xy[first], np.zeros((len(first), 1))])
        """(T, 3) points in the directions of their first observation."""

    def __len__(self) -> int:
        return len(self.ids)

    def linear(self, turns: Array, places: Array, points: Array) -> Linear:
        """Returns the observations about cameras (K, 3, 3), (K, 3) [world_from_camera] and points (T, 3)."""
        here, there = self.view, self.anchor
        between = np.einsum("nji,njk->nik", turns[here], turns[there])
        step = np.einsum("nji,nj->ni", turns[here], places[there] - places[here])
        own = points[self.track]
        ray, inverse = np.hstack([own[:, :2], np.ones((len(own), 1))]), own[:, 2:]
        q = np.einsum("nij,nj->ni", between, ray) + inverse * step
        ahead = q[:, 2] > NEAREST
        z = np.where(ahead, q[:, 2], 1.0)
        xy = q[:, :2] / z[:, None]
        residuals = np.where(ahead[:, None], (xy - self.xy) / self._sigma, WORST)
        squared = (residuals**2).sum(axis=1)
        by_q = np.zeros((len(q), 2, 3))
        by_q[:, 0, 0] = by_q[:, 1, 1] = 1.0
        by_q[:, :, 2] = -xy
        by_q *= (ahead / (z * self._sigma))[:, None, None]
        # The camera that sees it turns by phi and moves by rho: q changes by q x phi - r rho.
        by_view = np.concatenate([by_q @ _cross(q), -by_q * inverse[:, :, None]], axis=2)
        by_turned = by_q @ between
        by_anchor = np.concatenate([-by_turned @ _cross(ray), by_turned * inverse[:, :, None]], axis=2)
        by_point = np.concatenate([by_turned[:, :, :2], (by_q @ step[:, :, None])], axis=2)
        return Linear(residuals, 1 / (1 + squared / LOSS**2), by_view, by_anchor, by_point)

    def cost(self, linear: Linear, points: Array) -> float:
        """Returns half the sum of squares, by the loss."""
        squared = (linear.residuals**2).sum(axis=1)
        return float(
            0.5 * LOSS**2 * np.log1p(squared / LOSS**2).sum() + 0.5 * (points[:, 2] ** 2).sum() / INVERSE_DEPTH**2
        )

    def placed(self, turns: Array, places: Array, points: Array, iterations: int = 2) -> Array:
        """Returns the points (T, 3) that fit best to cameras, from first estimates."""
        linear = self.linear(turns, places, points)
        best, damping = self._costs(linear, points), np.full(len(points), 1e-3)
        for _ in range(iterations):
            matrix, side = self._normal(linear, points)
            diagonal = np.einsum("tii->ti", matrix)
            moved = (
                points
                - np.linalg.solve(
                    matrix + np.einsum("ti,ij->tij", damping[:, None] * diagonal, np.eye(3)), side[:, :, None]
                )[:, :, 0]
            )
            moved[:, 2] = np.maximum(moved[:, 2], 0.0)
            trial = self.linear(turns, places, moved)
            costs = self._costs(trial, moved)
            better = costs <= best
            points, best = np.where(better[:, None], moved, points), np.where(better, costs, best)
            damping = np.where(better, damping / 10, damping * 10)
            linear = self.linear(turns, places, points)
        return points

    def _costs(self, linear: Linear, points: Array) -> Array:
        """Returns costs (T,) by track."""
        squared = (linear.residuals**2).sum(axis=1)
        own = 0.5 * LOSS**2 * np.log1p(squared / LOSS**2)
        return np.bincount(self.track, own, len(self)) + 0.5 * points[:, 2] ** 2 / INVERSE_DEPTH**2

    def _normal(self, linear: Linear, points: Array) -> tuple[Array, Array]:
        """Returns (T, 3, 3) and (T, 3): normal equations of the points alone."""
        weighted = linear.by_point * linear.weights[:, None, None]
        matrix, side = np.zeros((len(self), 3, 3)), np.zeros((len(self), 3))
        np.add.at(matrix, self.track, np.einsum("nki,nkj->nij", weighted, linear.by_point))
        np.add.at(side, self.track, np.einsum("nki,nk->ni", weighted, linear.residuals))
        matrix[:, 2, 2] += INVERSE_DEPTH**-2
        side[:, 2] += points[:, 2] / INVERSE_DEPTH**2
        return matrix + 1e-9 * np.eye(3), side

    def reduced(self, linear: Linear, points: Array, count: int) -> tuple[csr_matrix, Array]:
        """Returns the information (6 K, 6 K) of the `count` cameras and the vector (6 K,), without the points."""
        seen = len(self.view)
        root = np.sqrt(linear.weights)
        rows = np.broadcast_to(np.arange(2 * seen).reshape(seen, 2, 1), (seen, 2, 6))
        other = self.view != self.anchor  # an observation in its anchor's own camera does not depend on its pose
        columns = [
            6 * at[:, None, None] + np.broadcast_to(np.arange(6), (seen, 2, 6)) for at in (self.view, self.anchor)
        ]
        values = [part * (root * other)[:, None, None] for part in (linear.by_view, linear.by_anchor)]
        flat = [np.concatenate([a.ravel(), b.ravel()]) for a, b in ((values[0], values[1]), (rows, rows), columns)]
        by_pose = csr_matrix((flat[0], (flat[1], flat[2])), shape=(2 * seen, 6 * count))
        at_point = 3 * self.track[:, None, None] + np.broadcast_to(np.arange(3), (seen, 2, 3))
        own = linear.by_point * root[:, None, None]
        by_point = csr_matrix(
            (own.ravel(), (rows[:, :, :3].ravel(), at_point.ravel())), shape=(2 * seen, 3 * len(self))
        )
        matrix, side = self._normal(linear, points)
        inverse = np.linalg.inv(matrix)
        index = np.arange(3 * len(self)).reshape(-1, 3)
        spread = csr_matrix(
            (
                inverse.ravel(),
                (np.repeat(index, 3, axis=1).ravel(), np.tile(index, (1, 3)).ravel()),
            ),
            shape=(3 * len(self),) * 2,
        )
        residual = (linear.residuals * root[:, None]).ravel()
        coupled = by_pose.T @ by_point
        information = by_pose.T @ by_pose - coupled @ spread @ coupled.T
        return information.tocsr(), -(by_pose.T @ residual - coupled @ (inverse @ side[:, :, None]).ravel())


def _cross(v: Array) -> Array:
    """Returns (N, 3, 3) matrices of cross products with (N, 3) vectors."""
    x, y, z = v.T
    zero = np.zeros(len(v))
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
