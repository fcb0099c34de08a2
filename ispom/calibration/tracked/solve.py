"""A camera's interior from the tracks of corners in its images: focal length, principal point and radial distortion.

The unknown focal length is tried from several initial values, as the cost may have several minima; the one of least
cost over the first keyframes is extended to all of them. What the motion does not determine stays as uncertain as the
guess (Hartley & Zisserman 2004, chapter 19: a camera that only moves along its axis, or never rotates, gives no
information on its focal length).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.calibration.tracked.adjust import realigned, settled
from ispom.calibration.tracked.bundle import (
    LENS,
    POSE,
    Fixed,
    Observed,
    Prior,
    Scene,
    errors_px,
    normal_equations,
    reduced,
)
from ispom.calibration.tracked.reconstruct import (
    adjusted_part,
    begun,
    first_views,
    grown,
    outliers,
)
from ispom.calibration.tracked.tracks import Tracks
from ispom.geometry import Array
from ispom.numerics.robust import cauchy_weights
from ispom.types import Camera

STARTS = (0.0, -1.0, 1.0)
"""First values of the focal length's logarithm, in standard deviations of the guess."""
CENTRE_SHARE = 0.015
"""Standard deviation of the principal point about the image's middle, of the image's width."""
RADIAL_SIGMA = (0.25, 0.12)
"""Prior standard deviations of k1 and k2: those of lenses for 60 to 100 degrees."""
REFERENCE_PX = 750.0
"""Width of images for which the loss widths are defined."""
LEAST_VIEWS = 5
LEAST_SEEN = 3
"""Least number of keyframes of a point."""
ROUNDS, STEPS = (4, 4, 8), 12
"""Adjustments as followed, and as found again by a first and by a better scene."""
LEAST_PX = 0.1
"""Prior of a track's errors."""
CLASS = 3.0
"""Ratio of the errors of two successive classes of tracks."""
MOST_PX = 20.0
"""Larger errors count as so large."""
SMALL = np.array([1e-3, 0.5, 0.5, 2e-3, 2e-3])
"""A small change of the lens."""
MOST_SHARE = 0.9
"""Ratio of successive changes of the lens above which it has not converged."""
HALF_STEPS = 25
OUTLIER = 6.0
TOLERANCE = 1e-6
UNTOLD = 1e-9
"""Damping of a point whose distance is not determined, as a share of its information."""


@dataclass(frozen=True, eq=False)
class TrackedLens:
    """The result of the tracks."""

    camera: Camera
    """The camera of the original images."""
    covariance: Array
    """(5, 5) of the logarithm of the focal length, cx, cy [px], k1, k2."""
    prior_sigma: Array
    """(5,) of the same, before any image."""
    rms_px: float
    """Number of observations used, in the original images."""
    views: int
    points: int

    @property
    def sigma(self) -> Array:
        """(5,) standard errors."""
        return np.sqrt(np.diag(self.covariance))


def lens_of_tracks(tracks: Tracks, guess: Camera, focal_sigma: float) -> TrackedLens | None:
    """Starts from a guess (without distortion) whose focal length has this relative uncertainty.

    None where the tracks are too few, or give no scene.
    """
    tracks = tracks.joined()
    if len(tracks.views) < LEAST_VIEWS or not tracks.points:
        return None
    width, height = tracks.size
    prior = Prior(
        np.array([np.log(guess.fx * tracks.factor), (width - 1) / 2, (height - 1) / 2, 0, 0]),
        np.array([focal_sigma, CENTRE_SHARE * width, CENTRE_SHARE * width, *RADIAL_SIGMA]),
    )
    scale_px, count = width / REFERENCE_PX, first_views(tracks)
    tried = []
    for start in STARTS:
        lens = prior.mean.copy()
        lens[0] += start * focal_sigma
        tried.append(begun(tracks, lens, prior, scale_px, count))
    good = [each for each in tried if each is not None]
    if not good:
        return None
    scene = grown(min(good, key=lambda each: each[1])[0], tracks, prior, scale_px, count)
    fixed = Fixed(np.arange(len(tracks.views)) == 0)
    followed, left = tracks, np.zeros(LENS)
    for rounds in ROUNDS:
        scene, left = _weighed(scene, _seen(tracks), prior, fixed, scale_px, rounds)
        if rounds != ROUNDS[-1]:
            tracks = realigned(followed, scene)
    seen = _seen(tracks)
    found = _result(scene, seen.select(~outliers(scene, seen, OUTLIER)), prior, fixed, scale_px, tracks, guess)
    left = left * _units(tracks.factor)
    return replace(found, covariance=found.covariance + np.outer(left, left))


def _seen(tracks: Tracks) -> Observed:
    return Observed(tracks.view, tracks.point, tracks.uv)


def _weighed(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, unit_px: float, rounds: int
) -> tuple[Scene, Array]:
    """Adjusts lens and loss widths of tracks in turn, until the lens converges; returns the remaining change (5,),
    too."""
    last = step = np.zeros(LENS)
    for _ in range(rounds):
        before = scene.lens
        weights = scales(scene, seen, unit_px)
        scene = adjusted_part(scene, seen, prior, fixed, weights, STEPS, TOLERANCE, settled)[0]
        last, step = step, scene.lens - before
        if (np.abs(step) < SMALL).all():
            return scene, np.zeros(LENS)
    return scene, remaining_change(last, step)


def remaining_change(last: Array, step: Array) -> Array:
    """Extrapolates (5,) after two steps by a geometric series.

    Steps that do not shrink show that the lens has not converged, not by how much.
    """
    share = np.clip(step / np.where(last == 0, np.inf, last), -MOST_SHARE, MOST_SHARE)
    return step * share / (1 - share)


