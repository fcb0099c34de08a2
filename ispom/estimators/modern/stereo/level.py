"""Levels the right image: measures by features how far its rows are from those of the left image, corrects that by
resampling, and judges it from pair to pair.

The search along rows finds nothing where the right image is some rows too low, or turned. Features are matched at any
row. The offset and rotation of the right camera that they show are removed from its image; the self-calibration
estimates the rest. If they change from pair to pair, the two images are of different times, as no rig changes so.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.pair import Setup, StereoImages
from ispom.features.pair_rows import (
    FLIP_TOLERANCE,
    LEVEL_PX,
    LEVEL_SHARE,
    LEVELLED_DEG,
    LEVELLED_PX,
    MIN_MATCHES,
    Look,
    Matches,
    RowModel,
)
from ispom.features.row_search import PointSearch
from ispom.geometry import Array
from ispom.numerics.reductions import median
from ispom.sequences.rectification import Maps, remapped
from ispom.solvers.right_camera import (
    COLUMNS,
    OFFSET_Y,
    PAIR,
    PITCH,
    ROLL,
    TERMS,
    YAW,
    by_column,
    by_row,
    row_evidence,
)
from ispom.types import Camera, Decision, Frame

LEVELLED = (OFFSET_Y, PITCH, YAW, ROLL)
"""The corrections that are measured: rows show them at the first pair."""
LEVEL_ROWS_PX = PointSearch().max_row_error_px / 2
"""Median row offset [px] up to which a pair is level: half of the search range, whose other half noise, lenses and
turns need."""
SURE = 5.0
"""Least size of a correction, in standard deviations; smaller ones are left to the self-calibration."""
MATCH_PX = 0.17
"""Least scale of the robust loss of a feature's row offset [px]: that of a track, see ModernStereoConfig.loss_px."""
ROUNDS = 2
"""Number of times that the ideal positions are computed: the second time they are exact to a hundredth of a pixel."""
AGREEING = 3
"""Number of pairs in a row with the same new offset from which on the right camera has moved; fewer may be chance
where the images are of different moments."""
CHANGES = 2
"""Number of changes from which on the images are of different moments: a camera is moved once."""
FORGOTTEN = 10
"""Number of level pairs in a row after which earlier changes no longer count."""
PATIENCE, EVERY = 3, 4
"""Number of pairs in a row whose features show nothing, after which only every fourth pair is measured: a covered right
lens may stay covered, and measuring takes as long as a frame."""


@dataclass(frozen=True, eq=False)
class RowOffsets:
    """Positions of N features in both images of a pair."""

    left: Array
    """(N, 2) in the left image, normalised."""
    right: Array
    """(N, 2) in the right image, normalised."""

    @staticmethod
    def of(camera: Camera, look: Look) -> RowOffsets | None:
        """Returns the offsets of matched features; None where too few agree on any offset, rotation and size."""
        found, within = look.matches(), LEVEL_PX / look.px
        if len(found) < MIN_MATCHES:
            return None
        model = RowModel.of(found, within)
        good = np.abs(model.residuals(found)) <= within
        if good.mean() < LEVEL_SHARE or abs(model.larger) > FLIP_TOLERANCE:
            return None
        return RowOffsets(*(camera.normalise(uv) for uv in _in_pixels(camera, look.px, found, good)))

    def factors(self, extra: Array) -> Array:
        """Returns the derivatives (N, E) of the row offsets by the corrections, at the ideal positions by `extra`."""
        (x, y), right = self.left.T, self.right[:, 0]
        ideal = np.column_stack([right, y])
        for _ in range(ROUNDS):
            wrong = by_column(ideal, x - ideal[:, 0]) @ extra[:COLUMNS]
            ideal = np.column_stack([right - wrong, y])
        return by_row(ideal, x - ideal[:, 0], np.zeros_like(ideal))

    @property
    def lower(self) -> Array:
        """(N,) normalised."""
        return self.right[:, 1] - self.left[:, 1]


