"""Checks whether a second rigid motion explains a frame's outliers, and whether to follow it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.motions import LEAST, MARKED, Moving, preferred, second_motion_decision
from ispom.estimators.modern.stereo.pair import NewPair, TrackingResult
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.track import located_by
from ispom.geometry import Pose
from ispom.solvers.localisation import PoseFit, resect
from ispom.solvers.multiview.essential import sampson_distance
from ispom.types import Decision, Tracks

INLIER = 4.0
"""Inlier threshold of the second motion, in loss widths: 0.7 px at the default, where the pose allows 2.5 px. Points
just beyond the pose's threshold, alike in a part of the image, are no moving object."""
SAMPLES = 110
"""Number of samples of four points: if half of the points are inliers (fewer do not count), one sample has only inliers
with a probability of 99.9 %."""


@dataclass(frozen=True, eq=False)
class OtherMotion:
    """The inliers of a second rigid motion."""

    of: NDArray[np.int64]
    """(M,) indices of the inliers among the last frame's points."""
    left_from_world: Pose
    """Pose relative to these points, at their positions in the map."""


def motions(
    setup: Setup, state: ModernStereoState, new: NewPair, sighting: TrackingResult
) -> tuple[TrackingResult, tuple[Decision, ...], Tracks | None]:
    """Localises the frame by the motion to follow; returns the decisions and the tracks of the other motion as well.

    There are no decisions with too few outliers, and no tracks without a second motion.
    """
    found, tests = other_motion(setup, state, sighting)
    if found is None:
        return sighting, tests, None
    assert sighting.located is not None
    others, own = _by_nearer(setup, state, sighting, found)
    sides = _moving(state, sighting, others), _moving(state, sighting, own)
    test = preferred(setup.follow, *sides, (setup.camera.width, setup.camera.height))
    tests = (*tests, test)
    if not test.passed:
        return sighting, tests, _tracks(state, sighting, found.of)
    again = located_by(setup, state, new, sighting, found.left_from_world, others)
    return again, tests, _tracks(state, sighting, own)


def _by_nearer(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult, other: OtherMotion
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the points that the other motion fits better than the frame's pose, and the inliers of the pose only.

    After little motion, far points are inliers of both.
    """
    assert sighting.located is not None
    part = sighting.took_part
    xyz, uv, left = state.map.xyz[sighting.place[part]], sighting.uv[part], state.map.left(setup.camera)
    by_pose, by_other = (
        np.linalg.norm(left.project(pose.apply(xyz)) - uv, axis=1)
        for pose in (sighting.located.camera_from_world, other.left_from_world)
    )
    nearer = (by_other < by_pose) & (by_other < INLIER * setup.noise_px.width)
    return part[nearer], part[sighting.located.inliers & ~nearer]


def other_motion(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult
) -> tuple[OtherMotion | None, tuple[Decision, ...]]:
    """Finds a second rigid motion that maps the outliers of the frame's pose, from their positions in the map, to their
    observations. With too few outliers there is no check."""
    located = sighting.located
    if located is None:
        return None, ()
    ended = sighting.took_part[~located.inliers]
    if len(state.map.keys) == 1 and state.map.covariance is None:
        ended = ended[_off_their_lines(setup, state, sighting, located, ended)]
    count = len(sighting.took_part)
    if len(ended) < max(LEAST, MARKED * count):
        return None, ()
    x = state.map.left(setup.camera).normalise(sighting.uv[ended])
    found = resect(state.map.xyz[sighting.place[ended]], x, INLIER * setup.noise.width, samples=SAMPLES)
    explained = np.zeros(len(ended), bool) if found is None else found.inliers
    test = second_motion_decision(explained, count)
    if found is None or test.passed:
        return None, (test,)
    return OtherMotion(ended[explained], found.camera_from_world), (test,)


def _off_their_lines(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult, located: PoseFit, of: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Returns a mask of the points (M,) that lie off their epipolar lines from the last frame.

    Static points lie on them at any depth. After one keyframe the calibration is uncorrected, and wrong depths look
    like another motion along these lines.
    """
    left, last = state.map.left(setup.camera), state.last
    x, before = left.normalise(sighting.uv[of]), left.normalise(last.points.uv[of])
    way = located.camera_from_world @ last.left_from_world.inverse()
    return np.abs(sampson_distance(way, before, x)) > INLIER * setup.noise.width


def _moving(state: ModernStereoState, sighting: TrackingResult, of: NDArray[np.int64]) -> Moving:
    return Moving(state.last.points.ids[of], sighting.uv[of], state.map.xyz[sighting.place[of]])


def _tracks(state: ModernStereoState, sighting: TrackingResult, of: NDArray[np.int64]) -> Tracks:
    """Returns these points as tracks of a Step."""
    points = state.last.points
    disparity = sighting.disparity_px[of]
    return Tracks.of(points.ids[of], sighting.uv[of], uv_prev=points.uv[of], disparity_px=disparity)