def _units(factor: float) -> Array:
    """(5,) of the lens in the images as they are, for one in those reduced by this."""
    return np.array([1, 1 / factor, 1 / factor, 1, 1])


def scales(scene: Scene, seen: Observed, unit_px: float) -> Array:
    """Returns the loss width (K,) of each observation: that of its track.

    A printed corner is exact to a twentieth of a pixel; one on an edge, in a glass, or on a moving hand is off by
    pixels in every image: each track has the width of its own errors. In classes, so that tracks of one kind are not
    weighted by how well they happen to fit.
    """
    errors = np.minimum(errors_px(scene, seen), MOST_PX * unit_px)
    free = np.maximum(2 * np.bincount(seen.point, minlength=len(scene.points)) - 3, 1)
    squares = np.bincount(seen.point, errors**2, minlength=len(scene.points))
    least = LEAST_PX * unit_px
    own = np.sqrt((2 * least**2 + squares) / (free + 1))[seen.point]
    usual = max(float(np.median(own)), least)
    return usual * CLASS ** np.rint(np.log(own / usual) / np.log(CLASS))


def _result(
    scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: float, tracks: Tracks, guess: Camera
) -> TrackedLens:
    often = np.bincount(seen.point, minlength=tracks.points) >= LEAST_SEEN
    seen = seen.select(often[seen.point])
    points, owner = np.unique(seen.point, return_inverse=True)
    scene, seen = replace(scene, points=scene.points[points]), replace(seen, point=owner)
    errors, factor, lens = errors_px(scene, seen), tracks.factor, scene.lens
    focal = float(np.exp(lens[0])) / factor
    cx, cy = ((float(v) + 0.5) / factor - 0.5 for v in lens[1:3])
    camera = replace(guess, fx=focal, fy=focal, cx=cx, cy=cy, distortion=(float(lens[3]), float(lens[4]), 0.0, 0.0))
    units = _units(factor)
    scale = scales(scene, seen, scale_px)
    covariance = sandwich_covariance(scene, seen, prior, fixed, scale) * np.outer(units, units)
    covariance *= halves_differ(scene, seen, prior, scale) ** 2
    rms = float(np.sqrt((errors**2).mean())) / factor
    return TrackedLens(
        camera=camera,
        covariance=covariance,
        prior_sigma=prior.sigma * units,
        rms_px=rms,
        views=len(scene.rotations),
        points=len(points),
    )


def halves_differ(scene: Scene, seen: Observed, prior: Prior, scale_px: Array) -> float:
    """Returns the difference of the lenses of both halves of the keyframes, in standard errors; at least 1.

    Errors that many tracks share (a rolling shutter, another kind of lens) show only in it.
    """
    middle = len(scene.rotations) // 2
    lenses, covariances = [], []
    for first, end in ((0, middle), (middle, len(scene.rotations))):
        inside = (seen.view >= first) & (seen.view < end)
        often = np.bincount(seen.point[inside], minlength=len(scene.points)) >= LEAST_SEEN
        inside &= often[seen.point]
        if not inside.any():
            return 1.0
        points, owner = np.unique(seen.point[inside], return_inverse=True)
        half = Scene(scene.lens, scene.rotations[first:end], scene.translations[first:end], scene.points[points])
        part, fixed = Observed(seen.view[inside] - first, owner, seen.uv[inside]), Fixed(np.arange(end - first) == 0)
        half = settled(half, part, prior, fixed, scale_px[inside], HALF_STEPS, TOLERANCE)[0]
        lenses.append(half.lens)
        covariances.append(sandwich_covariance(half, part, prior, fixed, scale_px[inside]))
    apart = lenses[1] - lenses[0]
    chi2 = float(apart @ np.linalg.pinv(covariances[0] + covariances[1], hermitian=True) @ apart)
    return max(1.0, float(np.sqrt(chi2 / LENS)))


def sandwich_covariance(scene: Scene, seen: Observed, prior: Prior, fixed: Fixed, scale_px: Array) -> Array:
    """Returns the covariance (5, 5) of the lens at the least cost, by the scatter of the points.

    Errors of one track are correlated from image to image, those of different tracks are not: the points are the
    clusters of a sandwich covariance (Huber 1967), and the prior is one more. The degrees of freedom correct for the
    errors that points and poses absorb.
    """
    normal = normal_equations(scene, seen, prior, fixed, scale_px, UNTOLD, scored=True)
    matrix, _ = reduced(normal)
    matrix = matrix + 1e-9 * np.diag(np.diag(normal.matrix))
    inverse = np.linalg.inv(matrix)[:LENS]
    by_point = (normal.inverse @ normal.by_point[..., None])[..., 0]
    scores = normal.scores - (by_point[:, None] @ normal.mixed)[:, 0]
    weights = cauchy_weights((errors_px(scene, seen) / scale_px) ** 2, 1.0)
    # Across an error the loss curves by the weight, along it by w (2 w - 1): the mean of both is w^2.
    bent = float((weights**2).mean() / weights.mean())
    pulled = scores @ inverse.T
    free = prior.sigma > 0
    of_prior = inverse[:, :LENS][:, free] / prior.sigma[free]
    measured, unknown = 2 * len(seen.uv), 3 * len(scene.points) + POSE * len(scene.rotations) + LENS
    short = measured / max(measured - unknown, 1)
    return short * pulled.T @ pulled / bent**2 + of_prior @ of_prior.T