def _in_pixels(camera: Camera, px: float, found: Matches, good: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Returns the left and right positions (N, 2) [px] in images of the camera's size."""
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    return middle + px * found.left[good], middle + px * found.right[good]


@dataclass(frozen=True, eq=False)
class Measured:
    """Corrections of the level that the features of a pair show, in addition to the known ones."""

    terms: Array
    """(E,) significant further corrections among LEVELLED, see right_camera.TERMS; 0 elsewhere."""
    sigma: Array
    """(E,) their standard deviations."""
    factors: Array
    """(N, E) see RowOffsets.factors."""
    fx: float

    @staticmethod
    def of(setup: Setup, offsets: RowOffsets, known: Array) -> Measured:
        """Fits the changes of the corrections `known` (E,). Changes that are not significant get their usual prior."""
        fit, wide = _Fit(np.zeros(PAIR), np.zeros(PAIR)), list(LEVELLED)
        while True:
            prior = setup.extra_sigma.copy()
            prior[wide] = [LEVELLED_PX / setup.camera.fx if i == OFFSET_Y else np.radians(LEVELLED_DEG) for i in wide]
            fit = _fitted(offsets, known, prior, fit.terms, MATCH_PX / setup.camera.fx)
            weak = [i for i in wide if abs(fit.terms[i]) < SURE * fit.sigma[i]]
            if not weak:
                break
            wide.remove(min(weak, key=lambda i: abs(fit.terms[i]) / fit.sigma[i]))
        terms = np.zeros(PAIR)
        terms[wide] = fit.terms[wide]
        return Measured(terms, fit.sigma, offsets.factors(known + fit.terms), setup.camera.fx)

    def rows_px(self, terms: Array) -> float:
        """Returns the median row offset [px] of the features that these corrections (E,) make."""
        return median(np.abs(self.factors @ terms)) * self.fx

    def within_reach(self, terms: Array) -> bool:
        """Returns whether corrections (E,) are small enough to be applied."""
        turns = np.abs(terms[[PITCH, YAW, ROLL]])
        return bool(abs(terms[OFFSET_Y]) * self.fx <= LEVELLED_PX and turns.max() <= np.radians(LEVELLED_DEG))

    def describe(self, terms: Array) -> str:
        """Returns the corrections (E,) with their standard deviations, in words."""
        parts = []
        for i in LEVELLED:
            if terms[i] == 0:
                continue
            if i == OFFSET_Y:
                word = "lower" if terms[i] > 0 else "higher"
                parts.append(
                    f"{abs(terms[i]) * self.fx:.2f} px {word} in the centre (sigma {self.sigma[i] * self.fx:.2g})"
                )
            else:
                value, sigma = np.degrees(terms[i]), np.degrees(self.sigma[i])
                parts.append(f"{TERMS[i]} {value:+.2f} deg (sigma {sigma:.2g})")
        return ", ".join(parts)


class _Fit(NamedTuple):
    terms: Array
    """(E,) corrections."""
    sigma: Array
    """(E,) their standard deviations."""


def _fitted(offsets: RowOffsets, known: Array, prior: Array, start: Array, scale: float) -> _Fit:
    """Fits the changes of the corrections `known` (E,).

    `prior` (E,): its standard deviations without these offsets. `start` (E,): an estimate of it, for ideal positions.
    `scale`: that of the robust loss.
    """
    factors, free = offsets.factors(known + start), prior > 0
    lower = offsets.lower - factors @ known
    evidence = row_evidence(np.arange(len(lower)), factors, lower, np.zeros(PAIR), np.diag(prior**2), scale)
    design = evidence.design[:, free]
    covariance = np.linalg.inv(np.diag(prior[free] ** -2.0) + design.T @ design)
    found, sigma = np.zeros(PAIR), np.zeros(PAIR)
    found[free] = covariance @ (design.T @ evidence.seen)
    sigma[free] = np.sqrt(np.diag(covariance))
    return _Fit(found, sigma)


def measured(setup: Setup, images: StereoImages, known: Array) -> Measured | None:
    """Measures the level of a pair by features, relative to the corrections `known` (E,); None where they do not
    show it."""
    look = Look.of(Frame.stereo(images.time_ns, images.left, images.right))
    offsets = RowOffsets.of(setup.camera, look)
    return None if offsets is None else Measured.of(setup, offsets, known)


@dataclass(frozen=True, eq=False)
class Level:
    """The level of the right images, by the pairs so far."""

    terms: Array = field(default_factory=lambda: np.zeros(PAIR))
    """(E,) corrections of the right camera that are removed from its images, see right_camera.TERMS."""
    agreed: int = 0
    """Number of pairs in a row that agree with `terms`, up to FORGOTTEN."""
    known: bool = False
    """Whether any pair was judged."""
    other: Array | None = None
    """(E,) corrections of the last pair, if it did not agree."""
    others: int = 0
    """Number of pairs in a row that agree with `other`."""
    changes: int = 0
    """Number of times that a pair showed something else than the one before, since the last FORGOTTEN level pairs."""
    moments: bool = False
    """Whether the images are of different moments. Then nothing is corrected."""
    silent: int = 0
    """Number of pairs in a row that did not fit, and whose features showed nothing or were not measured."""

    @property
    def is_due(self) -> bool:
        """Returns whether a pair that does not fit is to be measured."""
        return self.silent < PATIENCE or self.silent % EVERY == 0

    def agreeing(self) -> Level:
        """Returns the level after a pair that agrees with it."""
        agreed = min(self.agreed + 1, FORGOTTEN)
        changes = 0 if agreed == FORGOTTEN else self.changes
        return replace(self, agreed=agreed, known=True, other=None, others=0, changes=changes, silent=0)

    def after(self, found: Measured | None) -> tuple[Level, tuple[Decision, ...]]:
        """Returns the level after a pair that did not fit, whose corrected images show `found`, and the decisions
        about it."""
        if found is None:
            return replace(self, silent=self.silent + 1), ()
        off_px, total = found.rows_px(found.terms), self.terms + found.terms
        if off_px <= LEVEL_ROWS_PX:
            return replace(self.agreeing(), silent=self.silent + 1), ()
        if not self.known:
            return self._levelled(found, total)
        same = self.other is not None and found.rows_px(total - self.other) <= LEVEL_ROWS_PX
        others, changes = (self.others + 1, self.changes) if same else (1, self.changes + 1)
        later = replace(self, agreed=0, other=total, others=others, changes=changes, silent=0)
        if self.moments or changes >= CHANGES:
            decision = checks.MOMENTS.of(off_px, LEVEL_ROWS_PX, "they are not levelled")
            return replace(later, terms=np.zeros(PAIR), moments=True), (decision,)
        if others >= AGREEING:
            return self._levelled(found, total)
        return later, (checks.ROWS_CHANGED.of(off_px, LEVEL_ROWS_PX, "the next pairs show which"),)

    def _levelled(self, found: Measured, total: Array) -> tuple[Level, tuple[Decision, ...]]:
        rows_px, passed = found.rows_px(total), found.within_reach(total)
        decision = checks.LEVELLED.of(rows_px, LEVELLED_PX, found.describe(total), passed=passed)
        return (Level(total, 1, True) if passed else self), (decision,)


def levelled(setup: Setup, images: StereoImages, level: Level) -> StereoImages:
    """Returns the pair with its right image resampled as a camera without the corrections of the level sees it."""
    if not level.terms.any():
        return images
    return replace(images, right=remapped(images.right, _maps(setup.camera, tuple(level.terms.tolist()))))


@lru_cache(maxsize=2)
def _maps(camera: Camera, terms: tuple[float, ...]) -> Maps:
    """Returns where (height, width) in the given image each pixel of the level one is, as columns and rows [px]."""
    extra, height, width = np.array(terms), camera.height, camera.width
    columns, rows = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    uv = np.column_stack([np.arange(width, dtype=float), np.zeros(width)])
    none = np.zeros(width), np.zeros((width, 2))
    for v in range(height):
        uv[:, 1] = v
        x = camera.normalise(uv)
        columns[v] = uv[:, 0] + camera.fx * (by_column(x, *none) @ extra[:COLUMNS])
        rows[v] = v + camera.fy * (by_row(x, *none) @ extra)
    return columns, rows


def as_given(
    setup: Setup, level: Level, uv: NDArray[np.float32], disparity_px: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns the disparities (N,) [px] of points `uv` (N, 2) in the images as they were given, from those in the level
    ones; NaN stays NaN."""
    if not level.terms.any():
        return disparity_px
    x = setup.camera.normalise(uv)
    right = np.column_stack([x[:, 0] - disparity_px / setup.camera.fx, x[:, 1]])
    shift = by_column(right, np.zeros(len(right))) @ level.terms[:COLUMNS]
    return (disparity_px - setup.camera.fx * shift).astype(np.float32)
