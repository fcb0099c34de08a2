"""Relocalises a lost frame by descriptors of the keyframes' images, then by patches; or starts a new segment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.keyframe_database import FEATURES, Keyframe, KeyframeDatabase
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, TrackingResult
from ispom.estimators.modern.stereo.pair_calibration import intersected
from ispom.estimators.modern.stereo.patch_search import warps_from
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import row_times
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap, emptied, with_key
from ispom.estimators.modern.verification import Candidate, Verification, View
from ispom.features.interfaces import Features
from ispom.features.patches import align
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.solvers.localisation import resect, resect_optimised
from ispom.types import Decision

MIN_DISPARITY_PX = 1.0
"""Least disparity [px] of points triangulated for relocalisation: below it the depth is known to no better than
half."""
FEWEST = 8
"""Least number of inliers of a pose with which further matches are searched near its projections."""
AROUND = (8, 4, 2)
"""Radii of the search for further matches, in turn, relative to the largest reprojection error of a track."""
ENOUGH = 2
"""Number of points, relative to the least number, with which no further keyframe is compared."""
MIN_CORRELATION = 0.7
"""Least normalised correlation with the keyframe's warped patch; below it the descriptor's position is kept."""
MAX_SHIFT_PX = 3.0
"""Largest correction [px] of a descriptor's position by alignment; descriptors are accurate to about a pixel."""


@dataclass(frozen=True, eq=False)
class Recognised:
    """A frame that was matched with a keyframe."""

    place: Keyframe
    points: PairPoints
    """The common points, as the keyframe observed them."""
    xyz: Array
    """(N, 3) the points in the keyframe's left camera."""
    uv: NDArray[np.float32]
    """(N, 2) [px] the points in the frame's left image."""
    left_from_place: Pose

    @property
    def left_from_world(self) -> Pose:
        """Returns the pose of the frame's left camera."""
        return self.left_from_place @ self.place.camera_from_world


def recognised(setup: Setup, state: ModernStereoState, new: NewPair) -> tuple[ModernStereoState, Recognised | None]:
    """Returns the state with the descriptors computed here, and the keyframe with most matches, or None."""
    now, best = setup.front_end.descriptor.detect_and_describe(new.left, FEATURES), None
    for keyframe in state.database.query(new.left, state.lost_pairs):
        described = keyframe.described(setup.front_end.descriptor)
        if described is not keyframe:
            state = replace(state, database=state.database.with_features(described))
        found = _compared(setup, state, described, new, now)
        if found is not None and (best is None or len(found.points) > len(best.points)):
            best = found
            if len(best.points) >= ENOUGH * setup.min_inliers:
                break
    return state, best


def _compared(
    setup: Setup, state: ModernStereoState, place: Keyframe, new: NewPair, now: Features
) -> Recognised | None:
    """Finds the pose by resection from matches with a keyframe, and its inliers; None with too few of them."""
    points, then, xyz = _intersected(setup, state, place, required(place.features, "the keyframe is not described"))
    left = state.map.left(setup.camera)
    # A pose from points that are close together is inaccurate for others, so the first search radius is larger.
    around_px = tuple(around * setup.max_error_px for around in AROUND)
    solvers = resect, resect_optimised
    verification = Verification(setup.front_end.matcher, 2 * setup.limit, around_px, FEWEST, FEWEST, solvers)
    view = View(now, lambda index: left.normalise(now.uv[index].astype(float)), left.in_image)
    found = verification.verify(Candidate(then, lambda index: xyz[index]), view)
    if found is None:
        return None
    (i, j), pose = found.pairs.T, found.camera_from_world
    points = PairPoints(state.next_id + np.arange(len(i)), points.uv[i], points.disparity_px[i], points.slants[i])
    return Recognised(place, points, found.xyz, _aligned(setup, place, points, found.xyz, now.uv[j], pose, new), pose)


