"""Tracks the last localised frame's points into a new one: from predictions, from last positions, by descriptors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.locate import located
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, TrackingResult
from ispom.estimators.modern.stereo.patch_search import realigned, track_from_prediction
from ispom.estimators.modern.stereo.relocate import Recognised, joined, recognised
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import points_at_middle, points_at_rows
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.features.images import as_bright, has_contrast
from ispom.features.klt import Klt
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.types import Decision, Image, TrackStatus

ENOUGH_SHARE = 0.3
"""Share of the last frame's points that must be inliers; with fewer, the next way of tracking is tried."""
SURE = 2
"""Number of inliers, relative to the least number, that a pose by descriptors needs, as no prediction supports it. With
fewer points, which may be close together or far away, a frame was 4 m off after 30 m."""
NEAREST_BASELINES = 0.2
"""Least depth [baselines] from which disparities are predicted; nearer points and those behind the camera get it."""
UNGUIDED, GUIDED = Klt(levels=5), Klt(levels=2, max_forward_backward_px=np.inf)
"""Tracking without and with predictions. The latter has no backward check, as the keyframe's patch checks the
result."""


def track_and_locate(
    setup: Setup, state: ModernStereoState, new: NewPair
) -> tuple[ModernStereoState, TrackingResult, tuple[Decision, ...]]:
    """Tracks the last frame's points and localises: from predictions, else from last positions, else by descriptors.

    Relocalisation changes the state: its window then contains the matched keyframe and the points shared with it.
    """
    last, world = state.last, state.map
    predicted = last.predicted(new.time_ns)
    sighting, as_predicted = _follow(setup, last, world, new, predicted, guided=last.motion_s > 0)
    if last.left is None:
        return state, sighting, ()
    if setup.rolls and last.motion_s <= 0 and sighting.located is not None:
        state, sighting = _begun(setup, state, sighting, sighting.located.camera_from_world, new)
        last, world = state.last, state.map
    if setup.rolls or not as_predicted:
        sighting = _better(sighting, _where_located(setup, last, world, new, sighting))
    wanted = max(setup.min_inliers, int(np.ceil(ENOUGH_SHARE * len(last.points))))
    guided = checks.GUIDED_POINTS.of(sighting.inliers, wanted)
    if guided.passed:
        return state, sighting, (guided,)
    sighting = _better(sighting, _looked_again(setup, last, world, new, predicted))
    nearby = checks.NEARBY_POINTS.of(sighting.inliers, wanted)
    if nearby.passed:
        return state, sighting, (guided, nearby)
    if not setup.relocalise or not has_contrast(new.left, last.left):
        why = (
            "the image has too little contrast for descriptors"
            if setup.relocalise
            else "relocalisation is switched off"
        )
        # After a loss, few points may match another window of the same facade, which no other check detects.
        needed = wanted if state.lost_pairs else setup.min_inliers
        nothing = checks.DESCRIBED_POINTS.of(sighting.inliers, needed, why)
        return state, sighting if nothing.passed else TrackingResult.nothing(), (guided, nearby, nothing)
    state, found = recognised(setup, state, new)
    if found is not None:
        joint = joined(setup, state, found)
        again = _rejoined(setup, joint, found, new)
        if again.inliers >= max(SURE * setup.min_inliers, sighting.inliers + 1):
            state, sighting = joint, again
    return state, sighting, (guided, nearby, checks.DESCRIBED_POINTS.of(sighting.inliers, setup.min_inliers))


def located_by(
    setup: Setup, state: ModernStereoState, new: NewPair, seen: TrackingResult, pose: Pose, of: NDArray[np.int64]
) -> TrackingResult:
    """Localises the frame by some of its points (M,) only, from `pose`; the tracks of the others end as outliers."""
    status = seen.status.copy()
    status[seen.took_part] = TrackStatus.REPROJECTION
    status[of] = TrackStatus.ALIVE
    return replace(_sighted(setup, state.last, state.map, new, pose, seen.uv, status), relocated=seen.relocated)


def _begun(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult, pose: Pose, new: NewPair
) -> tuple[ModernStereoState, TrackingResult]:
    """Corrects the first frame for its motion during the exposure, known since the second frame.

    `pose` is that of the second frame. Returns the state with points at the time of the first frame's middle row, and
    the second frame localised by them.
    """
    last, (key, *others) = state.last, state.map.keys
    seconds = (new.time_ns - last.time_ns) * 1e-9
    motion = steady(twist_of(pose @ last.left_from_world.inverse()) / seconds)
    near = points_at_middle(setup.camera, key.left_from_world.apply(state.map.xyz), motion - key.motion)
    xyz = key.left_from_world.inverse().apply(near)
    world = replace(state.map, xyz=xyz, keys=(replace(key, motion=motion), *others))
    last = replace(last, motion=pose @ last.left_from_world.inverse(), motion_s=seconds)
    again = _sighted(setup, last, world, new, pose, sighting.uv, sighting.status)
    return replace(state, map=world), again


def _better(first: TrackingResult, second: TrackingResult) -> TrackingResult:
    """Returns the result with more inliers; the first one if equal."""
    return second if second.inliers > first.inliers else first


