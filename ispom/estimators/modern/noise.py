"""How far off the tracks of one camera are, found from what they leave in each adjusted window.

A track is found again by a patch that is itself one of an earlier image: from key frame to key frame its errors add
up. Against the truth of simulations they are a random walk: its steps are uncorrelated, 0.07-0.1 px from pair to pair
and 0.1-0.15 px between key frames of the video (in images of half size), after five of them it is 0.15-0.25 px off,
and hardly any error is new in each image. An adjustment takes the errors of a track's views to be independent. What it
leaves does not say what it needs then: the point follows the walk, and the rest is a third of it (0.06 and 0.08 px);
but the ends of a track, which carry the pose from one key frame to a later one, are as far apart as all steps between
them. Hence `sigma`: the independent error that puts the ends of a track as far apart as they are. A constant is right
for one length of tracks, one interval between key frames and one texture; so 0.17 px stood for pairs, and 0.34 px for
the video's wider intervals and longer tracks. In the integration, where a track has a view in each video frame, 0.13 px
(and 0.26 px for pairs) only say how much the cameras count beside each other.

From the residuals r of a track with n views, r = P e with P what the point leaves of errors e (its null projector; the
poses, held by hundreds of tracks, take next to nothing). With E[e e'] = new^2 I + step^2 min(i, j) the expectations of
r' r and of the squares of its increments are known: two equations for `new` and `step`; a pair's right errors give the
third for the error of the disparity.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ispom.estimators.adjustment import ADJUSTED
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.window.adjustment import Adjusted, Window
from ispom.types import Check

MEMORY = 2
"""Adjustments until what one said counts a quarter. Hundreds of tracks tell it at once, and windows overlap; a longer
memory is behind where the key frames move apart, as they do after a start."""
BELIEVED = 20.0
"""Tracks that the setting counts as much as."""
LEAST_VIEWS = 3
"""Of a track that says something: with two, a point follows all but one of their errors."""
MOST = 64
"""Tracks of each length that are looked at: they tell it to some percent, in a time that is bounded."""
GRID = 8, 6
"""Cells of the image, across and down: each is wider than a patch, and has some ten tracks."""
QUANTILES = 64
"""By which means over normal errors are taken."""
GROSS = 10.0
"""Tracks with an error of so many scales of the loss are no images of one point."""


@dataclass(frozen=True, eq=False)
class TrackNoise:
    """What windows of one camera, or of one pair, said so far. All in normalised units."""

    expected: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """Sums over tracks of what an error of one makes of the squares of residuals (x and y), of their increments, and of
    the right residuals; by new errors, steps, and errors of the disparity."""
    found: Array = field(default_factory=lambda: np.zeros(3))
    """What they are."""
    weight: float = 0.0
    """Of the tracks."""
    lengths: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of the views of a track, and of their squares: of those that a window's oldest view sees; others go on."""
    spread: float = 0.0
    """Median distance of the last window's points from where they were seen, in scales of its loss."""
    cells: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of squares of errors as they pull at poses: of the sum in each cell of the image, and of each alone."""
    images: int = 1
    """Of which an observation has coordinates."""

    def after(self, done: Adjusted, scale: float) -> TrackNoise:
        """With what one more adjusted window says; `scale` that of its loss."""
        kept, new = 1 - 1 / MEMORY, _said_by(done, scale)
        return TrackNoise(
            kept * self.expected + new.expected,
            kept * self.found + new.found,
            kept * self.weight + new.weight,
            kept * self.lengths + new.lengths,
            new.spread,
            kept * self.cells + new.cells,
            new.images,
        )

    @cached_property
    def variances(self) -> Array:
        """(3,) of new errors, of steps, and of the disparity; what would be less than nothing is left out."""
        out, causes = np.zeros(3), np.flatnonzero(self.expected.any(axis=0))
        while len(causes):
            found = np.linalg.lstsq(self.expected[:, causes], self.found, rcond=None)[0]
            if (found >= 0).all():
                out[causes] = found
                break
            causes = causes[found >= 0]
        return out

    @property
    def views(self) -> float:
        """Of the track that a typical observation is one of."""
        return float(self.lengths[1] / self.lengths[0]) if self.lengths[0] > 0 else 0.0

    def sigma(self, setting: float) -> float:
        """Independent error of each view that puts the ends of a track as far apart; `setting` is what is believed
        before."""
        new, step, _ = self.variances
        found = new + step * max(self.views - 1, 0.0) / 2
        return float(np.sqrt((BELIEVED * setting**2 + self.weight * found) / (BELIEVED + self.weight)))

    def variance(self, setting: float) -> float:
        """Of what the loss's weights times J' J is to be divided by: the errors', as far as the loss lets them through
        (`robust`), and as far as neighbours share them (`shared`)."""
        return self.sigma(setting) ** 2 * self.robust * self.shared

    def as_calibration(self, setting: float) -> Array:
        """(2,) `noise` of Step.calibration."""
        return np.array([self.sigma(setting), np.sqrt(self.variance(setting))])

    @cached_property
    def robust(self) -> float:
        """The covariance of an M-estimator, E[psi^2] / E[psi']^2 (Huber 1981, section 7.6), over that of the inverse
        normal equations with the errors' variance, where these hold weights. For Cauchy's loss and normal errors; what
        is gross has next to no weight."""
        d = self.images + 1
        variance = self.spread**2 / chdtri(d, 0.5)
        if variance < 1e-6:
            return 1.0
        weights = 1 / (1 + variance * chdtri(d, (np.arange(QUANTILES) + 0.5) / QUANTILES))
        first, second = float(weights.mean()), float((weights**2).mean())
        slope = first - 2 * (first - second) / d
        return first * (first - second) / (d * variance * slope**2)

    @property
    def shared(self) -> float:
        """By how much more than independent errors those of one cell of the image pull at poses together: patches that
        overlap share their noise, and what is wrong with a camera's calibration is alike nearby."""
        return max(1.0, float(self.cells[0] / self.cells[1])) if self.cells[1] > 0 else 1.0

    def told(self, focal_px: float) -> tuple[str]:
        """In words, in pixels."""
        new, step, disparity = focal_px * np.sqrt(self.variances)
        found = (
            f"{new:.2f} px anew in each key frame, {step:.2f} px from one to the next, {self.views:.1f} views a track"
        )
        return (found + (f", disparity {disparity:.2f} px" if disparity > 0 else ""),)


NOISE = Check(
    "noise",
    "error of a track",
    "finding",
    ADJUSTED,
    ">",
    "px",
    passes="Covariances take tracks to be off by {value} px, more than the {threshold} px of the setting.",
    fails="Covariances take tracks to be off by {value} px; the setting says {threshold} px.",
)


def _said_by(done: Adjusted, scale: float) -> TrackNoise:
    """By one window."""
    window = done.window
    errors, by_point = _linearised(done)
    count = np.bincount(window.owners, minlength=len(window.points))
    begin = np.searchsorted(window.owners, np.arange(len(window.points)))
    worst = np.zeros(len(window.points))
    np.maximum.at(worst, window.owners, np.where(np.isfinite(errors).all(axis=1), done.distances, np.inf))
    likely = np.bincount(window.owners, 1 / (1 + (done.distances / scale) ** 2), len(window.points)) / np.maximum(
        count, 1
    )
    weights = 1 / (1 + (done.distances / scale) ** 2)
    use = ((count >= LEAST_VIEWS) & (worst < GROSS * scale))[window.owners]
    said = TrackNoise(
        spread=float(np.median(done.distances[use])) / scale if use.any() else 0.0,
        cells=_cells(window, errors[:, :2] * weights[:, None], use),
        images=errors.shape[1] - 1,
    )
    for n in np.unique(count[count >= LEAST_VIEWS]).tolist():
        tracks = np.flatnonzero((count == n) & (worst < GROSS * scale))
        if len(tracks):
            views = begin[tracks, None] + np.arange(n)
            whole = likely[tracks[window.cameras[views[:, 0]] == 0]].sum() * np.array([n, n * n])
            said = _with_tracks(
                replace(said, lengths=said.lengths + whole), errors[views], by_point[views], likely[tracks]
            )
    return said


def _linearised(done: Adjusted) -> tuple[Array, Array]:
    """Errors (K, R) and their derivatives by the points (K, R, 3): R = 2 of one camera; 3 of a pair, of whose right
    errors the size is known."""
    w = done.window
    turns = w.rotations[w.cameras]
    near = np.einsum("kij,kj->ki", turns, w.points[w.owners]) + w.translations[w.cameras]
    near[:, 2] = np.maximum(near[:, 2], 1e-6)
    uv, by_place, _ = reprojected(near)
    if w.baseline == 0.0:
        stretch = 1 + w.extra[0] + w.extra[1] * (uv**2).sum(axis=1, keepdims=True)
        return stretch * uv - w.seen[:, :2], by_place @ turns
    errors = uv - w.seen[:, :2]
    right = np.sqrt(np.maximum(done.distances**2 - (errors**2).sum(axis=1), 0.0))
    right = np.where(np.isfinite(w.seen[:, 2]), right, np.nan)
    by_right = by_place[:, :1].copy()
    by_right[:, 0, 2] += w.baseline / near[:, 2] ** 2
    return np.column_stack([errors, right]), np.concatenate([by_place, by_right], axis=1) @ turns


def _with_tracks(said: TrackNoise, errors: Array, by_point: Array, weight: Array) -> TrackNoise:
    """With tracks of n views each: errors (M, n, R), derivatives (M, n, R, 3), weights (M,)."""
    m, n, rows = errors.shape
    basis, size, _ = np.linalg.svd(by_point.reshape(m, n * rows, 3), full_matrices=False)
    basis = basis * (size > 1e-9 * size[:, :1])[:, None, :]
    # Of a form S and a covariance C: trace(S P C P), with P = I - Q Q' and the three columns Q of the basis.
    squares, causes, across = _squares(n, rows), _causes(n, rows), np.swapaxes(basis, 1, 2)
    of_squares, of_causes = squares[:, None] @ basis, causes[:, None] @ basis
    once = _products(of_squares, of_causes, weight)
    twice = _products(across @ of_squares, across @ of_causes, weight)
    flat, expected, found = errors.reshape(m, n * rows), np.zeros((3, 3)), np.zeros(3)
    expected[: len(squares), : len(causes)] = (
        weight.sum() * np.tensordot(squares, causes, axes=((1, 2), (1, 2))) - 2 * once + twice
    )
    found[: len(squares)] = ((flat @ squares) * flat).sum(axis=2) @ weight
    return replace(
        said,
        expected=said.expected + expected,
        found=said.found + found,
        weight=said.weight + float(weight.sum()),
    )


def _products(a: Array, b: Array, weight: Array) -> Array:
    """(A, B) sums of the products of a (A, M, ...) and b (B, M, ...), with weights (M,)."""
    return (weight[:, None, None] * a).reshape(len(a), -1) @ b.reshape(len(b), -1).T


def _cells(window: Window, pull: Array, use: NDArray[np.bool_]) -> Array:
    """(2,) see TrackNoise.cells: of the pulls (K, 2) of observations in use."""
    seen, camera, pull = window.seen[use, :2], window.cameras[use], pull[use]
    if not len(seen):
        return np.zeros(2)
    low, high = seen.min(axis=0), seen.max(axis=0)
    column, row = np.minimum((seen - low) / np.maximum(high - low, 1e-12), 1 - 1e-9).T * np.array(GRID)[:, None]
    cell = (camera * GRID[1] + row.astype(int)) * GRID[0] + column.astype(int)
    together = sum(float((np.bincount(cell, pull[:, i]) ** 2).sum()) for i in range(2))
    return np.array([together, float((pull**2).sum())])


@lru_cache(maxsize=128)
def _causes(n: int, rows: int) -> Array:
    """Covariances (C, n R, n R) of the errors of n views: new in each of them, a walk, and of the disparity."""
    # An error of the left x is one of the right x, too: that is found from the left one.
    image = np.array([[1.0, 0, 1], [0, 1, 0], [1, 0, 1]])[:rows, :rows]
    steps = np.minimum.outer(np.arange(n), np.arange(n)).astype(float)
    found = [np.kron(np.eye(n), image), np.kron(steps, image)]
    return np.stack([*found, np.kron(np.eye(n), np.diag([0.0, 0, 1]))] if rows == 3 else found)


@lru_cache(maxsize=128)
def _squares(n: int, rows: int) -> Array:
    """Forms (C, n R, n R): the sum of the squares of x and y, of their increments, and of the right x."""
    increments = np.diff(np.eye(n), axis=0)
    left = np.diag([1.0, 1, 0][:rows])
    found = [np.kron(np.eye(n), left), np.kron(increments.T @ increments, left)]
    return np.stack([*found, np.kron(np.eye(n), np.diag([0.0, 0, 1]))] if rows == 3 else found)
