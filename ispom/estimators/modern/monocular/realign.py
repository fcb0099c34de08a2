"""Tracks set right by their patches of origin: a chain of small steps from image to image drifts."""

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
"""Normalised correlation of a patch found again with its origin; less is another thing."""
TAPER_PX = 3.0
"""Deviation by which pixels of a patch count (see patches.align). What lies before or behind a point moves otherwise,
and mostly is at the patch's border: where all counted the same, the end of a corridor was seen to come nearer, and the
camera to turn with each step to a side. Poses of simulations are best with 2.3 to 3, off by a tenth more with 4, and by
up to a third more where all count the same; KITTI 06 is the same with all of them."""
MAX_SHIFT_PX = 3.0
"""Alignment with the origin corrects tracking by no more."""
MIN_WARP, MAX_WARP = 0.35, 1.8
"""Change of area, origin per image, within which the patch of the origin can be used."""
BORDER_PX = 6
"""Half a patch and its gradients: nearer to the image's border none is compared."""


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
    """Each point where its patch of origin, warped as the scene (N, 3) says, fits best; which ones (N,) were compared.

    Looked for around `expected` (N, 2) [px]. `pose` of the image, and `origins` by time: world_from_camera. What does
    not look like its origin is lost; what cannot be compared is lost where it does not lead back to the last image.
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
    """origin_from_camera (K, 3, 3), (K, 3) of poses world_from_camera."""
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
    """`patches.align` of points (N,) with patches of several images: `origin` (N,) says which."""
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
    """Where an image has the patches that a place has at `seen` (N, 2) [px], looked for around `expected` (N, 2) [px];
    and which (N,) it has. `near` (N, 3): their points in the image's camera; `reduction`: its pixels per the camera's.
    """
    turn, way = place_from_camera.rotation[None], place_from_camera.translation[None]
    warps, bends = warps_of(lens.camera, turn, way, near, slopes(near))
    warps, bends = place.reduction / reduction * warps, bends / reduction
    start = (expected + 0.5) * reduction - 0.5
    found, score = align(place.images[0], place.reduced(seen), image, start, warps, bends=bends, taper_px=TAPER_PX)
    found = (found + 0.5) / reduction - 0.5
    return found, (score > MIN_CORRELATION) & (np.linalg.norm(found - expected, axis=1) < MAX_SHIFT_PX)