def _rejoined(setup: Setup, state: ModernStereoState, found: Recognised, new: NewPair) -> TrackingResult:
    """Localises by the points shared with a keyframe, then also by tracked points, searched at their projections."""
    last, world, count = state.last, state.map, len(state.last.points) - len(found.points)
    uv = np.concatenate([last.points.uv[:count], found.uv])
    status = np.full(len(uv), TrackStatus.LOST, np.uint8)
    status[count:] = TrackStatus.ALIVE
    first = _sighted(setup, last, world, new, found.left_from_world, uv, status)
    if first.located is None:
        return first
    pose, place = first.located.camera_from_world, world.places(last.points.ids)
    near = pose.apply(world.xyz[place])
    expected, status = _projected(setup, world, near)
    status[(place < 0) | (np.arange(len(status)) >= count)] = TrackStatus.LOST
    uv, status = realigned(setup, last, world, new.left, expected, status, near, pose)
    uv[count:], status[count:] = found.uv, TrackStatus.ALIVE
    return replace(_sighted(setup, last, world, new, pose, uv, status), relocated=True)


def _looked_again(setup: Setup, last: LastPair, world: StereoMap, new: NewPair, predicted: Pose) -> TrackingResult:
    """Tracks from the last positions, then searches all points where that pose projects them."""
    first, _ = _follow(setup, last, world, new, predicted, guided=False)
    return _better(first, _where_located(setup, last, world, new, first))


def _where_located(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, first: TrackingResult
) -> TrackingResult:
    """Searches all points where the pose, and the motion during the exposure, project them.

    The first result compared patches warped by a wrong prediction: its positions are biased, and many points are
    missing.
    """
    if first.located is None:
        return first
    pose, place = first.located.camera_from_world, world.places(last.points.ids)
    motion = steady(last.rate) if first.motion is None else first.motion
    near = points_at_rows(setup.camera, pose.apply(world.xyz[place]), motion)
    uv, status = _projected(setup, world, near)
    uv, status = realigned(setup, last, world, new.left, uv, status, near, pose)
    return _sighted(setup, last, world, new, pose, uv, status, motion=motion)


def _projected(setup: Setup, world: StereoMap, near: Array) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Projects points (N, 3) in the left camera: returns positions (N, 2) [px] and TrackStatus (N,)."""
    uv = world.left(setup.camera).in_image(near)
    inside = np.isfinite(uv[:, 0])
    status = np.where(inside, TrackStatus.ALIVE, TrackStatus.OUT_OF_IMAGE).astype(np.uint8)
    return np.where(inside[:, None], uv, 0.0).astype(np.float32), status


def _follow(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, predicted: Pose, guided: bool
) -> tuple[TrackingResult, bool]:
    """Tracks in the left image, from predictions or from last positions, then in the right image, and localises.

    Also returns whether the predictions led to enough points.
    """
    points, place = last.points, world.places(last.points.ids)
    if last.left is None or not len(points):
        return TrackingResult.nothing(), False
    near = points_at_rows(setup.camera, predicted.apply(world.xyz[place]), steady(last.rate))
    found = track_from_prediction(setup, last, world, new, near, predicted) if guided else None
    as_predicted = found is not None
    if found is None:
        uv, status = _tracked(setup, last, world, new.left, near if guided else None)
        found = realigned(setup, last, world, new.left, uv, status, near, predicted)
    return _sighted(setup, last, world, new, predicted, *found, guided), as_predicted


def _sighted(
    setup: Setup,
    last: LastPair,
    world: StereoMap,
    new: NewPair,
    predicted: Pose,
    uv: NDArray[np.float32],
    status: NDArray[np.uint8],
    guided: bool = False,
    motion: Array | None = None,
) -> TrackingResult:
    """Matches the points alive at `uv` (N, 2) [px] of the left image in the right one, and localises by both."""
    points, place = last.points, world.places(last.points.ids)
    near = predicted.apply(world.xyz[place])
    alive = np.flatnonzero(status == TrackStatus.ALIVE)
    disparity, slants = np.full(len(points), np.nan, np.float32), np.zeros((len(points), 2))
    depth = np.maximum(near[alive, 2], NEAREST_BASELINES * setup.baseline_m)
    expected = (setup.camera.fx * setup.baseline_m / depth).astype(np.float32)
    matches = PointSearch().follow(new.left, new.right, uv[alive], expected, guided)
    disparity[alive], slants[alive] = matches.disparity_px, matches.slants
    seen = PairPoints(points.ids[alive], uv[alive], matches.disparity_px).seen_by(setup.camera)
    found, motion = located(setup, last, world, place[alive], seen, predicted, new.time_ns, motion)
    if found is not None:
        status[alive[~found.inliers]] = TrackStatus.REPROJECTION
    return TrackingResult(
        uv, disparity, slants, status, place, found, alive, matches.lower_px / setup.camera.fy, motion
    )


def _tracked(
    setup: Setup, last: LastPair, world: StereoMap, left: Image, near: Array | None
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Tracks into the left image: positions (N, 2) [px] and TrackStatus (N,), starting from the projections of `near`
    (N, 3) in the camera, or from the last positions."""
    before, uv = required(last.left, "no frame was localised yet"), last.points.uv
    if near is None:
        # Tracking from predictions may have failed because the exposure changed.
        return UNGUIDED.track(before, as_bright(left, before), uv)
    expected = world.left(setup.camera).project(near).astype(np.float32)
    behind = ~np.isfinite(expected).all(1)
    expected[behind] = uv[behind]
    return GUIDED.track(before, left, uv, expected)
