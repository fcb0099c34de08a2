"""Tracks the last frame's points into a new one: where the motion model predicts them, else near their last positions.

Points are found by patches of the newest keyframe, warped by the map, so that no drift accumulates between frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.localise import localise, match_right
from ispom.estimators.modern.stereo.pair import Setup, StereoImages, TrackingResult
from ispom.estimators.modern.stereo.shutter import points_at_middle, points_at_rows
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.features.images import as_bright
from ispom.features.klt import Klt
from ispom.features.patches import align, warps_of
from ispom.features.slanted import slanted_warps
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.numerics.twist import twist_of
from ispom.types import Check, Decision, Image, TrackStatus

MIN_INLIER_SHARE = 0.3
"""Share of the last frame's points that must be inliers; with fewer, the next attempt is made."""
MIN_CORRELATION = 0.7
"""Least normalised correlation of a match with its patch; below it the match is wrong."""
MAX_SHIFT_PX = 1.5
"""Largest correction [px] of a tracked position by alignment with its patch."""
PREDICTION_SEARCH_PX = 8.0
"""Largest distance [px] of a match from its prediction: alignment at half size converges from 4 px of its pixels."""
MIN_PREDICTED_SHARE = 0.7
"""Least share of the points predicted in the image that is found there; with fewer, all are tracked instead."""
BORDER_PX = Klt().border_px


@dataclass(frozen=True, eq=False)
class Attempt:
    """One way to find the last frame's points in the left image; the frame is then localised by them."""

    runs: Callable[[Setup, TrackingResult], bool]
    """Whether the attempt is made, by the result of the attempt before it."""
    find: Callable[
        [Setup, ModernStereoState, StereoImages, Pose, TrackingResult], tuple[ModernStereoState, TrackingResult]
    ]
    """Takes the predicted pose and the result of the attempt before; returns the state, which it may correct, and the
    localised frame."""
    check: Check | None = None
    """The check of the best result up to here, which ends the attempts; None: the next one is made in any case."""


def track(
    setup: Setup, state: ModernStereoState, images: StereoImages, predicted: Pose
) -> tuple[ModernStereoState, TrackingResult, tuple[Decision, ...]]:
    """Tracks the last frame's points and localises the frame, by the first of ATTEMPTS that finds enough inliers.

    Returns the state, the best result, and the checks, of which the last one passed if the frame is localised.
    """
    best = latest = TrackingResult.nothing()
    decisions = list[Decision]()
    if state.last.left is None:
        return state, best, ()
    for attempt in ATTEMPTS:
        if attempt.runs(setup, latest):
            state, latest = attempt.find(setup, state, images, predicted, latest)
            best = best.better(latest)
        if attempt.check is not None:
            decisions.append(attempt.check.of(best.inliers, needed_inliers(setup, state)))
            if decisions[-1].passed:
                break
    return state, best, tuple(decisions)


def needed_inliers(setup: Setup, state: ModernStereoState) -> int:
    """Returns the number of inliers with which no further attempt is made to localise a frame."""
    return max(setup.min_inliers, int(np.ceil(MIN_INLIER_SHARE * len(state.last.points))))


# The attempts


def find_at_predictions(
    setup: Setup, state: ModernStereoState, images: StereoImages, predicted: Pose, latest: TrackingResult
) -> tuple[ModernStereoState, TrackingResult]:
    """Finds the points where the motion model predicts them; near their last positions before a motion is known."""
    last = state.last
    if not len(last.points):
        return state, latest
    is_guided = last.motion_s > 0
    expected = Expected.of(setup, state, predicted, steady(last.rate))
    tracked = search_patches(setup, state, images, expected) if is_guided and setup.searches_patches else None
    as_predicted = tracked is not None
    if tracked is None:
        tracked = _tracked_from_last(setup, state, images.left, expected if is_guided else None)
        tracked = realigned(setup, state, images.left, tracked, expected)
    tracked = match_right(setup, state, images, tracked, predicted, is_guided)
    tracked = localise(setup, state, images, tracked, predicted)
    if setup.rolls and last.motion_s <= 0 and tracked.located is not None:
        return _with_first_motion(setup, state, images, tracked, tracked.located.camera_from_world)
    return state, replace(tracked, as_predicted=as_predicted)


def find_at_last_positions(
    setup: Setup, state: ModernStereoState, images: StereoImages, predicted: Pose, latest: TrackingResult
) -> tuple[ModernStereoState, TrackingResult]:
    """Finds the points near their last positions."""
    if not len(state.last.points):
        return state, TrackingResult.nothing()
    expected = Expected.of(setup, state, predicted, steady(state.last.rate))
    tracked = _tracked_from_last(setup, state, images.left, None)
    tracked = realigned(setup, state, images.left, tracked, expected)
    tracked = match_right(setup, state, images, tracked, predicted)
    return state, localise(setup, state, images, tracked, predicted)


