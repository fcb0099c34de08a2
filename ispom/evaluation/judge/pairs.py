"""The motion between two frames by their tracks: the best relative pose and its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ispom.geometry import Array, Pose
from ispom.numerics.robust import MAD, normalised_mad, robust_cost, robust_weights
from ispom.solvers.multiview.essential import linearised, refine_sampson, relative_pose
from ispom.solvers.multiview.rotation import dominant_rotation, rotate
from ispom.solvers.multiview.triangulation import triangulate

BIAS_PX = 0.25
"""Largest common displacement of tracks, in addition to their noise: the usual residual of a lens model that was fitted
to a target (0.1 to 0.3 px). A pose that moves the epipolar lines by less is never contradicted."""
LEAST_NOISE_PX = 0.02
"""Noise of tracks is never taken to be less: exact ones have none."""
LEAST = 30
"""Tracks that a pair must share: six for each of the 5 unknowns, so that a moving object is not most of them."""
WIDTH = 3.0
"""Width of the robust loss in standard deviations."""
AMBIGUOUS = 10.0
"""A relative pose near the given one is preferred to another one unless that one's cost is lower by more than this and
what BIAS_PX of each track may add: a plane has two solutions, both exact without noise and bias."""
FRONT = 0.5
"""Share of the points that must be in front of both cameras: an essential matrix also has a twisted pose, which turns
by 180 degrees more, and has nearly none there."""
CLEARLY = 4.0
"""Multiple of BIAS_PX that is clearly more: of a bias that is normally distributed over recordings, 1 in 16,000."""
UNKNOWN = np.pi
"""Standard deviation [rad] of a direction of which the images say nothing."""


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Tracks of two frames, and results about the motion that do not depend on the judged poses; they are computed
    once."""

    x1: Array
    """(N, 2) tracks in the first frame, in normalised coordinates."""
    x2: Array
    """(N, 2) in the second one."""
    pixel: float
    """Size of a pixel in normalised coordinates."""

    @cached_property
    def turn(self) -> Array:
        """(3, 3) second_from_first of the rotation alone that explains most tracks."""
        return dominant_rotation(self.x1, self.x2, WIDTH * self.pixel)

    @cached_property
    def away(self) -> Array:
        """(N,) distances of the tracks from where that rotation moves them."""
        return np.linalg.norm(rotate(self.turn, self.x1) - self.x2, axis=1)

    @cached_property
    def parallax_px(self) -> float:
        """The median of these; NaN without tracks."""
        return float(np.median(self.away)) / self.pixel if len(self.x1) else np.nan

    @cached_property
    def found(self) -> Pose | None:
        """The relative pose second_from_first of most tracks; None where there is none."""
        found = relative_pose(self.x1, self.x2, self.pixel)
        return None if found is None else found.second_from_first

    @cached_property
    def refined(self) -> Pose | None:
        """The same, fitted to all tracks."""
        return None if self.found is None else refine_sampson(self.found, self.x1, self.x2, self.pixel)


@dataclass(frozen=True, eq=False)
class PairEvidence:
    """The relative pose of frames `first` and `second` by their tracks."""

    first: int
    second: int
    """Numbers among the frames of the main camera."""
    rotation: Array
    """(3, 3) second_from_first."""
    direction: Array
    """(3,) of the translation second_from_first, of length 1."""
    tangent: Array
    """(2, 3) the directions by which that of the translation may change."""
    covariance: Array
    """(5, 5) [rad^2] of a turn about the axes of the second camera, and of the direction along `tangent`."""
    tracks: int
    noise_px: float
    """Standard deviation of the distances from the epipolar lines."""
    motion_px: float
    """Median displacement of the tracks."""
    parallax_px: float
    """Median displacement that no rotation explains."""
    moves: bool
    """Whether the displacement is more than noise and bias explain."""
    normal: Array
    """(5, 5) mean of the squared derivatives: the mean square of the distances that a misfit adds, in `pixel`^2."""
    views: TwoViews
    matches: TwoViews | None = None
    """Matches of features of the two images, found without the tracks: a second witness. None where there are none."""

    @property
    def pixel(self) -> float:
        """Size of a pixel in normalised coordinates."""
        return self.views.pixel


