"""Recovers a frame that tracking could not localise: by descriptors of the keyframes, or by a new segment.

A keyframe is recognised by its descriptors, and the frame is localised by the points that both share; then its tracks
are searched by patches. After too many lost frames a new segment starts at the predicted pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern import trials
from ispom.estimators.modern.keyframe_database import FEATURES, Keyframe, KeyframeDatabase
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.localise import localise, match_right
from ispom.estimators.modern.stereo.map import triangulated
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, StereoImages, TrackingResult
from ispom.estimators.modern.stereo.shutter import row_times
from ispom.estimators.modern.stereo.state import KeyFrame, ModernStereoState, StereoMap
from ispom.estimators.modern.stereo.track import (
    Expected,
    needed_inliers,
    projected,
    realigned,
    warps_from,
)
from ispom.estimators.modern.trials import judged, trial
from ispom.estimators.modern.verification import Candidate, Verification, View
from ispom.features.images import has_contrast
from ispom.features.interfaces import Features
from ispom.features.patches import align
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.localisation import resect, resect_optimised
from ispom.types import Decision, TrackStatus

UNPREDICTED_INLIERS = 2
"""Number of inliers, relative to the least number, that a pose by descriptors needs, as no prediction supports it. With
fewer points, which may be close together or far away, a frame was 4 m off after 30 m."""
CLEAR_MATCH = 2
"""Number of common points, relative to the least number, with which no further keyframe is compared."""
MIN_DISPARITY_PX = 1.0
"""Least disparity [px] of points triangulated for relocalisation: below it the depth is known to no better than
half."""
MIN_VERIFIED = 8
"""Least number of inliers of a pose with which further matches are searched near its projections."""
SEARCH_RADII = (8, 4, 2)
"""Radii of the search for further matches, in turn, relative to the largest reprojection error of a track."""
MIN_DESCRIPTOR_CORRELATION = 0.7
"""Least normalised correlation with the keyframe's warped patch; below it the descriptor's position is kept."""
MAX_DESCRIPTOR_SHIFT_PX = 3.0
"""Largest correction [px] of a descriptor's position by alignment; descriptors are accurate to about a pixel."""


def relocalise(
    setup: Setup, state: ModernStereoState, images: StereoImages, tracked: TrackingResult
) -> tuple[ModernStereoState, TrackingResult, Decision]:
    """Localises the frame by descriptors, where tracking gave only `tracked`.

    If that succeeds, the window of the returned state contains the recognised keyframe and the points shared with it.
    """
    if not setup.relocalise or not has_contrast(images.left, required(state.last.left, "no frame was localised yet")):
        why = (
            "the image has too little contrast for descriptors"
            if setup.relocalise
            else "relocalisation is switched off"
        )
        # After a loss, few points may match another window of the same facade, which no other check detects.
        needed = needed_inliers(setup, state) if state.lost_pairs else setup.min_inliers
        decision = checks.DESCRIBED_POINTS.of(tracked.inliers, needed, why)
        return state, tracked if decision.passed else TrackingResult.nothing(), decision
    state, found = _recognised(setup, state, images)
    if found is not None:
        joined = _joined(setup, state, found)
        relocalised = _localised_by(setup, joined, found, images)
        enough = max(UNPREDICTED_INLIERS * setup.min_inliers, tracked.inliers + 1)
        with trial("relocalisation", "left", found.keyframe.time_ns, images.time_ns):
            if judged(relocalised.inliers >= enough, trials.LOCALISED, relocalised.inliers, enough):
                trials.report_accepted()
                state, tracked = joined, relocalised
    return state, tracked, checks.DESCRIBED_POINTS.of(tracked.inliers, setup.min_inliers)


