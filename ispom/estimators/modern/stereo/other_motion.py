"""A pair located: does one other rigid motion explain the points that its pose does not, and is it to be followed?"""

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
"""A point agrees with the other motion within so many widths of the loss: 0.7 px at the default, where the pose lets
points be off by 2.5. What is off by little more than that, alike in a part of the image, is no thing that moves."""
SAMPLES = 110
"""Of four points: where half agree with the other motion, and fewer do not count, one holds just such at 99.9 %."""


@dataclass(frozen=True, eq=False)
class OtherMotion:
    """What one other rigid motion explains."""

    of: NDArray[np.int64]
    """(M,) which of the last pair's points."""
    left_from_world: Pose
    """As these points say, by where the map has them."""


def motions(
    setup: Setup, state: ModernStereoState, new: NewPair, sighting: TrackingResult
) -> tuple[TrackingResult, tuple[Decision, ...], Tracks | None]:
    """The pair located by the motion that is to be followed, and what it does not explain and another one does.

    No Decisions where too few points are left unexplained; None where no other motion is told.
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
    """The points that the other motion explains better than the pair's pose, and those that agree with the pose only:
    where little has moved yet, what is far off agrees with both."""
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
    """Whether one other motion carries those of the last pair's points that end here as no still ones, as the map had
    them, to where they are seen now. Too few are not asked."""
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
    """Which of these points (M,) are seen beside their epipolar lines from the last pair: what is still has none of
    them there, whatever its depth. By one key frame nothing is known of what is wrong with the pair, and depths that
    are wrong by as much as that allows look like another motion along these lines."""
    left, last = state.map.left(setup.camera), state.last
    x, before = left.normalise(sighting.uv[of]), left.normalise(last.points.uv[of])
    way = located.camera_from_world @ last.left_from_world.inverse()
    return np.abs(sampson_distance(way, before, x)) > INLIER * setup.noise.width


def _moving(state: ModernStereoState, sighting: TrackingResult, of: NDArray[np.int64]) -> Moving:
    return Moving(state.last.points.ids[of], sighting.uv[of], state.map.xyz[sighting.place[of]])


def _tracks(state: ModernStereoState, sighting: TrackingResult, of: NDArray[np.int64]) -> Tracks:
    """As a Step shows them."""
    points = state.last.points
    disparity = sighting.disparity_px[of]
    return Tracks.of(points.ids[of], sighting.uv[of], uv_prev=points.uv[of], disparity_px=disparity)
