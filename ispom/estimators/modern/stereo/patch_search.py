"""Points found by the patches of the newest key frame, warped as the map says: nothing drifts from pair to pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.pair import NewPair
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.features.klt import Klt
from ispom.features.patches import align, warps_of
from ispom.features.slanted import slanted_warps
from ispom.geometry import Array, Pose
from ispom.numerics.places import common
from ispom.types import Image, TrackStatus

MIN_CORRELATION = 0.7
"""Normalised correlation of a patch found again with its origin; less is another thing."""
MAX_SHIFT_PX = 1.5
"""Alignment with the origin corrects tracking by no more."""
PREDICTION_SEARCH_PX = 8.0
"""Points are looked for no farther from where the motion leads: half-size patches are drawn in from 4 px of theirs."""
LED_SHARE = 0.7
"""Of the points that the motion leads into sight, those found there; where it is fewer, they are tracked as well."""
BORDER_PX = Klt().border_px


@dataclass(frozen=True, eq=False)
class _Patches:
    """Of K points that the newest key frame saw."""

    of: NDArray[np.int64]
    """(K,) which of the last pair's points."""
    uv: NDArray[np.float32]
    """(K, 2) [px] in the key frame's left image."""
    warps: Array
    """(K, 2, 2) its pixels per pixel of the image."""
    bends: Array
    """(K, 2) see patches.align."""

    @staticmethod
    def of_points(setup: Setup, last: LastPair, world: StereoMap, near: Array, predicted: Pose) -> _Patches:
        """Seen from `predicted`, where the points lie `near` (N, 3) to the camera: patches that do not grow, or slant,
        as their surfaces do drift."""
        key, camera = world.keys[-1], setup.camera
        old, new = common(key.ids, last.points.ids)
        xy = key.seen[old, :2]
        start = camera.project(np.column_stack([xy, np.ones(len(old))])).astype(np.float32)
        way = predicted @ key.left_from_world.inverse()
        depth = way.inverse().apply(near[new])[:, 2]
        return _Patches(new, start, *warps_from(setup, way, xy, depth, key.slants[old]))


def warps_from(setup: Setup, way: Pose, xy: Array, depth: Array, slants: Array) -> tuple[Array, Array]:
    """See patches.align: to a left image in which points are at normalised `xy` (N, 2) and `depth` (N,) on surfaces
    with `slants` (N, 2), from another one, `way` from it."""
    warps, bends, known = slanted_warps(setup.camera, way, xy, depth, slants, setup.baseline_m)
    back = way.inverse()
    near = way.apply(np.column_stack([xy, np.ones(len(xy))])[~known] * depth[~known, None])
    warps[~known], bends[~known] = warps_of(setup.camera, back.rotation[None], back.translation[None], near)
    return warps, bends


def track_from_prediction(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, near: Array, predicted: Pose
) -> tuple[NDArray[np.float32], NDArray[np.uint8]] | None:
    """Places (N, 2) [px] in the left image, and TrackStatus (N,), about where the motion leads the points; None where
    that finds too few.

    At half size first. It takes half the time of tracking from the last image, and follows what grows near the sides.
    """
    if last.key_left is None or last.key_half is None:
        return None
    patches = _Patches.of_points(setup, last, world, near, predicted)
    expected = world.left(setup.camera).project(near[patches.of])
    inside = _inside(new.left, expected)
    expected[~inside] = 0.0  # no patch is there
    coarse, score = align(last.key_half, patches.uv / 2, new.half, expected / 2, patches.warps, bends=2 * patches.bends)
    good = (score > MIN_CORRELATION) & _within(2 * coarse, expected, PREDICTION_SEARCH_PX)
    start = np.where(good[:, None], 2 * coarse, expected)
    found, score = align(last.key_left, patches.uv, new.left, start, patches.warps, bends=patches.bends)
    good = inside & (score > MIN_CORRELATION) & _within(found, start, MAX_SHIFT_PX)
    if good.sum() < LED_SHARE * inside.sum():
        return None
    uv, status = last.points.uv.copy(), np.full(len(last.points), TrackStatus.LOST, np.uint8)
    uv[patches.of[good]] = found[good]
    status[patches.of[good]] = TrackStatus.ALIVE
    status[patches.of[~inside]] = TrackStatus.OUT_OF_IMAGE
    return uv, status


def realigned(
    setup: Setup,
    last: LastPair,
    world: StereoMap,
    left: Image,
    uv: NDArray[np.float32],
    status: NDArray[np.uint8],
    near: Array,
    predicted: Pose,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Tracked places sought again: a chain of small steps drifts, most at rest.

    What does not look like its patch any more is lost.
    """
    if last.key_left is None:
        return uv, status
    patches = _Patches.of_points(setup, last, world, near, predicted)
    alive = status[patches.of] == TrackStatus.ALIVE
    new = patches.of[alive]
    again, score = align(
        last.key_left, patches.uv[alive], left, uv[new], patches.warps[alive], bends=patches.bends[alive]
    )
    good = (score > MIN_CORRELATION) & _within(again, uv[new], MAX_SHIFT_PX)
    uv, status = uv.copy(), status.copy()
    uv[new[good]] = again[good]
    status[new[~good]] = TrackStatus.LOST
    return uv, status


def _within(a: Array, b: Array, limit: float) -> NDArray[np.bool_]:
    """(N,) which of the places (N, 2) are no farther apart."""
    apart = a - b
    return np.einsum("ni,ni->n", apart, apart) < limit**2


def _inside(image: Image, uv: Array) -> NDArray[np.bool_]:
    """(N,) which of the places (N, 2) lie in the image; no NaN does."""
    height, width = image.shape
    last = (width - 1 - BORDER_PX, height - 1 - BORDER_PX)
    return np.asarray(((uv >= BORDER_PX) & (uv <= last)).all(axis=1))
