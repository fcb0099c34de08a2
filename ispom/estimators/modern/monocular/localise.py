"""Localises a frame in the map: pose from the tracked points, correction of the tracks by it, then the pose again. Ends
the tracks of outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.align import align_with_origins
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import INLIER, MISTRACKED, MOVING, WIDTH, Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.track import predict_by_features, project_points, track_features
from ispom.estimators.modern.monocular.tracks import LiveTracks, NewImage, TrackingResult, at_middle_row, tracked_frame
from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks, refine_by_untriangulated
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.second_motion import off_epipolar_lines
from ispom.estimators.tracked_frame import MOST_SHOWN_PX, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.numerics.reductions import lengths
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
    motion: PoseFit | None
    ids: NDArray[np.int64]
    """(N,) ids, ascending, of the observed points."""
    xyz: Array
    """(N, 3) points."""
    seen: Array
    """(N, 2) observations, normalised and corrected."""
    untriangulated: UntriangulatedTracks | None = None
    """Tracks without a point that also constrain the pose."""

    @property
    def count(self) -> int:
        """Number of inliers."""
        return 0 if self.motion is None else int(self.motion.inliers.sum())

    @property
    def agreeing(self) -> bool:
        """Whether there are enough inliers."""
        return self.count >= MIN_LOCATED

    def error_of(self, camera_from_world: Pose) -> float:
        """Returns the root mean square residual, normalised, of the inliers at another pose."""
        inliers = required(self.motion, "the frame was not localised").inliers
        near = camera_from_world.apply(self.xyz[inliers])
        off = near[:, :2] / near[:, 2:] - self.seen[inliers]
        return float(np.sqrt((off**2).sum(axis=1).mean()))


def localise(setup: Setup, live: LiveTracks, local_map: Map, image: NewImage) -> Localisation:
    """Localises a frame by its tracks; if that fails, by tracks displaced like the features of the image."""
    found = _localise_and_align(setup, live, local_map, image, image.tracked)
    if not found.agreeing and (jumped := predict_by_features(setup.front_end, live, image.grey)) is not None:
        tracked = track_features(setup.front_end, setup.camera, live, image.time_ns, image.grey, jumped)
        found = _localise_and_align(setup, live, local_map, image, tracked)
    return found


def _localise_and_align(
    setup: Setup, live: LiveTracks, local_map: Map, image: NewImage, tracked: TrackingResult
) -> Localisation:
    """Estimates the pose, aligns tracks with their patches of origin, and estimates it again."""
    predicted, places = required(image.predicted, "the image has no predicted pose"), local_map.known(live.ids)
    _, xyz, x = _observations(setup, live, local_map, tracked, places)
    limit, compared = INLIER * setup.noise.width, np.zeros(len(tracked.status), bool)
    motion = locate(xyz, x, predicted.inverse(), Policy(WIDTH * setup.noise.width, limit, limit))
    if motion is not None:
        pose = motion.camera_from_world.inverse()
        tracked, compared = align_with_map(setup, live, local_map, image, tracked, pose, places)
        found = localise_by_tracks(setup, live, local_map, tracked, pose, places, image.predicted)
        return replace(found, compared=compared)
    ids, xyz, x = _observations(setup, live, local_map, tracked, places)
    return Localisation(tracked, compared, None, ids, xyz, x)


def localise_by_tracks(
    setup: Setup,
    live: LiveTracks,
    local_map: Map,
    tracked: TrackingResult,
    world_from_guess: Pose,
    places: Array | None = None,
    predicted: Pose | None = None,
) -> Localisation:
    """Estimates the pose from these tracks, from a good guess.

    `places` (N, 3) are the tracks' points as of `Map.known`, if already known; `predicted` is the motion model's pose,
    if different from the guess.
    """
    places = local_map.known(live.ids) if places is None else places
    ids, xyz, x = _observations(setup, live, local_map, tracked, places)
    limit = INLIER * setup.noise.width
    motion, untriangulated = fit_pose(xyz, x, world_from_guess.inverse(), WIDTH * setup.noise.width, limit), None
    if motion is not None:
        motion, untriangulated = refine_by_untriangulated(
            setup,
            live,
            local_map,
            tracked,
            places,
            motion,
            (xyz, x),
            world_from_guess if predicted is None else predicted,
        )
        pose, rays = motion.camera_from_world, None if untriangulated is None else untriangulated.rays
        report_problem(lambda: ResectionProblem(ids, xyz, x, pose, WIDTH * setup.noise.width, "video", rays=rays))
    return Localisation(tracked, np.zeros(len(tracked.status), bool), motion, ids, xyz, x, untriangulated)


def _observations(
    setup: Setup, live: LiveTracks, local_map: Map, tracked: TrackingResult, places: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Returns the points of the map, ids (N,) and (N, 3), and their observations (N, 2), normalised and corrected."""
    some = np.flatnonzero((tracked.status == TrackStatus.ALIVE) & np.isfinite(places[:, 0]))
    x = corrected(setup.camera.normalise(at_middle_row(setup.camera, tracked)[some]), local_map.extra)
    return live.ids[some], places[some], x


