"""Localises a frame in the map: pose from the tracked points, correction of the tracks by it, then the pose again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.realign import realigned
from ispom.estimators.modern.monocular.setup import INLIER, WIDTH, Setup
from ispom.estimators.modern.monocular.state import NewImage
from ispom.estimators.modern.monocular.tracks import (
    Followed,
    LiveTracks,
    displaced_by_features,
    follow,
    projected,
    unrolled,
)
from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks, with_untriangulated
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.second_motion import off_epipolar_lines
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.numerics.reductions import lengths
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.resection import ResectionProblem
from ispom.solvers.localisation import Policy, PoseFit, fit_pose, locate
from ispom.types import TrackStatus

MIN_LOCATED = 15
"""Least number of inliers of a pose; below it tracking is lost. A pose has 6 unknowns, and a point gives two equations:
with a third of the points wrong in the same way, it is still overdetermined by a factor of four."""
MOST = 0.5
"""Least share of inliers among the tracked points: below it the camera has jumped. The inliers may lie on one moving
object or at one side of the image, so descriptors are compared too."""
SURE = 2 * MIN_LOCATED
"""Least number of inliers of a pose from descriptors alone, without a prediction: fewer may be chance matches, or lie
close together on one object. With fewer, poses had errors of up to 0.4 m, which later points inherited."""
TOO_FAR = 2.0
"""Ratio of the tracks' residuals at another pose to those at their own, beyond which the tracks contradict that pose.
Right poses leave 1.0 to 1.3 times as much. A wrong pose from 54 descriptor matches left 4.6 times as much to 46 tracks
that all agreed: it had a 14th of the true step, and changed the scale."""


@dataclass(frozen=True, eq=False)
class Localisation:
    """A frame localised in the map."""

    followed: Followed
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


def localise(setup: Setup, live: LiveTracks, world: Map, new: NewImage) -> Localisation:
    """Localises a frame by its tracks; if that fails, by tracks displaced like the features of the image."""
    found = _located(setup, live, world, new, new.followed)
    if not found.agreeing and (jumped := displaced_by_features(setup.front_end, live, new.grey)) is not None:
        followed = follow(setup.front_end, setup.camera, live, new.time_ns, new.grey, jumped)
        found = _located(setup, live, world, new, followed)
    return found


def _located(setup: Setup, live: LiveTracks, world: Map, new: NewImage, followed: Followed) -> Localisation:
    """Estimates the pose, aligns tracks with their patches of origin, and estimates it again."""
    predicted, places = required(new.predicted, "the image has no predicted pose"), world.known(live.ids)
    _, xyz, x = _seen(setup, live, world, followed, places)
    limit, compared = INLIER * setup.noise.width, np.zeros(len(followed.status), bool)
    motion = locate(xyz, x, predicted.inverse(), Policy(WIDTH * setup.noise.width, limit, limit))
    if motion is not None:
        pose = motion.camera_from_world.inverse()
        followed, compared = set_right(setup, live, world, new, followed, pose, places)
        found = located_by(setup, live, world, followed, pose, places, new.predicted)
        return replace(found, compared=compared)
    ids, xyz, x = _seen(setup, live, world, followed, places)
    return Localisation(followed, compared, None, ids, xyz, x)


def located_by(
    setup: Setup,
    live: LiveTracks,
    world: Map,
    followed: Followed,
    world_from_guess: Pose,
    places: Array | None = None,
    predicted: Pose | None = None,
) -> Localisation:
    """Estimates the pose from these tracks, from a good guess.

    `places` (N, 3) are the tracks' points as of `Map.known`, if already known; `predicted` is the motion model's pose,
    if different from the guess.
    """
    places = world.known(live.ids) if places is None else places
    ids, xyz, x = _seen(setup, live, world, followed, places)
    limit = INLIER * setup.noise.width
    motion, untriangulated = fit_pose(xyz, x, world_from_guess.inverse(), WIDTH * setup.noise.width, limit), None
    if motion is not None:
        motion, untriangulated = with_untriangulated(
            setup, live, world, followed, places, motion, (xyz, x), world_from_guess if predicted is None else predicted
        )
        pose, rays = motion.camera_from_world, None if untriangulated is None else untriangulated.rays
        report_problem(lambda: ResectionProblem(ids, xyz, x, pose, WIDTH * setup.noise.width, "video", rays=rays))
    return Localisation(followed, np.zeros(len(followed.status), bool), motion, ids, xyz, x, untriangulated)


def _seen(
    setup: Setup, live: LiveTracks, world: Map, followed: Followed, places: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Returns the points of the map, ids (N,) and (N, 3), and their observations (N, 2), normalised and corrected."""
    some = np.flatnonzero((followed.status == TrackStatus.ALIVE) & np.isfinite(places[:, 0]))
    x = corrected(setup.camera.normalise(unrolled(setup.camera, followed)[some]), world.extra)
    return live.ids[some], places[some], x


def set_right(
    setup: Setup, live: LiveTracks, world: Map, new: NewImage, followed: Followed, pose: Pose, places: Array
) -> tuple[Followed, NDArray[np.bool_]]:
    """Searches points of the map, at (N, 3), that tracking lost or misplaced, at their projections."""
    lens = Lens(setup.camera, world.extra)
    late = late_px(setup.camera, followed.uv, followed.speed)
    expected = projected(lens, places, pose, followed.uv - late) + late
    misplaced = lengths(expected - followed.uv) > INLIER * setup.noise_px.width
    lost = followed.status != TrackStatus.ALIVE
    expected = np.where((misplaced | lost)[:, None], expected, followed.uv)
    origins = {k.time_ns: p for k, p in zip(world.keys, world.poses, strict=True)}
    return realigned(lens, live, new.grey, followed, expected, new.scene, pose, origins)


def contradicted(setup: Setup, live: LiveTracks, world: Map, found: Localisation, again: Localisation) -> bool:
    """Checks whether the tracks contradict a pose from descriptors, `again`: most of them must agree with `found`.
    Tracks that left the image during a rotation do not count."""
    if found.motion is None or again.motion is None or not found.agreeing:
        return False
    near = found.motion.camera_from_world.apply(world.known(live.ids))
    near = near[np.isfinite(near[:, 0])]
    shown = Lens(setup.camera, world.extra).in_image(near)
    if found.count < MOST * np.isfinite(shown[:, 0]).sum():
        return False
    return found.error_of(again.motion.camera_from_world) > TOO_FAR * found.error_of(found.motion.camera_from_world)


def moving_tracks(key: TrackedFrame, frame: TrackedFrame, ids: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Returns those of the tracks `ids` (M,), ascending, observed in both frames, that do not observe a static point:
    they are farther than `limit` (normalised) from their epipolar lines."""
    ids = ids[common(ids, key.ids)[0]]
    return ids[off_epipolar_lines(frame.pose.inverse() @ key.pose, key.at(ids), frame.at(ids), limit)]
