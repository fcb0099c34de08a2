"""Corrects tracks by aligning them with their patches of origin, as tracking from image to image drifts.

Patches are warped by the slopes of the surfaces, which are estimated from the neighbouring points: the inverse depth of
a plane is linear in the image coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.map import TracksInMap
from ispom.estimators.modern.monocular.setup import INLIER
from ispom.estimators.modern.monocular.track import project_points
from ispom.estimators.modern.monocular.tracks import NewImage, TrackingResult
from ispom.estimators.modern.rolling import late_px
from ispom.features.images import as_bright
from ispom.features.klt import Klt
from ispom.features.patches import align, warps_of
from ispom.geometry import Array, Pose
from ispom.kernels import kernel
from ispom.numerics.places import places
from ispom.numerics.reductions import both, lengths
from ispom.types import Image, TrackStatus

BACKWARD = Klt(levels=1)
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
REACH = 0.08
"""Radius [rad] of the neighbourhood: some ten of an image's tracks, and less than the side of a house."""
SAME_SURFACE = 0.02
"""Relative residual of a neighbour's inverse depth at which its weight is halved: other surfaces differ by more."""
STEPS = 4
"""Number of reweighting steps."""
REGULARISATION = 0.05
"""Regularisation of a slope, relative to the weight of a neighbour at the rim: ten neighbours keep nine tenths of the
slope, and three on a line give none across it. With 0.02 to 0.15 the error is 16 to 19 mm on KITTI 06, and 0.16 to 0.21
m on KITTI 00."""
MIN_DEPTH = 1e-6
"""Least depth [m, or the map's unit] of a point in front of the camera."""


def align_with_map(
    tracks: TracksInMap, image: NewImage, tracked: TrackingResult, world_from_camera: Pose
) -> tuple[TrackingResult, NDArray[np.bool_]]:
    """Aligns all tracks with their patches of origin; also returns which (N,) were compared.

    Points of the map that tracking lost or misplaced are searched at their projections. A point that does not match its
    origin is lost; one that cannot be compared is lost if it fails the backward check.
    """
    setup, live = tracks.setup, tracks.live
    expected = _expected_positions(tracks, tracked, world_from_camera)
    uv, status = tracked.uv.copy(), tracked.status.copy()
    in_camera = world_from_camera.inverse().apply(image.scene)
    height, width = image.grey.shape
    last = (width - BORDER_PX - 1, height - BORDER_PX - 1)
    inside = both((expected >= BORDER_PX) & (expected < last))
    origins = {k.time_ns: p for k, p in zip(tracks.map.keys, tracks.map.poses, strict=True)}
    usable = [(time_ns, grey) for time_ns, grey in live.origins if time_ns in origins]
    origin = places(np.array([t for t, _ in usable], np.int64), live.origin_ns)
    mine = np.flatnonzero((origin >= 0) & inside & (in_camera[:, 2] > 0))
    compared = np.zeros(len(uv), bool)
    if len(mine):
        poses = tuple(origins[time_ns] for time_ns, _ in usable)
        rotations, translations = _origins_from_camera(poses, world_from_camera)
        xyz, of = in_camera[mine], origin[mine]
        warps, bends = warps_of(setup.camera, rotations[of], translations[of], xyz, slopes(xyz))
        area = np.abs(warps[:, 0, 0] * warps[:, 1, 1] - warps[:, 0, 1] * warps[:, 1, 0])
        fit = (area > MIN_WARP) & (area < MAX_WARP)
        mine, warps, bends = mine[fit], warps[fit], bends[fit]
        images = [grey for _, grey in usable]
        aligned, score = _align_by_image(
            images, origin[mine], live.origin_uv[mine], image.grey, expected[mine], warps, bends
        )
        good = (score > MIN_CORRELATION) & (lengths(aligned - expected[mine]) < MAX_SHIFT_PX)
        uv[mine[good]] = aligned[good]
        status[mine[~good & (status[mine] == TrackStatus.ALIVE)]] = TrackStatus.LOST
        status[mine[good]] = TrackStatus.ALIVE
        compared[mine] = True
    other = np.flatnonzero(~compared & (status == TrackStatus.ALIVE))
    if len(other) and live.grey is not None:
        bright = as_bright(image.grey, live.grey) if tracked.bright is None else tracked.bright
        status[other] = BACKWARD.checked(live.grey, bright, live.uv[other], uv[other])
    return replace(tracked, uv=uv, status=status), compared


