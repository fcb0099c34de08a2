"""Following the points of the last located pair into a new one: guided by the motion, around, or by descriptors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.locate import located, relocated
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, Sighting
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.frontends import sift
from ispom.frontends.contrast import has_contrast
from ispom.frontends.exposure import as_bright
from ispom.frontends.klt import Klt
from ispom.frontends.patches import align, warps_of
from ispom.frontends.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.types import Decision, Image, TrackStatus

MIN_CORRELATION = 0.7
"""Normalised correlation of a patch found again with its origin; less is another thing."""
MAX_SHIFT_PX = 1.5
"""Alignment with the origin corrects tracking by no more."""
ENOUGH_SHARE = 0.3
"""Share of the last pair's points that must agree with the pose, before other ways to find them are tried."""
FEATURES = 2000
"""Described in an image, where tracking lost its way."""
NEAREST_BASELINES = 0.2
"""Depth, in baselines, of points that the prediction puts nearer or behind: as far as disparities are looked for."""
UNGUIDED, GUIDED = Klt(levels=5), Klt(levels=2, max_forward_backward_px=np.inf)
"""Guided is from a good guess and one way only: the key frame's patch then checks what was found."""


def sight(setup: Setup, last: LastPair, world: StereoMap, new: NewPair) -> tuple[Sighting, tuple[Decision, ...]]:
    """The points of the last pair in this one, and the pose: guided by the motion so far, or by descriptors."""
    predicted = last.predicted(new.time_ns)
    sighting = _follow(setup, last, world, new, predicted, guided=last.motion_s > 0)
    if last.left is None:
        return sighting, ()
    wanted = max(setup.min_inliers, ENOUGH_SHARE * len(last.points))
    guided = checks.GUIDED_POINTS.of(sighting.inliers, wanted)
    if guided.passed:
        return sighting, (guided,)
    sighting = _better(sighting, _follow(setup, last, world, new, predicted, guided=False))
    nearby = checks.NEARBY_POINTS.of(sighting.inliers, wanted)
    if nearby.passed:
        return sighting, (guided, nearby)
    if not has_contrast(new.left, last.left):
        nothing = checks.DESCRIBED_POINTS.of(sighting.inliers, setup.min_inliers, "the image shows nothing to describe")
        return sighting, (guided, nearby, nothing)
    features = sift.detect_and_describe(new.left, FEATURES)
    described = relocated(setup, last, world, features, last.described or _described(last))
    if described is not None:
        again = _follow(setup, last, world, new, described, guided=True)
        sighting = _better(sighting, replace(again, features=features))
    return sighting, (guided, nearby, checks.DESCRIBED_POINTS.of(sighting.inliers, setup.min_inliers))


def _better(first: Sighting, second: Sighting) -> Sighting:
    """The one with more inliers; of equal ones the first."""
    return second if second.inliers > first.inliers else first


def _described(last: LastPair) -> sift.Features:
    assert last.left is not None
    return sift.detect_and_describe(last.left, FEATURES)


def _follow(setup: Setup, last: LastPair, world: StereoMap, new: NewPair, predicted: Pose, guided: bool) -> Sighting:
    """Track into the left image, from where `predicted` puts the points or from where they were; then to the right."""
    points, place = last.points, world.places(last.points.ids)
    if last.left is None or not len(points):
        return Sighting.nothing()
    near = predicted.apply(world.xyz[place])
    uv, status = _tracked(setup, last, new.left, near if guided else None)
    uv, status = _realigned(setup, last, world, new.left, uv, status, near, predicted)
    alive = np.flatnonzero(status == TrackStatus.ALIVE)
    disparity = np.full(len(points), np.nan, np.float32)
    depth = np.maximum(near[alive, 2], NEAREST_BASELINES * setup.baseline_m)
    expected = (setup.camera.fx * setup.baseline_m / depth).astype(np.float32)
    disparity[alive], lower = PointSearch().follow(new.left, new.right, uv[alive], expected)
    seen = PairPoints(points.ids[alive], uv[alive], disparity[alive]).seen_by(setup.camera)
    motion = located(setup, last, world, place[alive], seen, predicted, new.time_ns)
    if motion is not None:
        status[alive[~motion.inliers]] = TrackStatus.REPROJECTION
    return Sighting(uv, disparity, status, place, motion, alive, lower / setup.camera.fy)


def _tracked(
    setup: Setup, last: LastPair, left: Image, near: Array | None
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Places (N, 2) [px] in the left image and TrackStatus (N,); from where `near` (N, 3) to the camera puts them."""
    assert last.left is not None
    uv = last.points.uv
    if near is None:
        # Where tracking failed so far, the exposure may have changed.
        return UNGUIDED.track(last.left, as_bright(left, last.left), uv)
    expected = setup.camera.project(near).astype(np.float32)
    behind = ~np.isfinite(expected).all(1)
    expected[behind] = uv[behind]
    return GUIDED.track(last.left, left, uv, expected)


def _realigned(
    setup: Setup,
    last: LastPair,
    world: StereoMap,
    left: Image,
    uv: NDArray[np.float32],
    status: NDArray[np.uint8],
    near: Array,
    predicted: Pose,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Places sought again from the newest key frame's image: a chain of small steps drifts, most at rest.

    Patches are warped as the points `near` (N, 3) to the camera say, seen from `predicted`: unwarped ones that grow
    drift outwards. What does not look like its patch any more is lost.
    """
    if last.key_left is None:
        return uv, status
    key, camera = world.keys[-1], setup.camera
    _, old, new = np.intersect1d(key.ids, last.points.ids, assume_unique=True, return_indices=True)
    alive = status[new] == TrackStatus.ALIVE
    old, new = old[alive], new[alive]
    start = camera.project(np.column_stack([key.seen[old, :2], np.ones(len(old))])).astype(np.float32)
    back = key.left_from_world @ predicted.inverse()
    warps = warps_of(camera, back.rotation[None], back.translation[None], near[new])
    again, score = align(last.key_left, start, left, uv[new], warps)
    good = (score > MIN_CORRELATION) & (np.linalg.norm(again - uv[new], axis=1) < MAX_SHIFT_PX)
    uv, status = uv.copy(), status.copy()
    uv[new[good]] = again[good]
    status[new[~good]] = TrackStatus.LOST
    return uv, status
