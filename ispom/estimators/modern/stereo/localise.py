"""Localises a frame: matches its points in the right image, and estimates the pose from both images.

The pose is found from its prediction, or by three-point RANSAC where the result is poor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, StereoImages, TrackingResult, seen_by
from ispom.estimators.modern.stereo.predict import motion_sigma
from ispom.estimators.modern.stereo.shutter import pair_at_middle, refined_motion, row_times
from ispom.estimators.modern.stereo.state import KeyFrame, ModernStereoState
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.resection import ResectionProblem
from ispom.solvers.localisation import Policy, PoseFit, locate
from ispom.solvers.right_camera import LAG, drift, without_errors
from ispom.types import TrackStatus

NEAREST_BASELINES = 0.2
"""Least depth [baselines] from which disparities are predicted; nearer points and those behind the camera get it."""
POOR_MEDIAN = 2.0
"""Largest median error of a pose's inliers, relative to the noise of tracks; above it the pose is found again by
RANSAC. On an unpredicted turn a sixth of the points, wrong matches on a uniform road, had pulled a pose away by 0.2 m,
within the tolerance of the other, distant points."""
RANSAC_THRESHOLD = 4.0
"""Inlier threshold of RANSAC, relative to the noise of tracks."""
ROLLING_ROUNDS = 3
"""Number of times that the pose, and the motion during the exposure of the rows, are estimated in turn."""
PRIOR_BELOW = 3
"""Number of points, relative to the least number, below which the predicted motion is a prior of the pose."""


def match_right(
    setup: Setup,
    state: ModernStereoState,
    images: StereoImages,
    tracked: TrackingResult,
    expected: Pose,
    guided: bool = False,
) -> TrackingResult:
    """Matches the points that are alive in the left image in the right one.

    The search starts at the disparities that the pose `expected` (left_from_world) predicts; `guided` trusts them, see
    PointSearch.follow.
    """
    alive = np.flatnonzero(tracked.status == TrackStatus.ALIVE)
    near = expected.apply(state.map.xyz[tracked.place])
    depth = np.maximum(near[alive, 2], NEAREST_BASELINES * setup.baseline_m)
    predicted_px = (setup.camera.fx * setup.baseline_m / depth).astype(np.float32)
    matches = PointSearch().follow(images.left, images.right, tracked.uv[alive], predicted_px, guided)
    disparity, slants = np.full(len(near), np.nan, np.float32), np.zeros((len(near), 2))
    disparity[alive], slants[alive] = matches.disparity_px, matches.slants
    lower = matches.lower_px / setup.camera.fy
    return replace(tracked, disparity_px=disparity, slants=slants, took_part=alive, lower=lower)


def localise(
    setup: Setup,
    state: ModernStereoState,
    images: StereoImages,
    tracked: TrackingResult,
    expected: Pose,
    motion: Array | None = None,
) -> TrackingResult:
    """Estimates the pose of the frame from the matched points; the tracks of its outliers end.

    The estimation starts at the pose `expected`, and at the `motion` (12,) during the exposure of a rolling shutter.
    """
    part = tracked.took_part
    seen = seen_by(setup.camera, tracked.uv[part], tracked.disparity_px[part])
    located, motion = PoseProblem(setup, state, tracked.place[part], seen, images.time_ns).solved(expected, motion)
    status = tracked.status.copy()
    if located is not None:
        status[part[~located.inliers]] = TrackStatus.REPROJECTION
    return replace(tracked, status=status, located=located, motion=motion)


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The data from which the pose of a frame is estimated."""

    setup: Setup
    state: ModernStereoState
    place: NDArray[np.int64]
    """(N,) indices of the observed points in the map."""
    seen: Array
    """(N, 3) observations, see KeyFrame.seen."""
    time_ns: int

    def solved(self, expected: Pose, motion: Array | None = None) -> tuple[PoseFit | None, Array | None]:
        """Returns the fit of left_from_world, or None, starting at `expected`.

        For a rolling shutter it also returns the motion (12,) during the exposure, see rolling.steady; starting at
        `motion`, or at the motion that the last frames predict.
        """
        setup, world = self.setup, self.state.map
        late_s = row_times(setup.camera, self.seen[:, 1])
        if late_s is None:
            return self._fit(self._without_errors(self.seen, expected), expected), None
        prior = self.state.last.motion_prior(self.time_ns, setup.baseline_m)
        prior = replace(prior, sigma=prior.sigma / np.sqrt(world.variance_factor(setup.noise)))
        motion, fit = prior.motion if motion is None else motion, None
        for _ in range(ROLLING_ROUNDS):
            pose = expected if fit is None else fit.camera_from_world
            middle = self._without_errors(pair_at_middle(self.seen, late_s, motion, setup.baseline_m), pose)
            fit = self._fit(middle, pose)
            if fit is None:
                return None, None
            rows = world.xyz[self.place], middle, late_s, setup.baseline_m, setup.noise.width
            motion, fit = refined_motion(*rows, prior, motion, fit)
        return fit, motion

    def _without_errors(self, seen: Array, expected: Pose) -> Array:
        """Returns the observations (N, 3) that a pair without calibration errors would have made."""
        world, last = self.state.map, self.state.last
        rate = twist_of(expected @ last.left_from_world.inverse()) / ((self.time_ns - last.time_ns) * 1e-9)
        near = expected.apply(world.xyz[self.place])
        return without_errors(seen, world.extra, drift(near, rate[None], world.extra[LAG], self.setup.baseline_m))

    def _fit(self, seen: Array, expected: Pose) -> PoseFit | None:
        """Localises by observations of a pair without calibration errors whose rows are all exposed at one time."""
        setup, world, last = self.setup, self.state.map, self.state.last
        xyz, prior = world.xyz[self.place], None
        if len(xyz) < PRIOR_BELOW * setup.min_inliers:
            prior = np.diag(motion_sigma(expected @ last.left_from_world.inverse(), setup.baseline_m) ** -2)
        usual = max(setup.noise.width, world.noise.sigma(setup.noise.sigma))
        policy = Policy(setup.noise.width, setup.limit, RANSAC_THRESHOLD * usual, POOR_MEDIAN * usual)
        fit = locate(xyz, seen, expected, policy, setup.baseline_m, prior)
        if fit is not None:
            pose, given = fit.camera_from_world, (setup.noise.width, "left", setup.baseline_m, expected, prior)
            report_problem(lambda: ResectionProblem(world.ids[self.place], xyz, seen, pose, *given))
        return fit


