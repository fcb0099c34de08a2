"""Patches of the left image found in the right one together with the slant of their surface, to a part of a pixel.

The disparity of a plane changes evenly over the image: on a road or along a wall by a third of a pixel from pixel to
pixel. A patch compared as if it faced the cameras is then off by as much as its gradients happen to lie to one side,
0.4 px instead of 0.06 in a simulated corridor. So place and slant are sought at once, by inverse compositional
alignment (Baker & Matthews 2004), free of an offset of the brightness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.features.patches import AREA, HALF, NONE, RADIUS_PX, SIDE, WIDE
from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part, read_only
from ispom.types import Camera, Image

STEEPEST = 0.7
"""Slants beyond it are none: the right patch would be a third of the left one. Of a floor it is the baseline over the
cameras' height."""
HELD = 100.0
"""Information of no slant: what texture leaves open is 0.3 at most where grey values are off by 3."""
STILL = 4e-5
"""Squared step [px^2] at the patch's edge that is the last one."""
ONE = np.float32(1)
ROOM, ACROSS = SIDE * SIDE, 32
"""Pixels of a patch; columns that the widest and steepest right patch reaches over, and some."""
FOLDED = 0.05
"""Share of its area that a patch keeps at least; of less, or turned over, nothing is known."""


class Slanted(NamedTuple):
    """Where patches of the left image are in the right one."""

    uv: Array
    """(N, 2) [px]."""
    slants: Array
    """(N, 2) how much wider than the left patch the right one is [px/px], and farther right from row to row."""
    correlation: Array
    """(N,) of both, -1..1; -1 where a patch reaches out of an image, has no texture, or is too steep."""
    deviations: Array
    """(N,) [px] how far off u is, by least squares (Foerstner & Guelch 1987): the farther, the more the patches differ,
    or the less of a gradient they have. inf where the correlation is -1."""
    differences: Array
    """(N,) [grey levels] root mean square of what differs between them at their best contrast, as it would be between
    whole pixels, which are not smoothed by interpolation; inf as well."""


def align_slanted(
    left: Image, uv: NDArray[np.float32], right: Image, start: NDArray[np.float32], iterations: int = 8
) -> Slanted:
    """The patches of `left` at (N, 2) [px] in `right`, looked for from `start` (N, 2) on, up to 2 px around."""
    return Slanted(
        *_align(
            read_only(left),
            read_only(np.asarray(uv, np.float64)),
            read_only(right),
            np.array(start, np.float64),
            iterations,
        )
    )


def slanted_warps(
    camera: Camera, image_from_left: Pose, xy: Array, depth: Array, slants: Array, baseline: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """(N, 2, 2) pixels of the left image per pixel of one from elsewhere, (N, 2) how they bend (see patches.align), and
    of which points (N,) they are known.

    Around points of a left image at normalised `xy` (N, 2) and `depth` (N,) on surfaces with these slants.
    """
    # Of the inverse depth: that of the disparity, which grows to the left where the right patch is narrower.
    slope = -slants * (1.0, camera.fy / camera.fx) / baseline
    rotation, way, inverse = image_from_left.rotation, image_from_left.translation, 1 / np.maximum(depth, 1e-6)
    q = xy @ rotation[:, :2].T + rotation[:, 2] + inverse[:, None] * way
    by_xy = rotation[None, :, :2] + way[None, :, None] * slope[:, None, :]
    iz = 1 / np.maximum(q[:, 2], 1e-6)
    a = (by_xy[:, 0] - (q[:, 0] * iz)[:, None] * by_xy[:, 2]) * iz[:, None]
    b = (by_xy[:, 1] - (q[:, 1] * iz)[:, None] * by_xy[:, 2]) * iz[:, None]
    area, ratio = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], camera.fx / camera.fy
    known = (area > FOLDED) & (q[:, 2] > 0)
    out = np.stack([b[:, 1], -a[:, 1] * ratio, -b[:, 0] / ratio, a[:, 0]], axis=1)
    warps = (out / np.where(known, area, 1.0)[:, None]).reshape(-1, 2, 2)
    farther = by_xy[:, 2] * iz[:, None] / (camera.fx, camera.fy)
    return warps, -(farther[:, None] @ warps)[:, 0], known


