"""Aligns patches with sub-pixel accuracy to the image that observed them first, so that tracks do not drift.

Inverse compositional alignment (Baker & Matthews 2004) of a position and a brightness offset. The patch is first warped
by the geometry of the scene, as in Forster et al. 2014, section IV-B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.kernels import kernel, part, read_only
from ispom.types import Camera, Image, TrackStatus

RADIUS_PX = 5
"""Half the side of a patch: 11 x 11 pixels."""
SIDE, ROW, WIDE = 2 * RADIUS_PX + 1, 2 * RADIUS_PX + 2, 2 * RADIUS_PX + 3
"""Number of pixels along a patch's side; of its rows in memory, whose last pixel has no weight, so that a patch is
processed by vector instructions from end to end; and of its side with a border for the gradient."""
AREA, HALF, NONE, ONE = np.float32(SIDE * SIDE), np.float32(0.5), np.float32(0), np.float32(1)
"""Area of a patch [px], and constants in single precision, in which grey values and their sums are computed: vector
instructions process twice as many."""

MIN_PERSPECTIVE = 0.2
"""Least depth of a patch's pixels, relative to that of its middle; a patch with less is seen edge on."""


@dataclass(frozen=True)
class PatchTracker:
    """A Tracker that aligns patches on an image pyramid. It tolerates changes of brightness, but not rotations."""

    levels: int = 3
    """Number of halvings of the image. Alignment converges over two pixels of the smallest one."""
    min_correlation: float = 0.8
    """Least normalised correlation of a patch with the image at the found position."""

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """See interfaces.Tracker."""
        found = np.array(uv if predicted is None else predicted, float)
        if not len(uv):
            return found.astype(np.float32), np.zeros(0, np.uint8)
        height, width = end.shape
        last = np.array([width, height]) - 1 - RADIUS_PX
        pyramids = [(start, end)]
        for _ in range(self.levels):
            larger, other = pyramids[-1]
            pyramids.append((np.asarray(cv2.pyrDown(larger), np.uint8), np.asarray(cv2.pyrDown(other), np.uint8)))
        warps, score = np.broadcast_to(np.eye(2), (len(uv), 2, 2)).copy(), np.full(len(uv), -1.0)
        for level in range(self.levels, -1, -1):
            before, now = pyramids[level]
            at, score = align(before, np.asarray(uv, float) / 2**level, now, found / 2**level, warps)
            found = np.where((score > 0)[:, None], 2**level * at, found)
        status = np.where(score > self.min_correlation, TrackStatus.ALIVE, TrackStatus.LOST).astype(np.uint8)
        status[~((found >= RADIUS_PX) & (found <= last)).all(axis=1)] = TrackStatus.OUT_OF_IMAGE
        return found.astype(np.float32), status


def align(
    reference: Image,
    reference_uv: Array,
    image: Image,
    uv: Array,
    warps: Array,
    iterations: int = 8,
    bends: Array | None = None,
    taper_px: float = np.inf,
) -> tuple[Array, Array]:
    """Returns the positions (N, 2) [px] in `image` of the patches of `reference` at (N, 2), and their correlations
    (N,).

    The search starts at `uv` (N, 2). `warps` (N, 2, 2): reference pixels per image pixel around each point. With
    `bends` (N, 2) the warp is that of a plane in perspective: an offset of d image pixels is warps d / (1 + bends d)
    reference pixels. The weights of pixels are a normal distribution around the middle with standard deviation
    `taper_px`, equal for inf. Correlations are -1..1, and -1 where a patch reaches out of an image, or has no texture.
    """
    return _align(
        read_only(reference),
        read_only(np.asarray(reference_uv, np.float64)),
        read_only(image),
        np.array(uv, np.float64),
        read_only(warps),
        read_only(np.zeros((len(warps), 2)) if bends is None else bends),
        iterations,
        *_counts(float(taper_px)),
    )


@cache
def _counts(taper_px: float) -> tuple[Array, np.float32]:
    """Returns the weights (SIDE ROW,) of a patch's pixels, row by row, 0 in the last column; and their sum."""
    along = np.arange(-RADIUS_PX, RADIUS_PX + 1)
    counts = np.zeros((SIDE, ROW), np.float32)
    counts[:, :SIDE] = np.exp(-0.5 * (along[:, None] ** 2 + along**2) / taper_px**2)
    return read_only(counts.ravel()), np.float32(counts.sum())