def find_at_projections(
    setup: Setup, state: ModernStereoState, images: StereoImages, predicted: Pose, latest: TrackingResult
) -> tuple[ModernStereoState, TrackingResult]:
    """Finds all points where the latest pose, and the motion during the exposure, project them.

    The latest result compared patches warped by a wrong prediction: its positions are biased, and many points are
    missing.
    """
    if latest.located is None:
        return state, latest
    motion = steady(state.last.rate) if latest.motion is None else latest.motion
    expected = Expected.of(setup, state, latest.located.camera_from_world, motion)
    tracked = realigned(setup, state, images.left, projected(setup, state, expected), expected)
    tracked = match_right(setup, state, images, tracked, expected.left_from_world)
    return state, localise(setup, state, images, tracked, expected.left_from_world, motion)


ATTEMPTS = (
    Attempt(lambda setup, latest: True, find_at_predictions),
    Attempt(lambda setup, latest: setup.rolls or not latest.as_predicted, find_at_projections, checks.GUIDED_POINTS),
    Attempt(lambda setup, latest: True, find_at_last_positions),
    Attempt(lambda setup, latest: True, find_at_projections, checks.NEARBY_POINTS),
)
"""The attempts, in order. If all fail, descriptors are compared, see recover.relocalise."""


def _with_first_motion(
    setup: Setup, state: ModernStereoState, images: StereoImages, tracked: TrackingResult, pose: Pose
) -> tuple[ModernStereoState, TrackingResult]:
    """Corrects the first frame for its motion during the exposure, known since the second frame, which has `pose`.

    Returns the state with points at the time of the first frame's middle row, and the second frame localised by them.
    """
    last, (key, *others) = state.last, state.map.keys
    seconds = (images.time_ns - last.time_ns) * 1e-9
    motion = steady(twist_of(pose @ last.left_from_world.inverse()) / seconds)
    near = points_at_middle(setup.camera, key.left_from_world.apply(state.map.xyz), motion - key.motion)
    xyz = key.left_from_world.inverse().apply(near)
    world = replace(state.map, xyz=xyz, keys=(replace(key, motion=motion), *others))
    state = replace(state, map=world)
    moving = replace(state, last=replace(last, motion=pose @ last.left_from_world.inverse(), motion_s=seconds))
    tracked = match_right(setup, moving, images, tracked, pose)
    return state, localise(setup, moving, images, tracked, pose)


# Where points are expected, and how they are found in the left image


@dataclass(frozen=True, eq=False)
class Expected:
    """The expected pose of a frame, and the last frame's points as seen from there."""

    left_from_world: Pose
    near: Array
    """(N, 3) in the left camera; for a rolling shutter at the times of their rows."""

    @staticmethod
    def of(setup: Setup, state: ModernStereoState, left_from_world: Pose, motion: Array) -> Expected:
        """Returns the points as seen from a pose, with the `motion` (12,) during the exposure, see rolling.steady."""
        xyz = state.map.xyz[state.map.places(state.last.points.ids)]
        return Expected(left_from_world, points_at_rows(setup.camera, left_from_world.apply(xyz), motion))


def search_patches(
    setup: Setup, state: ModernStereoState, images: StereoImages, expected: Expected
) -> TrackingResult | None:
    """Finds the keyframe's patches near their expected positions in the left image; None if too few are found.

    Patches are aligned at half size first, which takes half the time of tracking from the last image, and also follows
    points that grow near the sides.
    """
    last, world = state.last, state.map
    if last.key_left is None or last.key_half is None:
        return None
    patches = _Patches.of(setup, state, expected)
    start = world.left(setup.camera).project(expected.near[patches.of_point])
    inside = _inside(images.left, start)
    start[~inside] = 0.0  # no patch is there
    coarse, score = align(last.key_half, patches.uv / 2, images.half, start / 2, patches.warps, bends=2 * patches.bends)
    good = (score > MIN_CORRELATION) & _within(2 * coarse, start, PREDICTION_SEARCH_PX)
    start = np.where(good[:, None], 2 * coarse, start)
    found, score = align(last.key_left, patches.uv, images.left, start, patches.warps, bends=patches.bends)
    good = inside & (score > MIN_CORRELATION) & _within(found, start, MAX_SHIFT_PX)
    if good.sum() < MIN_PREDICTED_SHARE * inside.sum():
        return None
    uv, status = last.points.uv.copy(), np.full(len(last.points), TrackStatus.LOST, np.uint8)
    uv[patches.of_point[good]] = found[good]
    status[patches.of_point[good]] = TrackStatus.ALIVE
    status[patches.of_point[~inside]] = TrackStatus.OUT_OF_IMAGE
    return TrackingResult.in_left(uv, status, world.places(last.points.ids))