@kernel(fastmath={"contract", "reassoc"})
def _align(left, left_uv, right, uv, iterations):
    n, reach, columns = len(uv), RADIUS_PX + 1, np.int32(right.shape[1])
    slants, score, deviations, differences = np.zeros((n, 2)), np.full(n, -1.0), np.full(n, np.inf), np.full(n, np.inf)
    wide, places = np.empty(WIDE * WIDE, np.float32), np.empty(ROOM, np.int32)
    # Across, down; the patch and its derivatives by u, v and both slants; room for the right one.
    room, blended = np.empty((10, ROOM), np.float32), np.empty((SIDE, ACROSS), np.float32)
    for i in range(ROOM):
        room[0, i], room[1, i] = i % SIDE - RADIUS_PX, i // SIDE - RADIUS_PX
    origin, pixels = left.reshape(left.size), right.reshape(right.size)
    if right.shape[1] < ACROSS:
        return uv, slants, score, deviations, differences
    for k in range(n):
        x, y = int(left_uv[k, 0]), int(left_uv[k, 1])
        if not (reach <= x < left.shape[1] - reach - 1 and reach <= y < left.shape[0] - reach - 1):
            continue
        across, down = left_uv[k, 0] - x, left_uv[k, 1] - y
        _copy(origin, np.int32(left.shape[1]), x - reach, y - reach, across, down, wide)
        smoothed = _left_of_noise(across) * _left_of_noise(down)
        mean, power, h = _derive(wide, room)
        if h[0] * h[4] - h[1] * h[1] < 1e-3 * (h[0] + h[4]) * (h[0] + h[4]) or power < AREA:
            continue
        factor = _factor(h)
        unit = _forward(factor, 1.0, 0.0, 0.0, 0.0)
        variance = unit[0] * unit[0] + unit[1] * unit[1] + unit[2] * unit[2] + unit[3] * unit[3]
        u, v, width, shear = uv[k, 0], uv[k, 1], 1.0, 0.0
        for i in range(iterations + 1):
            score[k], far = -1.0, RADIUS_PX * (width + abs(shear)) + 1
            if not (far <= u < right.shape[1] - far - 1 and reach <= v < right.shape[0] - reach - 1):
                break
            y = int(v)
            first = min(max(int(u - far), 0), right.shape[1] - ACROSS)
            _blend(pixels, columns, first, y - RADIUS_PX, np.float32(v - y), blended)
            _sample(u - first, width, shear, blended, places, room)
            differing, score[k], noise, pull = _compare(mean, power, room)
            differences[k] = np.sqrt(2.0 * differing / (smoothed + noise * _left_of_noise(v - y)))
            du, dv, wider, sheared = _solve(
                factor, pull[0], pull[1], pull[2] + HELD * (width - 1.0), pull[3] + HELD * shear
            )
            edge = du * du + dv * dv + RADIUS_PX * RADIUS_PX * (wider * wider + sheared * sheared)
            if i == iterations or edge < STILL:
                break
            # The step is of the left patch: the right one takes it back.
            width /= 1.0 + min(max(wider, -0.5), 0.5)
            u, v, shear = u - width * (du - sheared * dv) - shear * dv, v - dv, shear - width * sheared
            if not (abs(width - 1.0) < STEEPEST and abs(shear) < STEEPEST):
                score[k] = -1.0
                break
        uv[k, 0], uv[k, 1], slants[k, 0], slants[k, 1] = u, v, width - 1.0, shear
        if score[k] == -1.0:
            differences[k] = np.inf
        deviations[k] = differences[k] * np.sqrt(variance)
    return uv, slants, score, deviations, differences


@part
def _copy(pixels, columns, x, y, a, b, wide):
    """The patch with its border (WIDE^2) whose first pixel is at x + a, y + b."""
    w00, w01 = np.float32((1 - a) * (1 - b)), np.float32(a * (1 - b))
    w10, w11 = np.float32((1 - a) * b), np.float32(a * b)
    for i in range(WIDE):
        for j in range(WIDE):
            p = np.uintp((y + i) * columns + x + j)
            q = p + np.uintp(columns)
            upper = w00 * pixels[p] + w01 * pixels[p + np.uintp(1)]
            wide[i * WIDE + j] = upper + w10 * pixels[q] + w11 * pixels[q + np.uintp(1)]