@dataclass(frozen=True, eq=False)
class LocalisedFrame:
    """A frame with its pose."""

    images: StereoImages
    left_from_world: Pose
    points: PairPoints
    """The points alive."""
    motion: Array
    """(12,) rate of left_from_world and its change, see rolling.steady: since the last frame, 0 after a gap; or
    during the exposure of a rolling shutter."""

    @staticmethod
    def of(state: ModernStereoState, images: StereoImages, tracked: TrackingResult) -> LocalisedFrame:
        """Returns the frame at its localised pose, or else at the predicted one."""
        last, located = state.last, tracked.located
        pose = last.predicted(images.time_ns) if located is None else located.camera_from_world
        motion = np.zeros(12)
        if tracked.motion is not None:
            motion = tracked.motion
        elif last.left is not None and not tracked.relocated:
            way = pose @ last.left_from_world.inverse()
            motion = steady(twist_of(way) / ((images.time_ns - last.time_ns) * 1e-9))
        return LocalisedFrame(images, pose, tracked.alive(last.points), motion)

    def as_key(self, setup: Setup, points: PairPoints) -> KeyFrame:
        """Returns the frame as a keyframe that observed these points."""
        seen = points.seen_by(setup.camera)
        late_s = row_times(setup.camera, seen[:, 1])
        return KeyFrame(self.images.time_ns, self.left_from_world, points.ids, seen, self.motion, points.slants, late_s)
