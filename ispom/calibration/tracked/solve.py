"""A camera's interior from the tracks of corners in its images: focal length, principal point and radial distortion.

The unknown focal length is tried from several initial values, as the cost may have several minima; the one of least
cost over the first keyframes is extended to all of them. What the motion does not determine stays as uncertain as the
guess (Hartley & Zisserman 2004, chapter 19: a camera that only moves along its axis, or never rotates, gives no
information on its focal length).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked.realign import realign
from ispom.calibration.tracked.reconstruct import add_keyframes, count_first_views, initialise
from ispom.calibration.tracked.scene import LENS, POSE, LensPrior, Observations, Scene, adjust_scene, scene_problem
from ispom.calibration.tracked.tracks import Tracks
from ispom.geometry import Array
from ispom.numerics.robust import robust_loss
from ispom.solvers.least_squares import normal_equations, remaining_change
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
LEAST_SHOWN = 3
"""Least number of points of a keyframe, whose pose has six unknowns."""
ROUNDS, STEPS = (4, 4, 8), 12
"""Most adjustments of the tracks as they are, and of those realigned by a first and by a better scene."""
LEAST_PX = 0.1
"""Prior of a track's errors."""
CLASS = 3.0
"""Ratio of the errors of two successive classes of tracks."""
MOST_PX = 20.0
"""Largest error that counts; larger ones are reduced to it."""
SMALL = np.array([1e-3, 0.5, 0.5, 2e-3, 2e-3])
"""A small change of the lens."""
HALF_STEPS = 25
OUTLIER = 6.0
TOLERANCE = 1e-6
LEAST_DAMPING = 1e-9
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
    """Root mean square reprojection error in the original images, of these keyframes and points."""
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
    prior = LensPrior(
        np.array([np.log(guess.fx * tracks.factor), (width - 1) / 2, (height - 1) / 2, 0, 0]),
        np.array([focal_sigma, CENTRE_SHARE * width, CENTRE_SHARE * width, *RADIAL_SIGMA]),
    )
    unit_px, count = width / REFERENCE_PX, count_first_views(tracks)
    candidates = []
    for start in STARTS:
        lens = prior.mean.copy()
        lens[0] += start * focal_sigma
        candidates.append(initialise(tracks, lens, prior, unit_px, count))
    valid = [each for each in candidates if each is not None]
    if not valid:
        return None
    scene = add_keyframes(min(valid, key=lambda each: each[1])[0], tracks, prior, unit_px, count)
    original, remaining = tracks, np.zeros(LENS)
    for rounds in ROUNDS:
        scene, remaining = _adjust_with_widths(scene, tracks.observations, prior, unit_px, rounds)
        if rounds != ROUNDS[-1]:
            tracks = realign(original, scene)
    seen = tracks.observations
    errors = scene.errors_px(seen)
    seen = seen.select(errors <= max(OUTLIER * float(np.median(errors)), 1.0))
    return _result(scene, seen, prior, unit_px, tracks.factor, remaining, guess)


def _adjust_with_widths(
    scene: Scene, seen: Observations, prior: LensPrior, unit_px: float, rounds: int
) -> tuple[Scene, Array]:
    """Adjusts the scene and the loss widths of tracks in turn, until the lens converges; returns the remaining change
    (5,), too."""
    last = step = np.zeros(LENS)
    for _ in range(rounds):
        before = scene.lens
        scene, _ = adjust_scene(scene, seen, prior, widths(scene, seen, unit_px), STEPS, TOLERANCE, curved=True)
        last, step = step, scene.lens - before
        if (np.abs(step) < SMALL).all():
            return scene, np.zeros(LENS)
    return scene, remaining_change(last, step)


def widths(scene: Scene, seen: Observations, unit_px: float) -> Array:
    """Returns the loss width (K,) of each observation: that of its track.

    A printed corner is exact to a twentieth of a pixel; one on an edge, in a glass, or on a moving hand is off by
    pixels in every image: each track has the width of its own errors. In classes, so that tracks of one kind are not
    weighted by how well they happen to fit.
    """
    errors = np.minimum(scene.errors_px(seen), MOST_PX * unit_px)
    free = np.maximum(2 * np.bincount(seen.point, minlength=len(scene.points)) - 3, 1)
    squares = np.bincount(seen.point, errors**2, minlength=len(scene.points))
    least = LEAST_PX * unit_px
    own = np.sqrt((2 * least**2 + squares) / (free + 1))[seen.point]
    usual = max(float(np.median(own)), least)
    return usual * CLASS ** np.rint(np.log(own / usual) / np.log(CLASS))


