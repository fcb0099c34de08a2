"""Finding a pair again that tracking lost: by descriptors of the key frames' images, then by patches warped between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.places import FEATURES, Place, confirmed, in_sight, matches_by_chance, plausible
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints
from ispom.estimators.modern.stereo.pair_calibration import intersected
from ispom.estimators.modern.stereo.patch_search import warps_from
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap, emptied, with_key
from ispom.features.descriptors import match_near
from ispom.features.interfaces import Features
from ispom.features.patches import align
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.solvers.multiview.resection import Resection, refine_pose, resect, resect_optimised

MIN_DISPARITY_PX = 1.0
"""Of points intersected anew to find the pose by descriptors: with less their depth is known to no better than half."""
FEWEST = 8
"""Points that agree with a pose, from which the others that it tells where to look for are looked for."""
AROUND = (8, 4, 2)
"""Largest errors of a track within which the others are looked for, one after the other."""
ENOUGH = 2
"""With so many times the least number of points no further key frame is compared."""
MIN_CORRELATION = 0.7
"""Normalised correlation of a patch with that of the key frame, warped; less keeps the place of the descriptor."""
MAX_SHIFT_PX = 3.0
"""Descriptors are placed to about a pixel; alignment with the patch corrects them by no more."""


@dataclass(frozen=True, eq=False)
class Recognised:
    """A pair that shows what a key frame saw."""

    place: Place
    points: PairPoints
    """What both show, as the key frame saw it."""
    xyz: Array
    """(N, 3) in the key frame's left camera."""
    uv: NDArray[np.float32]
    """(N, 2) [px] where the pair's left image has them."""
    left_from_place: Pose

    @property
    def left_from_world(self) -> Pose:
        return self.left_from_place @ self.place.camera_from_world


def recognised(setup: Setup, state: ModernStereoState, new: NewPair) -> tuple[ModernStereoState, Recognised | None]:
    """The key frame that shows most of what the pair shows, if it shows anything; and the state, with descriptions."""
    now, best = setup.front_end.descriptor.detect_and_describe(new.left, FEATURES), None
    for place in state.places.alike(new.left, state.lost_pairs):
        described = place.described(setup.front_end.descriptor)
        if described is not place:
            state = replace(state, places=state.places.with_features(described))
        found = _compared(setup, state, described, new, now)
        if found is not None and (best is None or len(found.points) > len(best.points)):
            best = found
            if len(best.points) >= ENOUGH * setup.min_inliers:
                break
    return state, best


def _compared(setup: Setup, state: ModernStereoState, place: Place, new: NewPair, now: Features) -> Recognised | None:
    """The pose by resection from what both images show, and the points that agree with it; None for too few points.

    Resection is tried in two ways, as either may end where only points that lie close together agree: the right one
    lets more points be found where it puts them.
    """
    assert place.features is not None
    points, descriptors, xyz = _intersected(setup, state, place, place.features)
    then, best = replace(place.features, uv=points.uv, descriptors=descriptors), None
    pairs = setup.front_end.matcher.match(then, now)
    left = state.map.left(setup.camera)
    for way in (resect, resect_optimised):
        found = _agreeing(setup, left, xyz, now.uv, pairs, way)
        if found is None or found[1].sum() < FEWEST:
            continue
        looked_for = _looked_for(setup, left, xyz, then, now, found[0])
        if looked_for is not None and (best is None or looked_for[2].sum() > best[2].sum()):
            best = looked_for
    if best is None:
        return None
    pose, both, good = best
    i, j = both[good].T
    points = PairPoints(state.next_id + np.arange(len(i)), points.uv[i], points.disparity_px[i], points.slants[i])
    return Recognised(place, points, xyz[i], _aligned(setup, place, points, xyz[i], now.uv[j], pose, new), pose)