def warps_of(
    camera: Camera, rotations: Array, translations: Array, xyz_in_camera: Array, slopes: Array | None = None
) -> tuple[Array, Array]:
    """Returns the warps (N, 2, 2), reference pixels per image pixel, at points (N, 3), and their bends (N, 2), see
    `align`.

    `slopes` (N, 2) are the derivatives of the surfaces' inverse depth by the normalised image coordinates; by default
    surfaces face the camera. Distortion is ignored. `rotations` (N, 3, 3) and `translations` (N, 3) are
    reference_from_camera of each point, or (1, ...) of all points.
    """
    r, ratio, inverse = rotations, camera.fx / camera.fy, 1 / np.maximum(xyz_in_camera[:, 2], 1e-6)
    xy = xyz_in_camera[:, :2] * inverse[:, None]
    q = r[:, :, 2] + (r[:, :, :2] @ xy[:, :, None])[..., 0] + inverse[:, None] * translations
    by_xy = np.broadcast_to(r[:, :, :2], (len(q), 3, 2))
    if slopes is not None:
        by_xy = by_xy + translations[:, :, None] * slopes[:, None, :]
    iz = 1 / np.maximum(q[:, 2], 1e-6)
    farther = by_xy[:, 2] * iz[:, None]
    out = by_xy[:, :2] * iz[:, None, None] - (q[:, :2] * iz[:, None])[:, :, None] * farther[:, None, :]
    out[:, 0, 1] *= ratio
    out[:, 1, 0] /= ratio
    return out, farther / (camera.fx, camera.fy)


@part
def _reaches_out(k, uv, warps, bends, shape):
    """Checks whether patch k, with the border for its gradient, reaches out of the reference image."""
    reach = RADIUS_PX + 1
    for cy in (-reach, reach):
        for cx in (-reach, reach):
            far = 1.0 + bends[k, 0] * cx + bends[k, 1] * cy
            if far < MIN_PERSPECTIVE:
                return True
            u = uv[k, 0] + (warps[k, 0, 0] * cx + warps[k, 0, 1] * cy) / far
            v = uv[k, 1] + (warps[k, 1, 0] * cx + warps[k, 1, 1] * cy) / far
            if not (0 <= u < shape[1] - 1 and 0 <= v < shape[0] - 1):
                return True
    return False


@part
def _warp(k, pixels, columns, uv, warps, bends, places, room, out):
    """Fills the patch k of the reference with its border (WIDE^2); row after row, as the `pixels` of the image are."""
    across, down, a, b = room[0], room[1], room[2], room[3]
    middle = np.int32(uv[k, 0]), np.int32(uv[k, 1])  # single precision is enough for offsets from it
    px, py = np.float32(uv[k, 0] - middle[0]), np.float32(uv[k, 1] - middle[1])
    xx, xy, yx, yy = (
        np.float32(warps[k, 0, 0]),
        np.float32(warps[k, 0, 1]),
        np.float32(warps[k, 1, 0]),
        np.float32(warps[k, 1, 1]),
    )
    bx, by = np.float32(bends[k, 0]), np.float32(bends[k, 1])
    origin = middle[1] * columns + middle[0]
    for i in range(len(out)):
        near = ONE / (ONE + bx * across[i] + by * down[i])
        u, v = px + near * (xx * across[i] + xy * down[i]), py + near * (yx * across[i] + yy * down[i])
        x, y = np.floor(u), np.floor(v)
        a[i], b[i], places[i] = u - x, v - y, origin + np.int32(y) * columns + np.int32(x)
    for i in range(len(out)):  # a loop of its own, as only this one cannot be vectorised
        at = np.uintp(places[i])
        below = at + np.uintp(columns)
        room[4, i], room[5, i] = pixels[at], pixels[at + np.uintp(1)]
        room[6, i], room[7, i] = pixels[below], pixels[below + np.uintp(1)]
    for i in range(len(out)):
        upper = room[4, i] + a[i] * (room[5, i] - room[4, i])
        lower = room[6, i] + a[i] * (room[7, i] - room[6, i])
        out[i] = upper + b[i] * (lower - upper)


