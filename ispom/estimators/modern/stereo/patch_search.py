"""Finds points by patches of the newest keyframe, warped by the map, so that no drift accumulates between frames."""

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
"""Least normalised correlation of a match with its patch; below it the match is wrong."""
MAX_SHIFT_PX = 1.5
"""Largest correction [px] of a tracked position by alignment with its patch."""
PREDICTION_SEARCH_PX = 8.0
"""Largest distance [px] of a match from its prediction: alignment at half size converges from 4 px of its pixels."""
LED_SHARE = 0.7
"""Least share of the points predicted in the image that is found there; with fewer, all are tracked instead."""
BORDER_PX = Klt().border_px


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches of K points that the newest keyframe observed."""

    of: NDArray[np.int64]
    """(K,) indices of the last frame's points."""
    uv: NDArray[np.float32]
    """(K, 2) [px] in the keyframe's left image."""
    warps: Array
    """(K, 2, 2) pixels of the keyframe per pixel of the image."""
    bends: Array
    """(K, 2) see patches.align."""

    @staticmethod
    def of_points(setup: Setup, last: LastPair, world: StereoMap, near: Array, predicted: Pose) -> _Patches:
        """Returns patches warped to the pose `predicted`, with points `near` (N, 3) there: others would drift."""
        key, camera = world.keys[-1], setup.camera
        old, new = common(key.ids, last.points.ids)
        xy = key.seen[old, :2]
        start = camera.project(np.column_stack([xy, np.ones(len(old))])).astype(np.float32)
        way = predicted @ key.left_from_world.inverse()
        depth = way.inverse().apply(near[new])[:, 2]
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


def track_from_prediction(
    setup: Setup, last: LastPair, world: StereoMap, new: NewPair, near: Array, predicted: Pose
) -> tuple[NDArray[np.float32], NDArray[np.uint8]] | None:
    """Finds points near their predictions: positions (N, 2) [px] in the left image and TrackStatus (N,).

    Returns None if too few are found. Patches are aligned at half size first, which takes half the time of tracking
    from the last image, and also follows points that grow near the sides.
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
    """Aligns tracked positions with their patches, as chains of small steps drift, most at rest.

    Points that no longer resemble their patch are lost.
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
    """Returns a mask (N,) of the positions (N, 2) that differ by less than `limit`."""
    apart = a - b
    return np.einsum("ni,ni->n", apart, apart) < limit**2


def _inside(image: Image, uv: Array) -> NDArray[np.bool_]:
    """Returns a mask (N,) of the positions (N, 2) [px] inside the image and off its border; NaN is outside."""
    height, width = image.shape
    last = (width - 1 - BORDER_PX, height - 1 - BORDER_PX)
    return np.asarray(((uv >= BORDER_PX) & (uv <= last)).all(axis=1))
