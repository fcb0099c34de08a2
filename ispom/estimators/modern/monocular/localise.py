"""Localises a frame in the map: pose from the tracked points, correction of the tracks by it, then the pose again. Ends
the tracks of outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.monocular.align import align_with_map
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.map import TracksInMap
from ispom.estimators.modern.monocular.setup import INLIER, MISTRACKED, MOVING, WIDTH
from ispom.estimators.modern.monocular.state import Outcome
from ispom.estimators.modern.monocular.track import predict_by_features, track_features
from ispom.estimators.modern.monocular.tracks import NewImage, TrackingResult, tracked_frame
from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks, refine_by_untriangulated
from ispom.estimators.modern.second_motion import off_epipolar_lines
from ispom.estimators.tracked_frame import MOST_SHOWN_PX, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.resection import ResectionProblem
from ispom.solvers.localisation import Policy, PoseFit, fit_pose, locate
from ispom.types import Decision, Status, TrackStatus

MIN_LOCATED = 15
"""Least number of inliers of a pose; below it tracking is lost. A pose has 6 unknowns, and a point gives two equations:
with a third of the points wrong in the same way, it is still overdetermined by a factor of four."""
MIN_INLIER_SHARE = 0.5
"""Least share of inliers among the tracked points: below it the camera has jumped. The inliers may lie on one moving
object or at one side of the image, so descriptors are compared too."""
MIN_DESCRIBED = 2 * MIN_LOCATED
"""Least number of inliers of a pose from descriptors alone, without a prediction: fewer may be chance matches, or lie
close together on one object. With fewer, poses had errors of up to 0.4 m, which later points inherited."""
MAX_RESIDUAL_RATIO = 2.0
"""Ratio of the tracks' residuals at another pose to those at their own, beyond which the tracks contradict that pose.
Right poses leave 1.0 to 1.3 times as much. A wrong pose from 54 descriptor matches left 4.6 times as much to 46 tracks
that all agreed: it had a 14th of the true step, and changed the scale."""


@dataclass(frozen=True, eq=False)
class Localisation:
    """A frame localised in the map."""

    tracked: TrackingResult
    compared: NDArray[np.bool_]
    """Which tracks were aligned with the patch of their origin."""
    fit: PoseFit | None
    ids: NDArray[np.int64]
    """(N,) ids, ascending, of the observed points."""
    xyz: Array
    """(N, 3) points."""
    x: Array
    """(N, 2) observations, normalised and corrected."""
    untriangulated: UntriangulatedTracks | None = None
    """Tracks without a point that also constrain the pose."""

    @property
    def count(self) -> int:
        """Number of inliers."""
        return 0 if self.fit is None else int(self.fit.inliers.sum())

    @property
    def has_enough_inliers(self) -> bool:
        return self.count >= MIN_LOCATED

    def error_of(self, camera_from_world: Pose) -> float:
        """Returns the root mean square residual, normalised, of the inliers at another pose."""
        inliers = required(self.fit, "the frame was not localised").inliers
        in_camera = camera_from_world.apply(self.xyz[inliers])
        errors = in_camera[:, :2] / in_camera[:, 2:] - self.x[inliers]
        return float(np.sqrt((errors**2).sum(axis=1).mean()))

    def covariance(self, uncertainty: MapUncertainty, width: float) -> Array:
        """Returns the covariance (6, 6) of the pose, right twist; `width` of the loss used for the pose, normalised."""
        fit = required(self.fit, "the frame was not localised")
        return uncertainty.of_pose(self.ids, self.xyz, self.x, fit, width, self.untriangulated)


def localise(tracks: TracksInMap, image: NewImage) -> Localisation:
    """Localises a frame by its tracks; if that fails, by tracks displaced like the features of the image."""
    localisation = _localise_and_align(tracks, image, image.tracked)
    if localisation.has_enough_inliers:
        return localisation
    predicted = predict_by_features(tracks.setup.front_end, tracks.live, image.grey)
    if predicted is None:
        return localisation
    tracked = track_features(tracks.setup, tracks.live, image.time_ns, image.grey, predicted)
    return _localise_and_align(tracks, image, tracked)


def _localise_and_align(tracks: TracksInMap, image: NewImage, tracked: TrackingResult) -> Localisation:
    """Estimates the pose, aligns tracks with their patches of origin, and estimates it again."""
    predicted, width = required(image.predicted, "the image has no predicted pose"), tracks.setup.noise.width
    ids, xyz, x = tracks.observations(tracked)
    fit = locate(xyz, x, predicted.inverse(), Policy(WIDTH * width, INLIER * width, INLIER * width))
    if fit is None:
        return Localisation(tracked, np.zeros(len(tracked.status), bool), None, ids, xyz, x)
    pose = fit.camera_from_world.inverse()
    tracked, compared = align_with_map(tracks, image, tracked, pose)
    return replace(localise_by_tracks(tracks, tracked, pose, predicted), compared=compared)


def localise_by_tracks(
    tracks: TracksInMap, tracked: TrackingResult, world_from_guess: Pose, predicted: Pose | None = None
) -> Localisation:
    """Estimates the pose from these tracks, from a good guess; `predicted` is the motion model's pose, if different."""
    width, (ids, xyz, x) = tracks.setup.noise.width, tracks.observations(tracked)
    fit, untriangulated = fit_pose(xyz, x, world_from_guess.inverse(), WIDTH * width, INLIER * width), None
    if fit is not None:
        guess = world_from_guess if predicted is None else predicted
        fit, untriangulated = refine_by_untriangulated(tracks, tracked, fit, (xyz, x), guess)
        pose, rays = fit.camera_from_world, None if untriangulated is None else untriangulated.rays
        report_problem(lambda: ResectionProblem(ids, xyz, x, pose, WIDTH * width, "video", rays=rays))
    return Localisation(tracked, np.zeros(len(tracked.status), bool), fit, ids, xyz, x, untriangulated)