def align_with_map(
    setup: Setup, live: LiveTracks, local_map: Map, image: NewImage, tracked: TrackingResult, pose: Pose, places: Array
) -> tuple[TrackingResult, NDArray[np.bool_]]:
    """Searches points of the map, at (N, 3), that tracking lost or misplaced, at their projections."""
    lens = Lens(setup.camera, local_map.extra)
    late = late_px(setup.camera, tracked.uv, tracked.speed)
    expected = project_points(lens, places, pose, tracked.uv - late) + late
    misplaced = lengths(expected - tracked.uv) > INLIER * setup.noise_px.width
    lost = tracked.status != TrackStatus.ALIVE
    expected = np.where((misplaced | lost)[:, None], expected, tracked.uv)
    origins = {k.time_ns: p for k, p in zip(local_map.keys, local_map.poses, strict=True)}
    return align_with_origins(lens, live, image.grey, tracked, expected, image.scene, pose, origins)


def is_contradicted(
    setup: Setup, live: LiveTracks, local_map: Map, localisation: Localisation, again: Localisation
) -> bool:
    """Checks whether the tracks contradict a pose from descriptors, `again`: most of them must agree with `found`.
    Tracks that left the image during a rotation do not count."""
    if localisation.motion is None or again.motion is None or not localisation.agreeing:
        return False
    near = localisation.motion.camera_from_world.apply(local_map.known(live.ids))
    near = near[np.isfinite(near[:, 0])]
    shown = Lens(setup.camera, local_map.extra).in_image(near)
    if localisation.count < MIN_INLIER_SHARE * np.isfinite(shown[:, 0]).sum():
        return False
    return localisation.error_of(again.motion.camera_from_world) > MAX_RESIDUAL_RATIO * localisation.error_of(
        localisation.motion.camera_from_world
    )


def moving_tracks(key: TrackedFrame, frame: TrackedFrame, ids: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Returns those of the tracks `ids` (M,), ascending, observed in both frames, that do not observe a static point:
    they are farther than `limit` (normalised) from their epipolar lines."""
    ids = ids[common(ids, key.ids)[0]]
    return ids[off_epipolar_lines(frame.pose.inverse() @ key.pose, key.at(ids), frame.at(ids), limit)]


def localised_outcome(
    setup: Setup,
    state: ModernMonocularState,
    local_map: Map,
    image: NewImage,
    localisation: Localisation,
    decisions: tuple[Decision, ...],
) -> tuple[TrackedFrame, Outcome]:
    """Returns the frame with its pose, and its outcome unless it becomes a keyframe."""
    frame, residual_px, inliers = _without_outliers(setup, state, local_map, image, localisation)
    outcome = Outcome(
        localisation.tracked,
        Status.TRACKING,
        frame.world_from_camera,
        local_map,
        decisions=decisions,
        residual_px=residual_px,
        inliers=inliers,
        compared=localisation.compared,
    )
    return frame, outcome


def _without_outliers(
    setup: Setup, state: ModernMonocularState, local_map: Map, image: NewImage, localisation: Localisation
) -> tuple[TrackedFrame, NDArray[np.float32], NDArray[np.bool_]]:
    """Returns the frame with its pose and the tracks that go on, residuals (N,) [px], and which tracks (N,) the pose
    used; the status of outliers is updated."""
    status, live, motion = (
        localisation.tracked.status,
        state.live,
        required(localisation.motion, "the frame was not localised"),
    )
    place = np.searchsorted(live.ids, localisation.ids)
    residual = np.full(len(status), np.nan, np.float32)
    residual[place] = np.minimum(motion.distances * setup.camera.fx, MOST_SHOWN_PX)
    inliers = np.zeros(len(status), bool)
    inliers[place[motion.inliers]] = True
    status[place[motion.distances > MISTRACKED * setup.noise.width]] = TrackStatus.REPROJECTION
    frame = tracked_frame(setup.camera, live, localisation.tracked, image.time_ns)
    frame = replace(frame, world_from_camera=motion.camera_from_world.inverse())
    untriangulated = frame.ids[local_map.points.places(frame.ids) < 0]
    moving = moving_tracks(local_map.keys[-1], frame, untriangulated, MOVING * setup.noise.width)
    status[np.searchsorted(live.ids, moving)] = TrackStatus.EPIPOLAR
    return frame.without(moving), residual, inliers
