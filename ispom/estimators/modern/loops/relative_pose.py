"""Compact description of a keyframe, and the relative pose of two keyframes that show the same scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern import trials
from ispom.estimators.modern.keyframe_database import appearance_of
from ispom.estimators.modern.trials import judged
from ispom.estimators.modern.verification import Candidate, Verification, View
from ispom.features.interfaces import Features, Matcher
from ispom.geometry import Array, Pose, Similarity
from ispom.numerics.robust import normalised_mad
from ispom.solvers.localisation import fit_pose
from ispom.solvers.pose_graph import FREEDOM
from ispom.types import Camera, Image

FEATURES = 800
"""Largest number of features described in an image: 120 kB a keyframe."""
FEWEST = 25
"""Least number of inliers: of 735 pairs of keyframes at different places in three towns one had 16, and one 61, of two
similar facades. `find.py` also checks that the odometry allows the loop, and that several loops agree."""
MATCHED, MATCHED_TOGETHER = 12, 15
"""Least number of inliers among descriptor matches. The second value applies to the points of several keyframes
together, where more match by chance: of 1750 pairs at different places one had 13, one 12, three 11."""
INLIER = 4.0
"""Largest reprojection error, in standard deviations of a feature's position."""
FEWEST_SCALES = 12
"""Least number of points with a depth in both keyframes, for the ratio of their scales."""
FARTHEST = 0.75
"""Largest distance of the two keyframes, in median depths: beyond it the relative pose is poorly constrained."""
SURE_DEPTH, SURE_RAD, SURE_SCALE = 1e-3, 5e-4, 5e-3
"""Least standard deviations of a relative pose, as errors of one keyframe's points are correlated: translation in
median depths, rotation [rad], ln scale."""


@dataclass(frozen=True, eq=False)
class DescribedPoints:
    """Points and descriptors of a keyframe, in as few bytes as loops need."""

    x: NDArray[np.float32]
    """(N, 2) normalised coordinates, undistorted."""
    descriptors: NDArray[np.uint8]
    """(N, D) descriptors, see Features.compact."""
    xyz: NDArray[np.float32]
    """(N, 3) points in the camera, in the scale of that time; NaN where the depth is unknown."""
    looks: NDArray[np.float32]
    """Appearance of the image, see keyframe_database.appearance_of."""
    depth: float
    """Median depth; NaN if no depth is known."""

    @staticmethod
    def of(
        grey: Image, x: Array, features: Features, xyz: Array | None = None, depth: float | None = None
    ) -> DescribedPoints:
        """Describes a keyframe; `depth` is by default the median of the points (N, 3)."""
        kept = np.asarray(features.compact().descriptors, np.uint8)
        points = np.full((len(x), 3), np.nan, np.float32) if xyz is None else xyz.astype(np.float32)
        if depth is None:
            known = points[np.isfinite(points[:, 2]), 2]
            depth = float(np.median(known)) if len(known) else float("nan")
        return DescribedPoints(x.astype(np.float32), kept, points, appearance_of(grey), depth)

    def features(self, fx: float) -> Features:
        """Returns the features in pixels of an undistorted camera, relative to its principal point."""
        return Features(fx * self.x, self.descriptors)

    def with_depth(self) -> DescribedPoints:
        """Returns only the points with a depth."""
        known = np.isfinite(self.xyz[:, 2])
        return replace(self, x=self.x[known], descriptors=self.descriptors[known], xyz=self.xyz[known])