def _expected_positions(tracks: TracksInMap, tracked: TrackingResult, world_from_camera: Pose) -> NDArray[np.float32]:
    """Returns the positions (N, 2) [px] around which tracks are searched: those found, or, for points of the map that
    tracking lost or misplaced, their projections."""
    setup = tracks.setup
    late = late_px(setup.camera, tracked.uv, tracked.speed)
    expected = project_points(tracks.lens, tracks.xyz, world_from_camera, tracked.uv - late) + late
    misplaced = lengths(expected - tracked.uv) > INLIER * setup.noise_px.width
    lost = tracked.status != TrackStatus.ALIVE
    return np.where((misplaced | lost)[:, None], expected, tracked.uv)


def _origins_from_camera(origins: tuple[Pose, ...], pose: Pose) -> tuple[Array, Array]:
    """Returns origin_from_camera (K, 3, 3), (K, 3) for poses world_from_camera."""
    back = np.stack([p.rotation.T for p in origins])
    ways = back @ (pose.translation - np.stack([p.translation for p in origins]))[:, :, None]
    return back @ pose.rotation, ways[..., 0]


def _align_by_image(
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


def align_patches(
    lens: Lens,
    keyframe: Keyframe,
    seen: Array,
    keyframe_from_camera: Pose,
    near: Array,
    image: Image,
    expected: Array,
    reduction: float = 1.0,
) -> tuple[Array, NDArray[np.bool_]]:
    """Aligns patches of a keyframe at `seen` (N, 2) [px] with an image, around `expected` (N, 2) [px].

    `near` (N, 3) are their points in the image's camera, `reduction` is the image's size relative to the camera's.
    Returns the positions (N, 2) [px], and which (N,) match.
    """
    turn, way = keyframe_from_camera.rotation[None], keyframe_from_camera.translation[None]
    warps, bends = warps_of(lens.camera, turn, way, near, slopes(near))
    warps, bends = keyframe.reduction / reduction * warps, bends / reduction
    start = (expected + 0.5) * reduction - 0.5
    found, score = align(
        keyframe.images[0], keyframe.reduced(seen), image, start, warps, bends=bends, taper_px=TAPER_PX
    )
    found = (found + 0.5) / reduction - 0.5
    return found, (score > MIN_CORRELATION) & (np.linalg.norm(found - expected, axis=1) < MAX_SHIFT_PX)


def slopes(xyz: Array) -> Array:
    """Returns the gradient (N, 2) of the inverse depth over the normalised image at each of points (N, 3) in the
    camera; 0 for points not in front of it."""
    return _slopes(np.ascontiguousarray(xyz))


@kernel()
def _slopes(xyz):
    n, out = len(xyz), np.zeros((len(xyz), 2))
    places, near, weights = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    for i in range(n):
        places[i, 2] = 1 / xyz[i, 2] if xyz[i, 2] > MIN_DEPTH else 0.0
        places[i, 0], places[i, 1] = xyz[i, 0] * places[i, 2], xyz[i, 1] * places[i, 2]
    for i in range(n):
        inverse, count = places[i, 2], 0
        if inverse == 0.0:
            continue
        scale = 1 / (SAME_SURFACE * inverse)
        for j in range(n):
            dx, dy = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
            far = (dx * dx + dy * dy) / (REACH * REACH)
            if far < 1.0 and j != i and places[j, 2] > 0.0:
                near[count, 0], near[count, 1], near[count, 2] = dx, dy, places[j, 2] - inverse
                weights[count] = (1.0 - far) * (1.0 - far)
                count += 1
        a, b, held = 0.0, 0.0, REGULARISATION * REACH * REACH
        for _ in range(STEPS):
            xx, xy_, yy, p, q = held, 0.0, held, 0.0, 0.0
            for k in range(count):
                dx, dy, off = near[k, 0], near[k, 1], near[k, 2]
                left = (off - a * dx - b * dy) * scale
                w = weights[k] / (1.0 + left * left)
                xx += w * dx * dx
                xy_ += w * dx * dy
                yy += w * dy * dy
                p += w * dx * off
                q += w * dy * off
            det = xx * yy - xy_ * xy_
            a, b = (yy * p - xy_ * q) / det, (xx * q - xy_ * p) / det
        out[i, 0], out[i, 1] = a, b
    return out