def is_contradicted(tracks: TracksInMap, localisation: Localisation, by_descriptors: Localisation) -> bool:
    """Checks whether the tracks contradict a pose from descriptors: most of them must agree with `localisation`. Tracks
    that left the image during a rotation do not count."""
    if localisation.fit is None or by_descriptors.fit is None or not localisation.has_enough_inliers:
        return False
    in_camera = localisation.fit.camera_from_world.apply(tracks.xyz)
    in_camera = in_camera[np.isfinite(in_camera[:, 0])]
    visible = np.isfinite(tracks.lens.in_image(in_camera)[:, 0]).sum()
    if localisation.count < MIN_INLIER_SHARE * visible:
        return False
    error = localisation.error_of(by_descriptors.fit.camera_from_world)
    return error > MAX_RESIDUAL_RATIO * localisation.error_of(localisation.fit.camera_from_world)


def moving_tracks(key: TrackedFrame, frame: TrackedFrame, ids: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Returns those of the tracks `ids` (M,), ascending, observed in both frames, that do not observe a static point:
    they are farther than `limit` (normalised) from their epipolar lines."""
    ids = ids[common(ids, key.ids)[0]]
    return ids[off_epipolar_lines(frame.pose.inverse() @ key.pose, key.at(ids), frame.at(ids), limit)]


def without_outliers(
    tracks: TracksInMap, image: NewImage, localisation: Localisation, decisions: tuple[Decision, ...]
) -> tuple[TrackedFrame, Outcome]:
    """Ends the tracks of outliers. Returns the frame with its pose and the tracks that go on, and its outcome unless it
    becomes a keyframe."""
    setup, live, fit = tracks.setup, tracks.live, required(localisation.fit, "the frame was not localised")
    tracked, width = localisation.tracked, setup.noise.width
    status, index = tracked.status, np.searchsorted(live.ids, localisation.ids)
    residual_px = np.full(len(status), np.nan, np.float32)
    residual_px[index] = np.minimum(fit.distances * setup.camera.fx, MOST_SHOWN_PX)
    inliers = np.zeros(len(status), bool)
    inliers[index[fit.inliers]] = True
    status[index[fit.distances > MISTRACKED * width]] = TrackStatus.REPROJECTION
    pose = fit.camera_from_world.inverse()
    frame = replace(tracked_frame(setup.camera, live, tracked, image.time_ns), world_from_camera=pose)
    untriangulated = frame.ids[tracks.map.points.places(frame.ids) < 0]
    moving = moving_tracks(tracks.map.keys[-1], frame, untriangulated, MOVING * width)
    status[np.searchsorted(live.ids, moving)] = TrackStatus.EPIPOLAR
    return frame.without(moving), Outcome(
        tracked,
        Status.TRACKING,
        pose,
        tracks.map,
        decisions=decisions,
        residual_px=residual_px,
        inliers=inliers,
        compared=localisation.compared,
    )