@dataclass(frozen=True, eq=False)
class LoopCamera:
    """The camera, or stereo pair, whose keyframes are compared."""

    fx: float
    low: Array
    """(2,) normalised coordinates of the top left corner of the image."""
    high: Array
    """(2,) normalised coordinates of the bottom right corner."""
    sigma: float
    """Standard deviation of a feature's position, normalised."""
    matcher: Matcher
    baseline: float
    """Baseline [m] of a pair; 0 for one camera, whose scale drifts."""

    @staticmethod
    def of(camera: Camera, sigma: float, matcher: Matcher, baseline: float = 0.0) -> LoopCamera:
        corners = camera.normalise(np.array([[0.0, 0.0], [camera.width - 1.0, camera.height - 1.0]]))
        return LoopCamera(camera.fx, corners[0], corners[1], sigma, matcher, baseline)

    def in_sight(self, near: Array) -> Array:
        """Returns the normalised coordinates (N, 2) of points (N, 3) in the camera; NaN outside of the image."""
        with np.errstate(divide="ignore", invalid="ignore"):
            x = near[:, :2] / near[:, 2:]
        inside = (near[:, 2] > 0) & (x > self.low).all(axis=1) & (x < self.high).all(axis=1)
        return np.where(inside[:, None], x, np.nan)


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Relative pose of a later keyframe and an earlier one."""

    first_from_then: Similarity
    covariance: Array
    """(7, 7) covariance, as that of a pose_graph.Edge."""
    count: int
    """Number of inliers."""


def relative_pose(
    camera: LoopCamera, first: DescribedPoints, then: DescribedPoints, together: bool = False
) -> RelativePose | None:
    """Returns the relative pose if both keyframes show the same scene; `together`: the first has the points of
    several."""
    known = first.with_depth()
    xyz, limit, least = known.xyz.astype(float), INLIER * camera.sigma, MATCHED_TOGETHER if together else MATCHED
    verification = Verification(camera.matcher, limit, (camera.fx * limit,), least, FEWEST, measure_chance=False)
    # A point that several keyframes show is expected, and found, once for each of them.
    candidate = Candidate(known.features(camera.fx), lambda index: xyz[index], repeated=together)
    now = then.features(camera.fx)
    view = View(now, lambda index: then.x[index].astype(float), lambda points: camera.fx * camera.in_sight(points))
    found = verification.verify(candidate, view)
    if trials.is_collecting():
        with np.errstate(divide="ignore", invalid="ignore"):
            trials.report_positions(np.where(xyz[:, 2:] > 0, xyz[:, :2] / xyz[:, 2:], np.nan), then.x)
    if found is None:
        return None
    seen = found.pairs[:, 1]
    return _measured(
        camera, first, found.xyz, then.x[seen].astype(float), then.xyz[seen].astype(float), found.camera_from_world
    )


def _measured(
    camera: LoopCamera, first: DescribedPoints, xyz: Array, x: Array, own: Array, guess: Pose
) -> RelativePose | None:
    """Estimates it from points (N, 3) of the first keyframe, their positions (N, 2) in the later one, and its own
    points (N, 3) or NaN."""
    seen = x
    if camera.baseline:
        with np.errstate(invalid="ignore"):
            seen = np.column_stack([x, x[:, 0] - camera.baseline / own[:, 2]])
    fit = fit_pose(xyz, seen, guess, camera.sigma, INLIER * camera.sigma, camera.baseline)
    depth = first.depth
    count = 0 if fit is None else int(fit.inliers.sum())
    if not judged(count >= FEWEST, trials.POINTS, count, FEWEST) or fit is None:
        return None
    apart = float(np.linalg.norm(fit.camera_from_world.inverse().translation))
    # An unknown depth limits nothing.
    if not judged(not apart > FARTHEST * depth, trials.APART, apart / max(depth, 1e-9), FARTHEST):
        return None
    scale, of_scale = 1.0, 0.0
    if not camera.baseline:
        ratios = own[fit.inliers, 2] / fit.camera_from_world.apply(xyz[fit.inliers])[:, 2]
        measured = ratio_of_scales(ratios)
        known = np.isfinite(ratios) & (ratios > 0)
        if not judged(measured is not None, trials.SCALES, known.sum(), FEWEST_SCALES) or measured is None:
            return None
        scale, of_scale = measured
    # A left twist of then_from_first is a right twist of first_from_then, with opposite sign.
    into = np.diag(np.repeat([scale, 1.0], 3))
    covariance = np.zeros((FREEDOM, FREEDOM))
    covariance[:6, :6] = into @ np.linalg.inv(fit.information) @ into.T
    sure = np.array([scale * SURE_DEPTH * depth] * 3 + [SURE_RAD] * 3 + [SURE_SCALE])
    covariance += np.diag(sure**2)
    covariance[6, 6] += of_scale**2
    first_from_then = Similarity(1 / scale, fit.camera_from_world.inverse())
    trials.report_pose(first_from_then, covariance, depth)
    return RelativePose(first_from_then, covariance, int(fit.inliers.sum()))


def ratio_of_scales(ratios: Array) -> tuple[float, float] | None:
    """Returns the median of ratios of depths in two scales, NaN where unknown, and the standard deviation of its ln;
    None for too few."""
    logs = np.log(ratios[np.isfinite(ratios) & (ratios > 0)])
    if len(logs) < FEWEST_SCALES:
        return None
    # The median of normal values has a standard deviation 1.25 (sqrt(pi / 2)) times that of their mean.
    return float(np.exp(np.median(logs))), 1.25 * normalised_mad(logs) / len(logs) ** 0.5