@part
def _derive(wide, room):
    """Fills the patch and its derivatives, each without its mean; that of the patch, its power, and the second
    derivatives of the squared differences (10)."""
    mean, mx, my, mw, ms = NONE, NONE, NONE, NONE, NONE
    for i in range(SIDE):
        for j in range(SIDE):
            at, to = (i + 1) * WIDE + j + 1, i * SIDE + j
            room[2, to] = wide[at]
            room[3, to] = HALF * (wide[at + 1] - wide[at - 1])
            room[4, to] = HALF * (wide[at + WIDE] - wide[at - WIDE])
    for i in range(ROOM):
        room[5, i], room[6, i] = room[3, i] * room[0, i], room[3, i] * room[1, i]
        mean += room[2, i]
        mx += room[3, i]
        my += room[4, i]
        mw += room[5, i]
        ms += room[6, i]
    mean, mx, my, mw, ms = mean / AREA, mx / AREA, my / AREA, mw / AREA, ms / AREA
    power, h00, h01, h02, h03, h11, h12, h13, h22, h23, h33 = (
        NONE, NONE, NONE, NONE, NONE, NONE, NONE, NONE, NONE, NONE, NONE,
    )  # fmt: skip
    for i in range(ROOM):
        p, a, b, c, d = room[2, i] - mean, room[3, i] - mx, room[4, i] - my, room[5, i] - mw, room[6, i] - ms
        room[2, i], room[3, i], room[4, i], room[5, i], room[6, i] = p, a, b, c, d
        power += p * p
        h00 += a * a
        h01 += a * b
        h02 += a * c
        h03 += a * d
        h11 += b * b
        h12 += b * c
        h13 += b * d
        h22 += c * c
        h23 += c * d
        h33 += d * d
    return mean, power, (h00, h01, h02, h03, h11, h12, h13, h22, h23, h33)


@part
def _blend(pixels, columns, x, y, down, blended):
    """Fills the rows between those of the right image, from x on; columns of them that are there."""
    for j in range(SIDE):
        row = (y + j) * columns + x
        into = blended[j]
        for i in range(ACROSS):
            p = np.uintp(row + i)
            upper = np.float32(pixels[p])
            into[i] = upper + down * (np.float32(pixels[p + np.uintp(columns)]) - upper)


@part
def _sample(first, width, shear, blended, places, room):
    """Where in these rows each pixel of the patch is, and what is on both sides of it."""
    begin, wide, steep = np.float32(first), np.float32(width), np.float32(shear)
    for i in range(ROOM):
        along = begin + wide * room[0, i] + steep * room[1, i]
        whole = np.floor(along)
        room[7, i], places[i] = along - whole, np.int32(room[1, i] + RADIUS_PX) * ACROSS + np.int32(whole)
    rows = blended.reshape(SIDE * ACROSS)
    for i in range(ROOM):  # by itself: only this cannot go many at a time
        at = np.uintp(places[i])
        room[8, i], room[9, i] = rows[at], rows[at + np.uintp(1)]


@part
def _compare(mean, power, room):
    """Mean squared difference that is left of both patches at their best contrast, their correlation, the share of its
    noise that is left of the right one along rows, and the slope of the squared differences (4)."""
    total, squares, product, noise, b0, b1, b2, b3 = NONE, NONE, NONE, NONE, NONE, NONE, NONE, NONE
    for i in range(ROOM):
        value = room[8, i] + room[7, i] * (room[9, i] - room[8, i]) - mean
        noise += room[7, i] * (room[7, i] - ONE)
        total += value
        squares += value * value
        product += value * room[2, i]
        b0 += room[3, i] * (value - room[2, i])
        b1 += room[4, i] * (value - room[2, i])
        b2 += room[5, i] * (value - room[2, i])
        b3 += room[6, i] * (value - room[2, i])
    variance = squares - total * total / AREA
    alike = product / np.sqrt(power * variance) if variance > 1e-6 else np.float32(-1)
    return max(1.0 - alike * alike, 0.0) * power / AREA, alike, 1.0 + 2.0 * noise / AREA, (b0, b1, b2, b3)


@part
def _left_of_noise(share):
    """Share of the variance that is left between two pixels."""
    return share * share + (1.0 - share) * (1.0 - share)


@part
def _factor(h):
    """Cholesky factor (10) by rows of the second derivatives, with what holds the slants."""
    h00, h01, h02, h03, h11, h12, h13, h22, h23, h33 = h
    a = np.sqrt(np.float64(h00))
    b, d, g = h01 / a, h02 / a, h03 / a
    c = np.sqrt(h11 - b * b)
    e, i = (h12 - d * b) / c, (h13 - g * b) / c
    f = np.sqrt(h22 + HELD - d * d - e * e)
    j = (h23 - g * d - i * e) / f
    return a, b, c, d, e, f, g, i, j, np.sqrt(h33 + HELD - g * g - i * i - j * j)


@part
def _forward(factor, p, q, r, s):
    a, b, c, d, e, f, g, i, j, k = factor
    p /= a
    q = (q - b * p) / c
    r = (r - d * p - e * q) / f
    return p, q, r, (s - g * p - i * q - j * r) / k


@part
def _solve(factor, p, q, r, s):
    a, b, c, d, e, f, g, i, j, k = factor
    p, q, r, s = _forward(factor, p, q, r, s)
    s /= k
    r = (r - j * s) / f
    q = (q - e * r - i * s) / c
    return (p - b * q - d * r - g * s) / a, q, r, s
