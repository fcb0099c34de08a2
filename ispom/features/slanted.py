"""Matches patches of the left image in the right one, with the slant of their surface, to the sub-pixel.

The disparity of a plane changes linearly over the image: on a road or along a wall by a third of a pixel per pixel. If
a patch is compared as if it faced the cameras, its position is biased by the distribution of its gradients: by 0.4 px
instead of 0.06 in a simulated corridor. So position and slant are estimated together, by inverse compositional
alignment (Baker & Matthews 2004), with a brightness offset.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.features.patches import AREA, HALF, NONE, RADIUS_PX, SIDE, WIDE
from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part, read_only
from ispom.types import Camera, Image

MAX_SLANT = 0.7
"""Largest slant: the right patch is then a third as wide as the left one. The slant of a floor is the baseline over the
cameras' height."""
SLANT_INFORMATION = 100.0
"""Information of the prior of zero slant: a slant without texture gets a standard deviation of 0.3 at errors of 3 grey
levels."""
CONVERGED_STEP = 4e-5
"""Squared step [px^2] at the patch's edge that ends the iterations."""
ONE = np.float32(1)
ROOM, MAX_COLUMNS = SIDE * SIDE, 32
"""Number of pixels of a patch, and of columns that the widest right patch with the largest slant needs, with
reserve."""
MIN_AREA = 0.05
"""Least area of a warped patch, relative to the original; with less, or mirrored, it cannot be compared."""


class Slanted(NamedTuple):
    """Matches of patches of the left image in the right one."""

    uv: Array
    """(N, 2) [px]."""
    slants: Array
    """(N, 2) relative increase of the right patch's width [px/px], and its shift to the right per row [px/px]."""
    correlation: Array
    """(N,) correlation of both patches, -1..1; -1 where one reaches out of an image, has no texture, or is too
    steep."""
    deviations: Array
    """(N,) standard deviation of u [px] by least squares (Foerstner & Guelch 1987), from the difference of the patches
    and their gradients; inf where the correlation is -1."""
    differences: Array
    """(N,) root mean square difference of the patches [grey levels] at their best contrast, corrected for the smoothing
    by interpolation; inf where the correlation is -1."""


def align_slanted(
    left: Image, uv: NDArray[np.float32], right: Image, start: NDArray[np.float32], iterations: int = 8
) -> Slanted:
    """Matches the patches of `left` at (N, 2) [px] in `right`; the search starts at `start` (N, 2), and converges over
    about 2 px."""
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
    """Returns warps (N, 2, 2), pixels of the left image per pixel of another one, their bends (N, 2) (see
    patches.align), and a mask (N,) of the points for which they are known.

    The points are at normalised `xy` (N, 2) and `depth` (N,) in a left image, on surfaces with these slants.
    """
    # The slope of the inverse depth is that of the disparity, which grows to the left where the right patch is
    # narrower.
    slope = -slants * (1.0, camera.fy / camera.fx) / baseline
    rotation, way, inverse = image_from_left.rotation, image_from_left.translation, 1 / np.maximum(depth, 1e-6)
    q = xy @ rotation[:, :2].T + rotation[:, 2] + inverse[:, None] * way
    by_xy = rotation[None, :, :2] + way[None, :, None] * slope[:, None, :]
    iz = 1 / np.maximum(q[:, 2], 1e-6)
    a = (by_xy[:, 0] - (q[:, 0] * iz)[:, None] * by_xy[:, 2]) * iz[:, None]
    b = (by_xy[:, 1] - (q[:, 1] * iz)[:, None] * by_xy[:, 2]) * iz[:, None]
    area, ratio = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], camera.fx / camera.fy
    known = (area > MIN_AREA) & (q[:, 2] > 0)
    out = np.stack([b[:, 1], -a[:, 1] * ratio, -b[:, 0] / ratio, a[:, 0]], axis=1)
    warps = (out / np.where(known, area, 1.0)[:, None]).reshape(-1, 2, 2)
    farther = by_xy[:, 2] * iz[:, None] / (camera.fx, camera.fy)
    return warps, -(farther[:, None] @ warps)[:, 0], known


