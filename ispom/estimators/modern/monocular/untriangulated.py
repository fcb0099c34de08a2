"""Constrains a pose by tracks without a point, through the epipolar lines of the last keyframe.

In a bend the points of the map leave the image, or lie close together at its edge; then they hardly separate rotation
from sideways translation. The tracks in the rest of the image do. Without them such a pose had an error of 2.8 degrees,
with a standard deviation of 0.2 by its points, and all later points inherited the error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular.map import TracksInMap
from ispom.estimators.modern.monocular.setup import INLIER, WIDTH, Setup
from ispom.estimators.modern.monocular.tracks import TrackingResult
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.numerics.robust import robust_cost, robust_weights
from ispom.solvers.epipolar import Rays
from ispom.solvers.localisation import PoseFit, fit_pose
from ispom.solvers.window.prior import POSE
from ispom.types import TrackStatus

MAX_OFF_LINE = 2.0
"""Inlier limit of a track's distance from its epipolar line, in standard deviations of the error in two images."""
LEAST_SHARE = 0.5
"""Least share of inliers among the tracks without a point, in the last image and with the pose that they help to
estimate."""
LEAST_GAIN = 0.1
"""Least gain of that share over the pose by points alone: without a gain they add no information, only their errors."""
MIN_DEPTH_SHARE = 0.5
"""Least depth of a track, relative to the least depth of the map's points."""
BEHIND_ERROR = 1e9
"""Error of points behind the camera, as in `fit_pose`."""
MAX_COST_INCREASE = float(chdtri(6, 0.001))
"""Largest increase of the points' squared errors by the tracks without a point, in variances of a tracked position with
correlated neighbours: the 99.9 % quantile of chi-squared with the six unknowns of a pose."""


@dataclass(frozen=True, eq=False)
class UntriangulatedTracks:
    """Tracks without a point, and the keyframe that observed them before."""

    rays: Rays
    key_ns: int
    world_from_key: Pose

    def scores(self, camera_from_world: Pose, scale: float) -> tuple[Array, Array]:
        """Returns the second derivatives (6, 6) of their cost by a left twist, for fixed weights of the loss of width
        `scale`, and the score (M, 6) of each track."""
        errors, by_twist = self.rays.errors(camera_from_world)
        used = np.isfinite(errors[:, 0])
        errors, by_twist = errors[used], by_twist[used]
        weighted = by_twist * (robust_weights((errors**2).sum(axis=1), np.sqrt(2) * scale) / 2)[:, None, None]
        fixed = weighted.reshape(-1, POSE).T @ by_twist.reshape(-1, POSE)
        return fixed, (errors[:, None] @ weighted)[:, 0]


def refine_by_untriangulated(
    tracks: TracksInMap, tracked: TrackingResult, fit: PoseFit, points: tuple[Array, Array], world_from_guess: Pose
) -> tuple[PoseFit, UntriangulatedTracks | None]:
    """Returns the pose refined by tracks without a point, and these tracks, if they are more than its inliers;
    otherwise, or if they disagree, the unchanged pose.

    `points` (M, 3), (M, 2) are the map's points and their observations, by which the pose was estimated. The search
    starts from that pose and from the guess, as poorly constraining points leave a valley: once they ended at 2 degrees
    from the right rotation, where all tracks together have another minimum at 9.
    """
    setup = tracks.setup
    alone = np.flatnonzero((tracked.status == TrackStatus.ALIVE) & np.isnan(tracks.xyz[:, 0]))
    if len(alone) <= fit.inliers.sum():
        return fit, None
    untriangulated = _untriangulated(tracks, tracked, alone, points[0][fit.inliers])
    if untriangulated is None:
        return fit, None
    rays, width, limit = untriangulated.rays, WIDTH * setup.noise.width, INLIER * setup.noise.width
    starts = (fit.camera_from_world, world_from_guess.inverse())
    fits = [fit_pose(*points, start, width, limit, widest=width, rays=rays) for start in starts]
    joint = min((f for f in fits if f is not None), key=lambda f: _joint_cost(f, untriangulated, width), default=None)
    most = MAX_COST_INCREASE * tracks.map.noise.variance(setup.noise.sigma)
    if joint is None or _cost(joint, width) - _cost(fit, width) > most:
        return fit, None
    before, after = (_on_epipolar_lines(setup, rays, f.camera_from_world).mean() for f in (fit, joint))
    return (joint, untriangulated) if after >= max(LEAST_SHARE, before + LEAST_GAIN) else (fit, None)


def _untriangulated(
    tracks: TracksInMap, tracked: TrackingResult, alone: NDArray[np.int64], points: Array
) -> UntriangulatedTracks | None:
    """Returns those of the tracks `alone` (K,) that agreed with the epipolar lines of the last keyframe in the last
    image: moving objects, such as clouds, mostly did not. `points` (N, 3) are the observed points of the map."""
    live, local_map = tracks.live, tracks.map
    keys, before = [k for k in local_map.keys if k.time_ns < live.time_ns], local_map.pose_at(live.time_ns)
    if not keys or before is None:
        return None
    key, world_from_key = keys[-1], keys[-1].pose
    mine, its = common(live.ids[alone], key.ids)
    depths = world_from_key.inverse().apply(points)[:, 2]
    depths = depths[depths > 0]
    if len(mine) <= len(points) or not len(depths):
        return None
    mine, nearest = alone[mine], MIN_DEPTH_SHARE * float(depths.min())
    first = corrected(key.x[its], local_map.extra)
    last, now = tracks.normalise(live, mine), tracks.normalise(tracked, mine)
    good = _on_epipolar_lines(tracks.setup, Rays.of(world_from_key, first, nearest, last), before.inverse())
    if good.mean() < LEAST_SHARE:
        return None
    return UntriangulatedTracks(Rays.of(world_from_key, first[good], nearest, now[good]), key.time_ns, world_from_key)


def _cost(found: PoseFit, scale: float) -> float:
    """Returns the sum of the points' squared errors under the loss of width `scale`."""
    return 2 * scale**2 * robust_cost(found.distances**2, scale)


def _joint_cost(fit: PoseFit, untriangulated: UntriangulatedTracks, scale: float) -> float:
    """Adds the cost of the tracks without a point, whose errors are of two images."""
    errors, _ = untriangulated.rays.errors(fit.camera_from_world)
    squares = np.minimum((errors**2).sum(axis=1), BEHIND_ERROR**2)
    return _cost(fit, scale) + 2 * scale**2 * robust_cost(squares, np.sqrt(2) * scale)


def _on_epipolar_lines(setup: Setup, rays: Rays, camera_from_world: Pose) -> NDArray[np.bool_]:
    """Returns which (M,) of the tracks agree with their epipolar lines."""
    errors, _ = rays.errors(camera_from_world)
    return np.asarray(np.linalg.norm(errors, axis=1) < MAX_OFF_LINE * np.sqrt(2) * setup.noise.sigma)