def _looked_for(
    setup: Setup, left: Lens, xyz: Array, then: Features, now: Features, pose: Pose
) -> tuple[Pose, NDArray[np.int64], NDArray[np.bool_]] | None:
    """left_from_place by all that is found where a pose puts it: pairs (M, 2), and which (M,) agree; None for too few.

    A pose by points that lie close together is off for the others: they are looked for farther around at first.
    """
    for around in AROUND:
        near = pose.apply(xyz)
        expected = in_sight(setup.camera, near, left.project(near))
        pairs = match_near(setup.front_end.matcher, then, now, expected, around * setup.max_error_px)
        found = _agreeing(setup, left, xyz, now.uv, pairs, partial(refine_pose, camera_from_world=pose))
        if found is None:
            return None
        pose, good = found
    chance = partial(matches_by_chance, setup.front_end.matcher, then, now, expected, AROUND[-1] * setup.max_error_px)
    return (pose, pairs, good) if confirmed(pairs[good, 0], expected, FEWEST, chance) else None


def _intersected(
    setup: Setup, state: ModernStereoState, place: Place, features: Features
) -> tuple[PairPoints, NDArray[np.float32], Array]:
    """The features of a key frame that have a depth, their descriptors, and points (N, 3) in its left camera."""
    left, right = place.images
    reduced = PointSearch().search(left, right, place.reduced(features.uv).astype(np.float32))
    disparity = (reduced.disparity_px / place.reduction).astype(np.float32)
    good = disparity >= MIN_DISPARITY_PX
    points = PairPoints(np.arange(int(good.sum())), features.uv[good], disparity[good], reduced.slants[good])
    motion = np.zeros(12) if place.motion is None else place.motion
    return points, features.descriptors[good], intersected(setup, state.map, points, motion)


def _agreeing(
    setup: Setup,
    left: Lens,
    xyz: Array,
    uv: NDArray[np.float32],
    pairs: NDArray[np.int64],
    solve: Callable[..., Resection | None],
) -> tuple[Pose, NDArray[np.bool_]] | None:
    """left_from_place by which points and places are pairs (M, 2), and which (M,) agree."""
    xyz, x = xyz[pairs[:, 0]], left.normalise(uv[pairs[:, 1]].astype(float))
    found = solve(xyz, x, threshold=2 * setup.limit)
    if found is None:
        return None
    pose = found.camera_from_world
    return pose, plausible(found.inliers, xyz[:, 2], pose.apply(xyz)[:, 2])


def _aligned(
    setup: Setup, place: Place, points: PairPoints, xyz: Array, uv: NDArray[np.float32], pose: Pose, new: NewPair
) -> NDArray[np.float32]:
    """Places (N, 2) [px] in the left image, set right by the key frame's patches as seen from `pose`."""
    warps, bends = warps_from(setup, pose, xyz[:, :2] / xyz[:, 2:], xyz[:, 2], points.slants)
    warps = place.reduction * warps
    found, score = align(place.images[0], place.reduced(points.uv), new.left, uv, warps, bends=bends)
    good = (score > MIN_CORRELATION) & (np.linalg.norm(found - uv, axis=1) < MAX_SHIFT_PX)
    return np.where(good[:, None], found, uv).astype(np.float32)


def joined(setup: Setup, state: ModernStereoState, found: Recognised) -> ModernStereoState:
    """The state whose window holds the key frame and what it has in common with the pair, to be followed on from.

    A key frame that has left the window begins a new one, as sure of its pose as it was.
    """
    place, points = found.place, found.points
    world = state.map
    if place.time_ns not in {k.time_ns for k in world.keys}:
        state = replace(state, settled=state.settled.extended((k.time_ns, k.left_from_world) for k in world.keys))
        nothing = PairPoints()
        known = np.zeros((6, 6)) if place.covariance is None else place.covariance
        seen, motion = nothing.seen_by(setup.camera), np.zeros(12) if place.motion is None else place.motion
        key = KeyFrame(place.time_ns, place.camera_from_world, nothing.ids, seen, motion, nothing.slants, setup.shutter)
        world = with_key(emptied(world), key, setup.extra_sigma, setup.settling_s, known)
    world = world.with_points(points.ids, place.camera_from_world.inverse().apply(found.xyz))
    last = replace(state.last, points=PairPoints.joined(state.last.points, points))
    next_id = state.next_id + len(points)
    return replace(state, map=_seen_at(world, place.time_ns, points, setup), last=last, next_id=next_id)


def _seen_at(world: StereoMap, time_ns: int, points: PairPoints, setup: Setup) -> StereoMap:
    """With these points among what the key frame at that time saw."""
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