@part
def _derive(wide, patch, gx, gy):
    """Fills a patch and its gradient from the patch with a border."""
    for i in range(SIDE):
        for j in range(SIDE):
            at, to = (i + 1) * WIDE + j + 1, i * ROW + j
            patch[to] = wide[at]
            gx[to] = HALF * (wide[at + 1] - wide[at - 1])
            gy[to] = HALF * (wide[at + WIDE] - wide[at - WIDE])


@part
def _copy(pixels, columns, x, y, out):
    """Copies the ROW x ROW pixels from column x and row y on."""
    for i in range(ROW):
        at = np.uintp((y + i) * columns + x)
        for j in range(ROW):
            out[i * ROW + j] = pixels[at + np.uintp(j)]


@kernel(fastmath={"contract", "reassoc"})
def _align(reference, reference_uv, image, uv, warps, bends, iterations, counts, area):
    n, last = len(uv), RADIUS_PX + 1
    score = np.full(n, -1.0)
    places, room, wide, now = (
        np.empty(WIDE * WIDE, np.int32),
        np.empty((8, WIDE * WIDE), np.float32),
        np.empty(WIDE * WIDE, np.float32),
        np.zeros(ROW * ROW + 1, np.float32),
    )
    for i in range(WIDE * WIDE):
        room[0, i], room[1, i] = i % WIDE - last, i // WIDE - last
    patch, gx, gy = np.zeros((3, SIDE * ROW), np.float32)
    origin, pixels = reference.reshape(reference.size), image.reshape(image.size)
    for k in range(n):
        if _reaches_out(k, reference_uv, warps, bends, reference.shape):
            continue
        _warp(k, origin, np.int32(reference.shape[1]), reference_uv, warps, bends, places, room, wide)
        _derive(wide, patch, gx, gy)
        mean, mx, my = NONE, NONE, NONE
        for i in range(len(patch)):
            mean += counts[i] * patch[i]
            mx += counts[i] * gx[i]
            my += counts[i] * gy[i]
        mean, mx, my = mean / area, mx / area, my / area
        hxx, hxy, hyy, power, px, py = NONE, NONE, NONE, NONE, NONE, NONE
        for i in range(len(patch)):
            # Subtracting the means removes the brightness offset.
            value, x, y = patch[i] - mean, gx[i] - mx, gy[i] - my
            patch[i], gx[i], gy[i] = counts[i] * value, counts[i] * x, counts[i] * y
            hxx += gx[i] * x
            hxy += gx[i] * y
            hyy += gy[i] * y
            power += patch[i] * value
            px += gx[i] * value
            py += gy[i] * value
        det = hxx * hyy - hxy * hxy
        if det < 1e-3 * (hxx + hyy) * (hxx + hyy) or power < area:
            continue
        u, v = uv[k, 0], uv[k, 1]
        for _ in range(iterations + 1):
            if not (RADIUS_PX <= u < image.shape[1] - last and RADIUS_PX <= v < image.shape[0] - last):
                score[k] = -1.0
                break
            left, top = int(u), int(v)
            a, b = u - left, v - top
            w00, w01, w10, w11 = (
                np.float32((1 - a) * (1 - b)),
                np.float32(a * (1 - b)),
                np.float32((1 - a) * b),
                np.float32(a * b),
            )
            _copy(pixels, image.shape[1], left - RADIUS_PX, top - RADIUS_PX, now)
            bx, by, total, squares, product = -px, -py, NONE, NONE, NONE
            for i in range(len(patch)):
                value = w00 * now[i] + w01 * now[i + 1] + w10 * now[i + ROW] + w11 * now[i + ROW + 1]
                value -= mean
                total += counts[i] * value
                squares += counts[i] * value * value
                product += value * patch[i]
                bx += gx[i] * value
                by += gy[i] * value
            variance = squares - total * total / area
            score[k] = product / np.sqrt(power * variance) if variance > 1e-6 else -1.0
            du, dv = (hyy * bx - hxy * by) / det, (hxx * by - hxy * bx) / det
            if du * du + dv * dv < 1e-6:
                break
            u, v = u - du, v - dv
        uv[k, 0], uv[k, 1] = u, v
    return uv, score
