"""Estimates the noise of one camera's tracks from the residuals of each optimised window.

A track is found by a patch of an earlier image, so its errors accumulate from keyframe to keyframe. In simulations they
are nearly a random walk: the step is 0.07-0.1 px between stereo pairs, 0.1-0.15 px between keyframes of the video (in
images of half size), and the error after five keyframes is 0.15-0.25 px. About half of a step's variance is independent
in each image, and much of the rest continues, as a patch that slides over its surface slides further. Steps between
pairs correlate by -0.1 to 0.2 with the next step, as independent errors reverse the steps, by 0.1-0.3 with the second,
and by 0.05-0.2 with the fifth (errors below 0.2 px, in sim:tiny, sim:city and indoors). A third to a half of a
disparity's error persists outdoors, and eight tenths indoors.

The optimisation assumes independent errors of a track's observations. Their residuals do not show the noise that it
needs: the landmark follows the random walk, so residuals are a third of it (0.06 and 0.08 px), while the ends of a
track, which connect the poses of distant keyframes, differ by the sum of all steps. Hence `sigma` is the independent
noise that gives the ends of a track the same difference. A constant fits only one track length, one keyframe interval
and one texture; the defaults are 0.17 px for pairs, and 0.34 px for the longer intervals and tracks of the video. In
the integrated method, where a track has an observation in each video frame, 0.13 px (and 0.26 px for pairs) only weight
the cameras relative to each other.

The residuals r of a track with n observations are r = P e, where P is the null projector of the landmark and e are the
errors; poses, constrained by hundreds of tracks, absorb almost nothing. With E[e e'] = new^2 I + step^2 min(i, j), the
expectations of r' r and of its squared increments give two equations for `new` and `step`; the right residuals of a
pair give the third one, for the disparity.
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
from ispom.solvers.window.variance_components import residual_forms
from ispom.types import Check, ImageNoise

MEMORY = 2
"""Memory, in windows: after two more windows an estimate counts a quarter. Hundreds of tracks contribute at once, and
windows overlap; a longer memory lags where the keyframe interval grows, as after initialisation."""
BELIEVED = 20.0
"""Weight of the setting as a prior, in tracks."""
LEAST_VIEWS = 3
"""Least number of observations of a track that is used: with two, the landmark follows all but one of their errors. For
two stereo pairs it follows three of six, and the first window has no longer tracks."""
GRID = 8, 6
"""Cells of the image, across and down: each is wider than a patch and contains about ten tracks."""
QUANTILES = 64
"""Number of quantiles by which expectations over normal errors are computed."""
GROSS = 10.0
"""Loss widths beyond which an error makes the whole track an outlier."""


@dataclass(frozen=True, eq=False)
class TrackNoise:
    """Statistics of the residuals of one camera's windows, or of a stereo pair's. All are in normalised units."""

    expected: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """Coefficients (3, 3), summed over tracks. Rows: squared residuals (x and y), squared increments, squared right
    residuals. Columns: variances of independent errors, of steps, and of the disparity."""
    found: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) measured values of the rows."""
    weight: float = 0.0
    """Weight of the tracks."""
    lengths: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of track lengths, in observations, and of their squares, over the tracks in a window's oldest frame; other
    tracks may continue."""
    spread: float = 0.0
    """Median residual of the last window, in loss widths."""
    cells: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of squared weighted residuals: of their sum in each image cell, and of each by itself."""
    images: int = 1
    """Images per observation: 2 for a stereo pair."""

    def after(self, done: Adjusted, scale: float) -> TrackNoise:
        """Adds the statistics of another optimised window; `scale` is the width of its loss."""
        kept, new = 1 - 1 / MEMORY, _statistics_of(done, scale)
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
        """(3,) variances of independent errors, of steps, and of the disparity. Negative solutions are set to 0."""
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
        """Mean length, in observations, of the track to which a random observation belongs."""
        return float(self.lengths[1] / self.lengths[0]) if self.lengths[0] > 0 else 0.0

    def sigma(self, setting: float) -> float:
        """Returns the independent noise (1 sigma) that gives the ends of a track the same difference; `setting` is the
        prior."""
        new, step, _ = self.variances
        found = new + step * max(self.views - 1, 0.0) / 2
        return float(np.sqrt((BELIEVED * setting**2 + self.weight * found) / (BELIEVED + self.weight)))

    def variance(self, setting: float) -> float:
        """Returns the variance by which the weighted J' J is divided: the noise variance, corrected for the loss
        (`robust`) and for correlated neighbours (`shared`)."""
        return self.sigma(setting) ** 2 * self.robust * self.shared

    def as_image_noise(self, setting: float) -> ImageNoise:
        """Returns the noise as Steps report it."""
        return ImageNoise(float(self.sigma(setting)), float(np.sqrt(self.variance(setting))))

    @cached_property
    def robust(self) -> float:
        """Variance factor of the robust loss: the covariance of an M-estimator, E[psi^2] / E[psi']^2 (Huber 1981,
        section 7.6), over that of the inverse weighted normal equations with the noise variance. It assumes the robust
        loss and normal errors; gross outliers have almost no weight."""
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
        """Factor, at least 1, by which the scores of poses vary more than with independent errors: overlapping patches
        share noise, and calibration errors are similar nearby."""
        return max(1.0, float(self.cells[0] / self.cells[1])) if self.cells[1] > 0 else 1.0

    def describe(self, focal_px: float) -> str:
        """Describes the noise in words, in pixels."""
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


def _statistics_of(done: Adjusted, scale: float) -> TrackNoise:
    """Computes the statistics of one window."""
    window = done.window
    first = window.baseline > 0 and len(window.rotations) == 2
    forms = residual_forms(window.observed, scale, 2 if first else LEAST_VIEWS, GROSS)
    return TrackNoise(
        forms.expected,
        forms.found,
        forms.weight,
        forms.lengths,
        median(done.distances[forms.used]) / scale if forms.used.any() else 0.0,
        _cells(window, forms.weighted, forms.used),
        2 if window.baseline else 1,
    )


def _cells(window: Window, weighted: Array, use: NDArray[np.bool_]) -> Array:
    """Returns (2,) TrackNoise.cells, from the weighted residuals (K, 2) of the observations in use."""
    seen, camera, weighted = np.ascontiguousarray(window.seen[use, :2].T), window.cameras[use], weighted[use]
    if not len(camera):
        return np.zeros(2)
    low, high = seen.min(axis=1, keepdims=True), seen.max(axis=1, keepdims=True)
    share = np.minimum((seen - low) / np.maximum(high - low, 1e-12), 1 - 1e-9)
    column, row = (share * np.array(GRID)[:, None]).astype(int)
    cell = (camera * GRID[1] + row) * GRID[0] + column
    together = sum(float((np.bincount(cell, weighted[:, i]) ** 2).sum()) for i in range(2))
    return np.array([together, float((weighted**2).sum())])
