"""Following the points of the last located pair into a new one: guided by the motion, around, or by descriptors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.locate import located
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, TrackingResult
from ispom.estimators.modern.stereo.patch_search import realigned, track_from_prediction
from ispom.estimators.modern.stereo.relocate import Recognised, joined, recognised
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.features.images import as_bright, has_contrast
from ispom.features.klt import Klt
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.types import Decision, Image, TrackStatus

ENOUGH_SHARE = 0.3
"""Share of the last pair's points that must agree with the pose, before other ways to find them are tried."""
SURE = 2
"""Times the least number of points must agree with a pose that descriptors alone find, as nothing foretold it: by
fewer, which may lie close together or far away, a pair was 4 m off after 30 m."""
NEAREST_BASELINES = 0.2
"""Depth, in baselines, of points that the prediction puts nearer or behind: as far as disparities are looked for."""
UNGUIDED, GUIDED = Klt(levels=5), Klt(levels=2, max_forward_backward_px=np.inf)
"""Guided is from a good guess and one way only: the key frame's patch then checks what was found."""


def track_and_locate(
    setup: Setup, state: ModernStereoState, new: NewPair
) -> tuple[ModernStereoState, TrackingResult, tuple[Decision, ...]]:
    """The points of the last pair in this one, and the pose: guided by the motion so far, around, or by descriptors.

    By descriptors the state changes: its window then holds what a key frame and this pair have in common.
    """
    last, world = state.last, state.map
    predicted = last.predicted(new.time_ns)
    sighting, as_predicted = _follow(setup, last, world, new, predicted, guided=last.motion_s > 0)
    if last.left is None:
        return state, sighting, ()
    if setup.shutter.rolls and last.motion_s <= 0 and sighting.located is not None:
        state, sighting = _begun(setup, state, sighting, new)
        last, world = state.last, state.map
    if setup.shutter.rolls or not as_predicted:
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
        # After a loss, few points may agree about another window of the same facade, and nothing tells them apart.
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
    """The pair located by some of its points alone (M,), near `pose`; the others end as none that stand still."""
    status = seen.status.copy()
    status[seen.took_part] = TrackStatus.REPROJECTION
    status[of] = TrackStatus.ALIVE
    return replace(_sighted(setup, state.last, state.map, new, pose, seen.uv, status), relocated=seen.relocated)


def _begun(
    setup: Setup, state: ModernStereoState, sighting: TrackingResult, new: NewPair
) -> tuple[ModernStereoState, TrackingResult]:
    """The second pair tells how the first one moved while its rows were exposed: the state with its points where they
    were with its middle row, and the pair located by these."""
    assert sighting.located is not None
    pose, last, (key, *others) = sighting.located.camera_from_world, state.last, state.map.keys
    seconds = (new.time_ns - last.time_ns) * 1e-9
    motion = steady(twist_of(pose @ last.left_from_world.inverse()) / seconds)
    near = setup.shutter.points_at_middle(key.left_from_world.apply(state.map.xyz), motion - key.motion)
    xyz = key.left_from_world.inverse().apply(near)
    world = replace(state.map, xyz=xyz, keys=(replace(key, motion=motion), *others))
    last = replace(last, motion=pose @ last.left_from_world.inverse(), motion_s=seconds)
    again = _sighted(setup, last, world, new, pose, sighting.uv, sighting.status)
    return replace(state, map=world), again


def _better(first: TrackingResult, second: TrackingResult) -> TrackingResult:
    """The one with more inliers; of equal ones the first."""
    return second if second.inliers > first.inliers else first


def _rejoined(setup: Setup, state: ModernStereoState, found: Recognised, new: NewPair) -> TrackingResult:
    """What a key frame and the pair have in common located by both images; then the points tracked before as well,
    where that pose puts them."""
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
    """Tracked around where the points were; then all of them looked for where that pose puts them."""
    first, _ = _follow(setup, last, world, new, predicted, guided=False)
    return _better(first, _where_located(setup, last, world, new, first))


def _where_located(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, first: TrackingResult
) -> TrackingResult:
    """All points looked for where the pose, and the motion while rows were exposed, put them.

    What was found before was compared with patches as a prediction that was wrong warps them: it is found a little
    beside its place, and many are not found.
    """
    if first.located is None:
        return first
    pose, place = first.located.camera_from_world, world.places(last.points.ids)
    motion = steady(last.rate) if first.motion is None else first.motion
    near = setup.shutter.as_seen(pose.apply(world.xyz[place]), motion)
    uv, status = _projected(setup, world, near)
    uv, status = realigned(setup, last, world, new.left, uv, status, near, pose)
    return _sighted(setup, last, world, new, pose, uv, status, motion=motion)


def _projected(setup: Setup, world: StereoMap, near: Array) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Places (N, 2) [px] of points (N, 3) in the left image, and TrackStatus (N,)."""
    uv = world.left(setup.camera).in_image(near)
    inside = np.isfinite(uv[:, 0])
    status = np.where(inside, TrackStatus.ALIVE, TrackStatus.OUT_OF_IMAGE).astype(np.uint8)
    return np.where(inside[:, None], uv, 0.0).astype(np.float32), status


def _follow(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, predicted: Pose, guided: bool
) -> tuple[TrackingResult, bool]:
    """Found in the left image, where `predicted` puts the points or around where they were; then in the right one. And
    whether they were found where `predicted` led."""
    points, place = last.points, world.places(last.points.ids)
    if last.left is None or not len(points):
        return TrackingResult.nothing(), False
    near = setup.shutter.as_seen(predicted.apply(world.xyz[place]), steady(last.rate))
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
    """The pair located by the points alive at `uv` (N, 2) [px] in its left image, once found in the right one."""
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
    """Places (N, 2) [px] in the left image and TrackStatus (N,); from where `near` (N, 3) to the camera puts them."""
    assert last.left is not None
    uv = last.points.uv
    if near is None:
        # Where tracking failed so far, the exposure may have changed.
        return UNGUIDED.track(last.left, as_bright(left, last.left), uv)
    expected = world.left(setup.camera).project(near).astype(np.float32)
    behind = ~np.isfinite(expected).all(1)
    expected[behind] = uv[behind]
    return GUIDED.track(last.left, left, uv, expected)
