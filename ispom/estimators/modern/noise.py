"""How far off the tracks of one camera are, found from what they leave in each adjusted window.

A track is found again by a patch that is itself one of an earlier image: from key frame to key frame its errors add
up. Against the truth of simulations they are nearly a random walk: from pair to pair its steps are 0.07-0.1 px, between
key frames of the video (in images of half size) 0.1-0.15 px, and after five of them it is 0.15-0.25 px off. Not quite,
though: about half of a step's variance is new in each image, and much of the rest goes on, as a patch that slides over
its surface slides further. Steps from pair to pair correlate by -0.1 to 0.2 with the next one, as new errors take back
what goes on, by 0.1-0.3 with the second, and by 0.05-0.2 with the fifth (those below 0.2 px, in sim:tiny, sim:city and
indoors). And of the error of a disparity a third to a half stays outdoors, and eight tenths indoors.

An adjustment takes the errors of a track's views to be independent. What it leaves does not say what it needs then: the
point follows the walk, and the rest is a third of it (0.06 and 0.08 px); but the ends of a track, which carry the pose
from one key frame to a later one, are as far apart as all steps between them. Hence `sigma`: the independent error that
puts the ends of a track as far apart as they are. A constant is right for one length of tracks, one interval between
key frames and one texture; so 0.17 px stood for pairs, and 0.34 px for the video's wider intervals and longer tracks.
In the integration, where a track has a view in each video frame, 0.13 px (and 0.26 px for pairs) only say how much the
cameras count beside each other.

From the residuals r of a track with n views, r = P e with P what the point leaves of errors e (its null projector; the
poses, held by hundreds of tracks, take next to nothing). With E[e e'] = new^2 I + step^2 min(i, j) the expectations of
r' r and of the squares of its increments are known: two equations for `new` and `step`; a pair's right errors give the
third for the error of the disparity.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ispom.estimators.adjustment import ADJUSTED
from ispom.geometry import Array
from ispom.numerics.reductions import median
from ispom.solvers.window.adjustment import Adjusted, Window
from ispom.solvers.window.leftovers import leftovers
from ispom.types import Check, ImageNoise

MEMORY = 2
"""Adjustments until what one said counts a quarter. Hundreds of tracks tell it at once, and windows overlap; a longer
memory is behind where the key frames move apart, as they do after a start."""
BELIEVED = 20.0
"""Tracks that the setting counts as much as."""
LEAST_VIEWS = 3
"""Of a track that says something: with two, a point follows all but one of their errors. Of two pairs it follows three
of six, and in a first window there is no longer track."""
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

    def as_image_noise(self, setting: float) -> ImageNoise:
        """Returns the noise as Steps report it."""
        return ImageNoise(float(self.sigma(setting)), float(np.sqrt(self.variance(setting))))

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

    def describe(self, focal_px: float) -> str:
        """In words, in pixels."""
        new, step, disparity = focal_px * np.sqrt(self.variances)
        found = f"{new:.2f} px new in each keyframe, {step:.2f} px added per keyframe, {self.views:.1f} views per track"
        return found + (f", disparity {disparity:.2f} px" if disparity > 0 else "")


NOISE = Check(
    "noise",
    "noise of a track",
    "finding",
    ADJUSTED,
    ">",
    "px",
    passes="Measured noise of the tracks: {value} px, more than the {threshold} px assumed.",
    fails="Measured noise of the tracks: {value} px ({threshold} px assumed).",
)


def _said_by(done: Adjusted, scale: float) -> TrackNoise:
    """By one window."""
    window = done.window
    first = window.baseline > 0 and len(window.rotations) == 2
    left = leftovers(window.observed, scale, 2 if first else LEAST_VIEWS, GROSS)
    return TrackNoise(
        left.expected,
        left.found,
        left.weight,
        left.lengths,
        median(done.distances[left.used]) / scale if left.used.any() else 0.0,
        _cells(window, left.pulls, left.used),
        2 if window.baseline else 1,
    )


def _cells(window: Window, pull: Array, use: NDArray[np.bool_]) -> Array:
    """(2,) see TrackNoise.cells: of the pulls (K, 2) of observations in use."""
    seen, camera, pull = np.ascontiguousarray(window.seen[use, :2].T), window.cameras[use], pull[use]
    if not len(camera):
        return np.zeros(2)
    low, high = seen.min(axis=1, keepdims=True), seen.max(axis=1, keepdims=True)
    share = np.minimum((seen - low) / np.maximum(high - low, 1e-12), 1 - 1e-9)
    column, row = (share * np.array(GRID)[:, None]).astype(int)
    cell = (camera * GRID[1] + row) * GRID[0] + column
    together = sum(float((np.bincount(cell, pull[:, i]) ** 2).sum()) for i in range(2))
    return np.array([together, float((pull**2).sum())])