def pair_evidence(
    ends: tuple[int, int], views: TwoViews, given: Pose, matches: TwoViews | None = None
) -> PairEvidence | None:
    """Fits a relative pose to the tracks of two frames; None where they do not fix one.

    `given` is second_from_first of the poses that are judged: only of two equally good fits is the nearer one taken.
    """
    x1, x2, pixel = views.x1, views.x2, views.pixel
    if len(x1) < LEAST:
        return None
    turn, away = views.turn, views.away
    parallax_px = views.parallax_px
    motion_px = float(np.median(np.linalg.norm(x1 - x2, axis=1))) / pixel
    pose = _best(views, given)
    near = linearised(pose, x1, x2)
    noise = max(normalised_mad(near.residuals), LEAST_NOISE_PX * pixel)
    weight = robust_weights(near.residuals**2, WIDTH * noise)
    if not parallax_px * pixel > WIDTH * (noise + BIAS_PX * pixel):  # the direction is not fixed: rotation only
        inliers = away < WIDTH * (noise + 2 * BIAS_PX * pixel)
        if inliers.sum() < max(LEAST, len(x1) // 2):
            return None
        normal = np.zeros((5, 5))
        normal[:3, :3] = _normal_of_turn(rotate(turn, x1)[inliers])
        pose, count, parallax = Pose(turn, pose.translation), int(inliers.sum()), False
    else:
        count, parallax = int(weight.sum()), True
        if count < LEAST:
            return None
        normal = near.jacobian.T @ (weight[:, None] * near.jacobian) / weight.sum()
        pose = _facing(pose, x1, x2)
    prior = np.diag([0, 0, 0, UNKNOWN**-2, UNKNOWN**-2])
    covariance = np.linalg.inv(normal / (noise**2 / count + (BIAS_PX * pixel) ** 2) + prior + 1e-9 * np.eye(5))
    tangent = np.linalg.svd(pose.translation[None])[2][1:]
    return PairEvidence(
        *ends, pose.rotation, pose.translation, tangent, covariance, count, noise / pixel, motion_px, parallax_px,
        parallax, normal, views, matches,
    )  # fmt: skip


def denies(pair: PairEvidence, given: Pose) -> bool:
    """Checks directly whether the given second_from_first puts most tracks off their epipolar lines by clearly more
    than noise and bias, and most matches, too. Where the images have two explanations, as of a plane, the given one may
    be the other one. Tracks alone may slip together along a rail; too few matches confirm nothing."""
    if float(np.linalg.norm(given.translation)) == 0:
        return True
    limit_px = float(np.hypot(pair.noise_px, CLEARLY * BIAS_PX))
    if MAD * off_lines_px(pair.views, given) <= limit_px:
        return False
    if pair.matches is None:
        return True
    return len(pair.matches.x1) >= LEAST and MAD * off_lines_px(pair.matches, given) > limit_px


def off_lines_px(views: TwoViews, given: Pose) -> float:
    """Returns the median distance of points from their epipolar lines by a second_from_first that moves."""
    pose = Pose(given.rotation, given.translation / np.linalg.norm(given.translation))
    return float(np.median(np.abs(linearised(pose, views.x1, views.x2).residuals))) / views.pixel


def _best(views: TwoViews, given: Pose) -> Pose:
    """The relative pose that fits the tracks best; the one near the given pose where it is as good."""
    x1, x2, pixel = views.x1, views.x2, views.pixel
    length = float(np.linalg.norm(given.translation))
    direction = given.translation / length if length > 0 else np.array([0.0, 0.0, 1.0])
    near = refine_sampson(Pose(given.rotation, direction), x1, x2, pixel, iterations=12)
    if views.found is None or views.refined is None:
        return near
    if _in_front(near, x1, x2) < FRONT:
        return views.found
    costs = [robust_cost(linearised(each, x1, x2).residuals ** 2, pixel) for each in (near, views.refined)]
    return near if costs[0] < costs[1] + AMBIGUOUS + 0.5 * len(x1) * BIAS_PX**2 else views.refined


def _facing(pose: Pose, x1: Array, x2: Array) -> Pose:
    """The pose with that sign of its translation with which most points are in front of both cameras."""
    other = Pose(pose.rotation, -pose.translation)
    return max((pose, other), key=lambda each: _front(each, x1, x2))


def _in_front(pose: Pose, x1: Array, x2: Array) -> float:
    """The share of the points that are in front of both cameras, with the better sign of the translation."""
    return _front(_facing(pose, x1, x2), x1, x2)


def _front(pose: Pose, x1: Array, x2: Array) -> float:
    xyz = triangulate(pose, x1, x2)
    return float(((xyz[:, 2] > 0) & (pose.apply(xyz)[:, 2] > 0)).mean())


def _normal_of_turn(x: Array) -> Array:
    """Mean of the squared derivatives (3, 3) of points (N, 2), one coordinate each, by a turn."""
    u, v, one = x[:, 0], x[:, 1], np.ones(len(x))
    by_u = np.stack([-u * v, 1 + u * u, -v], axis=1)
    by_v = np.stack([-one - v * v, u * v, u], axis=1)
    return (by_u.T @ by_u + by_v.T @ by_v) / len(x)