def projected(setup: Setup, state: ModernStereoState, expected: Expected) -> TrackingResult:
    """Returns the points at their projections into the left image."""
    uv = state.map.left(setup.camera).in_image(expected.near)
    inside = np.isfinite(uv[:, 0])
    status = np.where(inside, TrackStatus.ALIVE, TrackStatus.OUT_OF_IMAGE).astype(np.uint8)
    uv = np.where(inside[:, None], uv, 0.0).astype(np.float32)
    return TrackingResult.in_left(uv, status, state.map.places(state.last.points.ids))


def realigned(
    setup: Setup, state: ModernStereoState, left: Image, tracked: TrackingResult, expected: Expected
) -> TrackingResult:
    """Aligns tracked positions with the keyframe's patches, as chains of small steps drift, most at rest.

    Points that no longer resemble their patch are lost.
    """
    last = state.last
    if last.key_left is None:
        return tracked
    patches = _Patches.of(setup, state, expected)
    alive = tracked.status[patches.of_point] == TrackStatus.ALIVE
    which = patches.of_point[alive]
    start, warps = tracked.uv[which], patches.warps[alive]
    found, score = align(last.key_left, patches.uv[alive], left, start, warps, bends=patches.bends[alive])
    good = (score > MIN_CORRELATION) & _within(found, start, MAX_SHIFT_PX)
    uv, status = tracked.uv.copy(), tracked.status.copy()
    uv[which[good]] = found[good]
    status[which[~good]] = TrackStatus.LOST
    return replace(tracked, uv=uv, status=status)


def _tracked_from_last(
    setup: Setup, state: ModernStereoState, left: Image, expected: Expected | None
) -> TrackingResult:
    """Tracks the points by the front end from the last left image, starting at their expected or at their last
    positions."""
    last, world = state.last, state.map
    before, uv = required(last.left, "no frame was localised yet"), last.points.uv
    if expected is None:
        # Tracking from predictions may have failed because the exposure changed.
        uv, status = setup.front_end.tracker.track(before, as_bright(left, before), uv)
    else:
        start = world.left(setup.camera).project(expected.near).astype(np.float32)
        behind = ~np.isfinite(start).all(1)
        start[behind] = uv[behind]
        uv, status = setup.front_end.guided.track(before, left, uv, start)
    return TrackingResult.in_left(uv, status, world.places(last.points.ids))


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches of K points that the newest keyframe observed."""

    of_point: NDArray[np.int64]
    """(K,) indices of the last frame's points."""
    uv: NDArray[np.float32]
    """(K, 2) [px] in the keyframe's left image."""
    warps: Array
    """(K, 2, 2) pixels of the keyframe per pixel of the image."""
    bends: Array
    """(K, 2) see patches.align."""

    @staticmethod
    def of(setup: Setup, state: ModernStereoState, expected: Expected) -> _Patches:
        """Returns patches warped to the expected pose: others would drift."""
        key, camera = state.map.keys[-1], setup.camera
        old, new = common(key.ids, state.last.points.ids)
        xy = key.seen[old, :2]
        start = camera.project(np.column_stack([xy, np.ones(len(old))])).astype(np.float32)
        way = expected.left_from_world @ key.left_from_world.inverse()
        depth = way.inverse().apply(expected.near[new])[:, 2]
        return _Patches(new, start, *warps_from(setup, way, xy, depth, key.slants[old]))


def warps_from(setup: Setup, way: Pose, xy: Array, depth: Array, slants: Array) -> tuple[Array, Array]:
    """Returns the warps and bends (see patches.align) from an image back to a left image.

    In the left image points are at normalised `xy` (N, 2) and `depth` (N,) on surfaces with `slants` (N, 2); `way` is
    image_from_left.
    """
    warps, bends, known = slanted_warps(setup.camera, way, xy, depth, slants, setup.baseline_m)
    back = way.inverse()
    near = way.apply(np.column_stack([xy, np.ones(len(xy))])[~known] * depth[~known, None])
    warps[~known], bends[~known] = warps_of(setup.camera, back.rotation[None], back.translation[None], near)
    return warps, bends


def _within(a: Array, b: Array, limit: float) -> NDArray[np.bool_]:
    """Returns a mask (N,) of the positions (N, 2) that differ by less than `limit`."""
    apart = a - b
    return np.einsum("ni,ni->n", apart, apart) < limit**2


def _inside(image: Image, uv: Array) -> NDArray[np.bool_]:
    """Returns a mask (N,) of the positions (N, 2) [px] inside the image and off its border; NaN is outside."""
    height, width = image.shape
    last = (width - 1 - BORDER_PX, height - 1 - BORDER_PX)
    return np.asarray(((uv >= BORDER_PX) & (uv <= last)).all(axis=1))
