"""Corrects tracks by aligning them with their patches of origin, as tracking from image to image drifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.surfaces import slopes
from ispom.estimators.modern.monocular.tracks import Followed, LiveTracks
from ispom.features.images import as_bright
from ispom.features.klt import Klt
from ispom.features.patches import align, warps_of
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.reductions import both, lengths
from ispom.types import Image, TrackStatus

BACK = Klt(levels=1)
MIN_CORRELATION = 0.8
"""Least normalised correlation of a patch with its origin."""
TAPER_PX = 3.0
"""Standard deviation [px] of the pixel weights in a patch (see patches.align). Surfaces at other depths move
differently, and are mostly at the patch's border: with equal weights the end of a corridor seemed to come nearer, and
the camera to rotate with each sideways step. Simulations give the best poses with 2.3 to 3, errors larger by a tenth
with 4, and by up to a third with equal weights; KITTI 06 is the same with all of them."""
MAX_SHIFT_PX = 3.0
"""Largest correction [px] of a track by alignment with its origin."""
MIN_WARP, MAX_WARP = 0.35, 1.8
"""Limits of the change of area, origin relative to image, within which the patch of the origin is used."""
BORDER_PX = 6
"""Half a patch and its gradients [px]: no patch is compared nearer to the image's border."""


def realigned(
    lens: Lens,
    live: LiveTracks,
    grey: Image,
    followed: Followed,
    expected: NDArray[np.float32],
    scene: Array,
    pose: Pose,
    origins: dict[int, Pose],
) -> tuple[Followed, NDArray[np.bool_]]:
    """Aligns each point with its patch of origin, warped by the scene (N, 3); also returns which (N,) were compared.

    The search is around `expected` (N, 2) [px]. `pose` of the image, and `origins` by time, are world_from_camera. A
    point that does not match its origin is lost; one that cannot be compared is lost if it fails the backward check.
    """
    uv, status = followed.uv.copy(), followed.status.copy()
    in_camera = pose.inverse().apply(scene)
    height, width = grey.shape
    last = (width - BORDER_PX - 1, height - BORDER_PX - 1)
    inside = both((expected >= BORDER_PX) & (expected < last))
    usable = [(time_ns, image) for time_ns, image in live.origins if time_ns in origins]
    origin = places(np.array([t for t, _ in usable], np.int64), live.origin_ns)
    mine = np.flatnonzero((origin >= 0) & inside & (in_camera[:, 2] > 0))
    compared = np.zeros(len(uv), bool)
    if len(mine):
        turns, ways = _motions(tuple(origins[time_ns] for time_ns, _ in usable), pose)
        xyz = in_camera[mine]
        warps, bends = warps_of(lens.camera, turns[origin[mine]], ways[origin[mine]], xyz, slopes(xyz))
        area = np.abs(warps[:, 0, 0] * warps[:, 1, 1] - warps[:, 0, 1] * warps[:, 1, 0])
        fit = (area > MIN_WARP) & (area < MAX_WARP)
        mine, warps, bends = mine[fit], warps[fit], bends[fit]
        found, score = _aligned(
            [image for _, image in usable], origin[mine], live.origin_uv[mine], grey, expected[mine], warps, bends
        )
        good = (score > MIN_CORRELATION) & (lengths(found - expected[mine]) < MAX_SHIFT_PX)
        uv[mine[good]] = found[good]
        status[mine[~good & (status[mine] == TrackStatus.ALIVE)]] = TrackStatus.LOST
        status[mine[good]] = TrackStatus.ALIVE
        compared[mine] = True
    other = np.flatnonzero(~compared & (status == TrackStatus.ALIVE))
    if len(other) and live.grey is not None:
        bright = as_bright(grey, live.grey) if followed.bright is None else followed.bright
        status[other] = BACK.checked(live.grey, bright, live.uv[other], uv[other])
    return replace(followed, uv=uv, status=status), compared


def _motions(origins: tuple[Pose, ...], pose: Pose) -> tuple[Array, Array]:
    """Returns origin_from_camera (K, 3, 3), (K, 3) for poses world_from_camera."""
    back = np.stack([p.rotation.T for p in origins])
    ways = back @ (pose.translation - np.stack([p.translation for p in origins]))[:, :, None]
    return back @ pose.rotation, ways[..., 0]


def _aligned(
    images: list[Image],
    origin: NDArray[np.int64],
    origin_uv: Array,
    grey: Image,
    expected: Array,
    warps: Array,
    bends: Array,
) -> tuple[Array, Array]:
    """Calls `patches.align` for points (N,) with patches of several images, of indices `origin` (N,)."""
    order = np.argsort(origin, kind="stable")
    of, origin_uv, expected = origin[order], origin_uv[order], expected[order]
    warps, bends = warps[order], bends[order]
    found, score = np.empty((len(order), 2)), np.empty(len(order))
    ends = np.searchsorted(of, np.arange(len(images)), "right").tolist()
    for image, begin, end in zip(images, [0, *ends], ends, strict=False):
        if begin < end:
            some = slice(begin, end)
            found[order[some]], score[order[some]] = align(
                image, origin_uv[some], grey, expected[some], warps[some], bends=bends[some], taper_px=TAPER_PX
            )
    return found, score


def patches_found(
    lens: Lens,
    place: Keyframe,
    seen: Array,
    place_from_camera: Pose,
    near: Array,
    image: Image,
    expected: Array,
    reduction: float = 1.0,
) -> tuple[Array, NDArray[np.bool_]]:
    """Aligns patches of a keyframe at `seen` (N, 2) [px] with an image, around `expected` (N, 2) [px].

    `near` (N, 3) are their points in the image's camera, `reduction` is the image's size relative to the camera's.
    Returns the positions (N, 2) [px], and which (N,) match.
    """
    turn, way = place_from_camera.rotation[None], place_from_camera.translation[None]
    warps, bends = warps_of(lens.camera, turn, way, near, slopes(near))
    warps, bends = place.reduction / reduction * warps, bends / reduction
    start = (expected + 0.5) * reduction - 0.5
    found, score = align(place.images[0], place.reduced(seen), image, start, warps, bends=bends, taper_px=TAPER_PX)
    found = (found + 0.5) / reduction - 0.5
    return found, (score > MIN_CORRELATION) & (np.linalg.norm(found - expected, axis=1) < MAX_SHIFT_PX)