def count_loss(setup: Setup, state: ModernStereoState) -> tuple[ModernStereoState, Decision | None]:
    """Counts one more lost frame; after too many, empties the map to start a new segment at the prediction.

    Returns the check of the count if a segment starts, else None.
    """
    state = replace(state, lost_pairs=state.lost_pairs + 1)
    if state.lost_pairs <= setup.max_lost_pairs:
        return state, None
    settled = state.settled.extended((k.time_ns, k.left_from_world) for k in state.map.keys)
    last = replace(state.last, points=PairPoints())
    state = replace(state, last=last, map=state.map.emptied(), settled=settled, database=KeyframeDatabase())
    return state, checks.LOST_PAIRS.of(state.lost_pairs, setup.max_lost_pairs, "a new segment starts at the prediction")


@dataclass(frozen=True, eq=False)
class _Recognised:
    """A frame that was matched with a keyframe."""

    keyframe: Keyframe
    points: PairPoints
    """The common points, as the keyframe observed them."""
    xyz: Array
    """(N, 3) the points in the keyframe's left camera."""
    uv: NDArray[np.float32]
    """(N, 2) [px] the points in the frame's left image."""
    left_from_keyframe: Pose

    @property
    def left_from_world(self) -> Pose:
        """Returns the pose of the frame's left camera."""
        return self.left_from_keyframe @ self.keyframe.camera_from_world


def _recognised(
    setup: Setup, state: ModernStereoState, images: StereoImages
) -> tuple[ModernStereoState, _Recognised | None]:
    """Returns the state with the descriptors computed here, and the keyframe with most matches, or None."""
    now, best = setup.front_end.descriptor.detect_and_describe(images.left, FEATURES), None
    for keyframe in state.database.query(images.left, state.lost_pairs):
        described = keyframe.described(setup.front_end.descriptor)
        if described is not keyframe:
            state = replace(state, database=state.database.with_features(described))
        with trial("relocalisation", "left", keyframe.time_ns, images.time_ns):
            found = _compared(setup, state, described, images, now)
        if found is not None and (best is None or len(found.points) > len(best.points)):
            best = found
            if len(best.points) >= CLEAR_MATCH * setup.min_inliers:
                break
    return state, best


def _compared(
    setup: Setup, state: ModernStereoState, keyframe: Keyframe, images: StereoImages, now: Features
) -> _Recognised | None:
    """Finds the pose by resection from matches with a keyframe, and its inliers; None with too few of them."""
    features = required(keyframe.features, "the keyframe is not described")
    points, described, xyz = _with_depth(setup, state, keyframe, features)
    left = state.map.left(setup.camera)
    # A pose from points that are close together is inaccurate for others, so the first search radius is larger.
    radii_px = tuple(radius * setup.max_error_px for radius in SEARCH_RADII)
    solvers = resect, resect_optimised
    verification = Verification(setup.front_end.matcher, 2 * setup.limit, radii_px, MIN_VERIFIED, MIN_VERIFIED, solvers)
    view = View(now, lambda index: left.normalise(now.uv[index].astype(float)), left.in_image)
    found = verification.verify(Candidate(described, lambda index: xyz[index]), view)
    if trials.is_collecting():
        trials.report_positions(left.normalise(described.uv.astype(float)), left.normalise(now.uv.astype(float)))
    if found is None:
        return None
    trials.report_pose(Similarity(1.0, found.camera_from_world.inverse()), None, float(np.median(found.xyz[:, 2])))
    (i, j), pose = found.pairs.T, found.camera_from_world
    points = PairPoints(state.next_id + np.arange(len(i)), points.uv[i], points.disparity_px[i], points.slants[i])
    recognised = _Recognised(keyframe, points, found.xyz, now.uv[j], pose)
    return replace(recognised, uv=_aligned(setup, recognised, images))


def _with_depth(
    setup: Setup, state: ModernStereoState, keyframe: Keyframe, features: Features
) -> tuple[PairPoints, Features, Array]:
    """Returns the features of a keyframe that have a depth: as points, as features, and in its left camera (N, 3)."""
    left, right = keyframe.images
    reduced = PointSearch().search(left, right, keyframe.reduced(features.uv).astype(np.float32))
    disparity = (reduced.disparity_px / keyframe.reduction).astype(np.float32)
    good = disparity >= MIN_DISPARITY_PX
    points = PairPoints(np.arange(int(good.sum())), features.uv[good], disparity[good], reduced.slants[good])
    motion = np.zeros(12) if keyframe.motion is None else keyframe.motion
    return points, features[good], triangulated(setup, state.map, points, motion)