def _intersected(
    setup: Setup, state: ModernStereoState, place: Keyframe, features: Features
) -> tuple[PairPoints, Features, Array]:
    """Returns the features of a keyframe that have a depth: as points, as features, and in its left camera (N, 3)."""
    left, right = place.images
    reduced = PointSearch().search(left, right, place.reduced(features.uv).astype(np.float32))
    disparity = (reduced.disparity_px / place.reduction).astype(np.float32)
    good = disparity >= MIN_DISPARITY_PX
    points = PairPoints(np.arange(int(good.sum())), features.uv[good], disparity[good], reduced.slants[good])
    motion = np.zeros(12) if place.motion is None else place.motion
    return points, features[good], intersected(setup, state.map, points, motion)


def _aligned(
    setup: Setup, place: Keyframe, points: PairPoints, xyz: Array, uv: NDArray[np.float32], pose: Pose, new: NewPair
) -> NDArray[np.float32]:
    """Returns positions (N, 2) [px] in the left image, aligned with the keyframe's patches warped to `pose`."""
    warps, bends = warps_from(setup, pose, xyz[:, :2] / xyz[:, 2:], xyz[:, 2], points.slants)
    warps = place.reduction * warps
    found, score = align(place.images[0], place.reduced(points.uv), new.left, uv, warps, bends=bends)
    good = (score > MIN_CORRELATION) & (np.linalg.norm(found - uv, axis=1) < MAX_SHIFT_PX)
    return np.where(good[:, None], found, uv).astype(np.float32)


def joined(setup: Setup, state: ModernStereoState, found: Recognised) -> ModernStereoState:
    """Returns the state whose window contains the keyframe and the points that it shares with the frame.

    A keyframe that has left the window starts a new one, with the covariance that its pose had.
    """
    place, points = found.place, found.points
    world = state.map
    if place.time_ns not in {k.time_ns for k in world.keys}:
        state = replace(state, settled=state.settled.extended((k.time_ns, k.left_from_world) for k in world.keys))
        nothing = PairPoints()
        known = np.zeros((6, 6)) if place.covariance is None else place.covariance
        seen, motion = nothing.seen_by(setup.camera), np.zeros(12) if place.motion is None else place.motion
        late_s = row_times(setup.camera, seen[:, 1])
        key = KeyFrame(place.time_ns, place.camera_from_world, nothing.ids, seen, motion, nothing.slants, late_s)
        world = with_key(emptied(world), key, setup.extra_sigma, setup.settling_s, known)
    world = world.with_points(points.ids, place.camera_from_world.inverse().apply(found.xyz))
    last = replace(state.last, points=PairPoints.joined(state.last.points, points))
    next_id = state.next_id + len(points)
    return replace(state, map=_seen_at(world, place.time_ns, points, setup), last=last, next_id=next_id)


def _seen_at(world: StereoMap, time_ns: int, points: PairPoints, setup: Setup) -> StereoMap:
    """Adds these points to the observations of the keyframe at that time."""
    keys = tuple(
        replace(
            k,
            ids=np.concatenate([k.ids, points.ids]),
            seen=np.concatenate([k.seen, points.seen_by(setup.camera)]),
            slants=np.concatenate([k.slants, points.slants]),
        )
        if k.time_ns == time_ns
        else k
        for k in world.keys
    )
    return replace(world, keys=keys)


def recover(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult
) -> tuple[ModernStereoState, TrackingResult, tuple[Decision, ...]]:
    """Counts one more lost frame; after too many, empties the map to start a new segment at the prediction."""
    state = replace(state, lost_pairs=state.lost_pairs + 1)
    if state.lost_pairs <= setup.max_lost_pairs:
        return state, sighting, ()
    settled = state.settled.extended((k.time_ns, k.left_from_world) for k in state.map.keys)
    last = replace(state.last, points=PairPoints())
    state = replace(state, last=last, map=emptied(state.map), settled=settled, database=KeyframeDatabase())
    restart = checks.LOST_PAIRS.of(state.lost_pairs, setup.max_lost_pairs, "a new segment starts at the prediction")
    return state, TrackingResult.nothing(), (restart,)