@kernel(fastmath={"contract", "reassoc"})
def _align(left, left_uv, right, uv, iterations):
    n, reach, columns = len(uv), RADIUS_PX + 1, np.int32(right.shape[1])
    slants, score, deviations, differences = np.zeros((n, 2)), np.full(n, -1.0), np.full(n, np.inf), np.full(n, np.inf)
    wide, places = np.empty(WIDE * WIDE, np.float32), np.empty(ROOM, np.int32)
    # x and y; the patch and its derivatives by u, v and both slants; space for the right patch.
    room, blended = np.empty((10, ROOM), np.float32), np.empty((SIDE, MAX_COLUMNS), np.float32)
    for i in range(ROOM):
        room[0, i], room[1, i] = i % SIDE - RADIUS_PX, i // SIDE - RADIUS_PX
    origin, pixels = left.reshape(left.size), right.reshape(right.size)
    if right.shape[1] < MAX_COLUMNS:
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
            first = min(max(int(u - far), 0), right.shape[1] - MAX_COLUMNS)
            _blend(pixels, columns, first, y - RADIUS_PX, np.float32(v - y), blended)
            _sample(u - first, width, shear, blended, places, room)
            differing, score[k], noise, pull = _compare(mean, power, room)
            differences[k] = np.sqrt(2.0 * differing / (smoothed + noise * _left_of_noise(v - y)))
            du, dv, wider, sheared = _solve(
                factor,
                pull[0],
                pull[1],
                pull[2] + SLANT_INFORMATION * (width - 1.0),
                pull[3] + SLANT_INFORMATION * shear,
            )
            edge = du * du + dv * dv + RADIUS_PX * RADIUS_PX * (wider * wider + sheared * sheared)
            if i == iterations or edge < CONVERGED_STEP:
                break
            # The step is that of the left patch; its inverse is applied to the right one.
            width /= 1.0 + min(max(wider, -0.5), 0.5)
            u, v, shear = u - width * (du - sheared * dv) - shear * dv, v - dv, shear - width * sheared
            if not (abs(width - 1.0) < MAX_SLANT and abs(shear) < MAX_SLANT):
                score[k] = -1.0
                break
        uv[k, 0], uv[k, 1], slants[k, 0], slants[k, 1] = u, v, width - 1.0, shear
        if score[k] == -1.0:
            differences[k] = np.inf
        deviations[k] = differences[k] * np.sqrt(variance)
    return uv, slants, score, deviations, differences


@part
def _copy(pixels, columns, x, y, a, b, wide):
    """Copies the patch with its border (WIDE^2) whose first pixel is at x + a, y + b."""
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
    """Fills the patch and its derivatives, each without its mean; returns the patch's mean and power, and the second
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
    """Fills rows interpolated between those of the right image, from x on; returns the range of their valid columns."""
    for j in range(SIDE):
        row = (y + j) * columns + x
        into = blended[j]
        for i in range(MAX_COLUMNS):
            p = np.uintp(row + i)
            upper = np.float32(pixels[p])
            into[i] = upper + down * (np.float32(pixels[p + np.uintp(columns)]) - upper)


@part
def _sample(first, width, shear, blended, places, room):
    """Computes the position of each pixel of the patch in these rows, and the values on both sides of it."""
    begin, wide, steep = np.float32(first), np.float32(width), np.float32(shear)
    for i in range(ROOM):
        along = begin + wide * room[0, i] + steep * room[1, i]
        whole = np.floor(along)
        room[7, i], places[i] = along - whole, np.int32(room[1, i] + RADIUS_PX) * MAX_COLUMNS + np.int32(whole)
    rows = blended.reshape(SIDE * MAX_COLUMNS)
    for i in range(ROOM):  # a loop of its own, as only this one cannot be vectorised
        at = np.uintp(places[i])
        room[8, i], room[9, i] = rows[at], rows[at + np.uintp(1)]


@part
def _compare(mean, power, room):
    """Returns the mean squared difference of both patches at their best contrast, their correlation, the share of the
    right patch's noise that interpolation along rows leaves, and the gradient of the squared differences (4)."""
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
    """Returns the share of the noise's variance that remains after interpolation between two pixels."""
    return share * share + (1.0 - share) * (1.0 - share)


@part
def _factor(h):
    """Returns the Cholesky factor (10), by rows, of the second derivatives, with the prior of the slants."""
    h00, h01, h02, h03, h11, h12, h13, h22, h23, h33 = h
    a = np.sqrt(np.float64(h00))
    b, d, g = h01 / a, h02 / a, h03 / a
    c = np.sqrt(h11 - b * b)
    e, i = (h12 - d * b) / c, (h13 - g * b) / c
    f = np.sqrt(h22 + SLANT_INFORMATION - d * d - e * e)
    j = (h23 - g * d - i * e) / f
    return a, b, c, d, e, f, g, i, j, np.sqrt(h33 + SLANT_INFORMATION - g * g - i * i - j * j)


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