def _aligned(setup: Setup, found: _Recognised, images: StereoImages) -> NDArray[np.float32]:
    """Returns positions (N, 2) [px] in the left image, aligned with the keyframe's patches warped to the frame."""
    keyframe, xyz, points, uv = found.keyframe, found.xyz, found.points, found.uv
    warps, bends = warps_from(setup, found.left_from_keyframe, xyz[:, :2] / xyz[:, 2:], xyz[:, 2], points.slants)
    warps = keyframe.reduction * warps
    aligned, score = align(keyframe.images[0], keyframe.reduced(points.uv), images.left, uv, warps, bends=bends)
    good = (score > MIN_DESCRIPTOR_CORRELATION) & (np.linalg.norm(aligned - uv, axis=1) < MAX_DESCRIPTOR_SHIFT_PX)
    return np.where(good[:, None], aligned, uv).astype(np.float32)


def _joined(setup: Setup, state: ModernStereoState, found: _Recognised) -> ModernStereoState:
    """Returns the state whose window contains the keyframe and the points that it shares with the frame.

    A keyframe that has left the window starts a new one, with the covariance that its pose had.
    """
    keyframe, points = found.keyframe, found.points
    world = state.map
    if keyframe.time_ns not in {k.time_ns for k in world.keys}:
        state = replace(state, settled=state.settled.extended((k.time_ns, k.left_from_world) for k in world.keys))
        nothing = PairPoints()
        covariance = np.zeros((6, 6)) if keyframe.covariance is None else keyframe.covariance
        seen, motion = nothing.seen_by(setup.camera), np.zeros(12) if keyframe.motion is None else keyframe.motion
        late_s = row_times(setup.camera, seen[:, 1])
        key = KeyFrame(keyframe.time_ns, keyframe.camera_from_world, nothing.ids, seen, motion, nothing.slants, late_s)
        world = world.emptied().with_key(setup, key, covariance)
    world = world.with_points(points.ids, keyframe.camera_from_world.inverse().apply(found.xyz))
    last = replace(state.last, points=PairPoints.joined(state.last.points, points))
    next_id = state.next_id + len(points)
    return replace(state, map=_observed_at(setup, world, keyframe.time_ns, points), last=last, next_id=next_id)


def _observed_at(setup: Setup, world: StereoMap, time_ns: int, points: PairPoints) -> StereoMap:
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


def _localised_by(setup: Setup, state: ModernStereoState, found: _Recognised, images: StereoImages) -> TrackingResult:
    """Localises by the points shared with a keyframe, then also by tracked points, searched at their projections."""
    points, place = state.last.points, state.map.places(state.last.points.ids)
    is_shared = np.arange(len(points)) >= len(points) - len(found.points)
    uv, status = points.uv.copy(), np.where(is_shared, TrackStatus.ALIVE, TrackStatus.LOST).astype(np.uint8)
    uv[is_shared] = found.uv
    tracked = TrackingResult.in_left(uv, status, place)
    tracked = match_right(setup, state, images, tracked, found.left_from_world)
    tracked = localise(setup, state, images, tracked, found.left_from_world)
    if tracked.located is None:
        return tracked
    pose = tracked.located.camera_from_world
    expected = Expected(pose, pose.apply(state.map.xyz[place]))
    tracked = projected(setup, state, expected)
    tracked.status[(place < 0) | is_shared] = TrackStatus.LOST
    tracked = realigned(setup, state, images.left, tracked, expected)
    tracked.uv[is_shared], tracked.status[is_shared] = found.uv, TrackStatus.ALIVE
    tracked = match_right(setup, state, images, tracked, pose)
    return replace(localise(setup, state, images, tracked, pose), relocated=True)