def _result(
    scene: Scene, seen: Observations, prior: LensPrior, unit_px: float, factor: float, remaining: Array, guess: Camera
) -> TrackedLens | None:
    """Returns the lens in the original images, of which the tracked ones are reduced by `factor`; None where too few
    keyframes remain."""
    scene, seen, _ = _often_observed(scene, seen)
    if len(scene.rotations) < LEAST_VIEWS:
        return None
    errors, lens = scene.errors_px(seen), scene.lens
    focal = float(np.exp(lens[0])) / factor
    cx, cy = ((float(v) + 0.5) / factor - 0.5 for v in lens[1:3])
    width_px = widths(scene, seen, unit_px)
    covariance = sandwich_covariance(scene, seen, prior, width_px)
    covariance *= difference_of_halves(scene, seen, prior, width_px) ** 2
    covariance += np.outer(remaining, remaining)
    units = np.array([1, 1 / factor, 1 / factor, 1, 1])
    return TrackedLens(
        camera=replace(guess, fx=focal, fy=focal, cx=cx, cy=cy, distortion=(float(lens[3]), float(lens[4]), 0.0, 0.0)),
        covariance=covariance * np.outer(units, units),
        prior_sigma=prior.sigma * units,
        rms_px=float(np.sqrt((errors**2).mean())) / factor,
        views=len(scene.rotations),
        points=len(scene.points),
    )


def _often_observed(scene: Scene, seen: Observations) -> tuple[Scene, Observations, NDArray[np.bool_]]:
    """Selects the points and keyframes with enough observations, without which a covariance would have no bound;
    returns which observations (K,) those are, too."""
    often = np.ones(len(seen.uv), bool)
    for _ in range(len(scene.rotations)):
        before = int(often.sum())
        often &= (np.bincount(seen.point[often], minlength=len(scene.points)) >= LEAST_SEEN)[seen.point]
        often &= (np.bincount(seen.view[often], minlength=len(scene.rotations)) >= LEAST_SHOWN)[seen.view]
        if often.sum() == before:
            break
    points, owner = np.unique(seen.point[often], return_inverse=True)
    views, place = np.unique(seen.view[often], return_inverse=True)
    scene = replace(
        scene, rotations=scene.rotations[views], translations=scene.translations[views], points=scene.points[points]
    )
    return scene, Observations(place, owner, seen.uv[often]), often


def difference_of_halves(scene: Scene, seen: Observations, prior: LensPrior, width_px: Array) -> float:
    """Returns the difference of the lenses of both halves of the keyframes, in standard errors; at least 1.

    Errors that many tracks share (a rolling shutter, another kind of lens) show only in it.
    """
    middle = len(scene.rotations) // 2
    lenses, covariances = [], []
    for first, end in ((0, middle), (middle, len(scene.rotations))):
        inside = (seen.view >= first) & (seen.view < end)
        part = Observations(seen.view[inside] - first, seen.point[inside], seen.uv[inside])
        half = replace(scene, rotations=scene.rotations[first:end], translations=scene.translations[first:end])
        half, part, often = _often_observed(half, part)
        if not often.any():
            return 1.0
        own = width_px[inside][often]
        half, _ = adjust_scene(half, part, prior, own, HALF_STEPS, TOLERANCE, curved=True)
        lenses.append(half.lens)
        covariances.append(sandwich_covariance(half, part, prior, own))
    difference = lenses[1] - lenses[0]
    chi2 = float(difference @ np.linalg.pinv(covariances[0] + covariances[1], hermitian=True) @ difference)
    return max(1.0, float(np.sqrt(chi2 / LENS)))


def sandwich_covariance(scene: Scene, seen: Observations, prior: LensPrior, width_px: Array) -> Array:
    """Returns the covariance (5, 5) of the lens at the least cost, by the scatter of the points.

    Errors of one track are correlated from image to image, those of different tracks are not: the points are the
    clusters of a sandwich covariance (Huber 1967), and the prior is one more. The degrees of freedom correct for the
    errors that points and poses absorb.
    """
    equations = normal_equations(scene_problem(scene, seen, prior, width_px), scene)
    reduced = equations.eliminated(LEAST_DAMPING)
    inverse = np.linalg.inv(reduced.matrix)[:LENS]
    influences = reduced.scores(equations) @ inverse.T
    weights = robust_loss((scene.errors_px(seen) / width_px) ** 2)[1]
    # Across an error the loss curves by the weight, along it by w (2 w - 1): the mean of both is w^2.
    curvature = float((weights**2).mean() / weights.mean())
    of_prior = inverse[:, :LENS] / prior.sigma
    measured, unknown = 2 * len(seen.uv), 3 * len(scene.points) + POSE * len(scene.rotations) + LENS
    small_sample = measured / max(measured - unknown, 1)
    return small_sample * influences.T @ influences / curvature**2 + of_prior @ of_prior.T
