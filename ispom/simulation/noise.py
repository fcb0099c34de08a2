"""Band-limited noise and patterns, evaluated per pixel: nothing repeats, and no face needs a texture of its own.

Every function takes the widths of the pixel's footprint on the surface and answers with the mean over it, so that
nothing finer than a pixel is left to alias: aliasing would look like motion of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

_SIZE, _TEXEL_M = 2048, 0.005
_LEVELS = 10
"""Mip levels of the grain: 2048 .. 4 texels wide."""
FAST = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit("float64(int64, int64, int64)", **FAST)  # else one more compilation for every constant passed
def hash01(i: int, j: int, seed: int) -> float:
    """A number in [0, 1) that depends on nothing but the three integers."""
    h = (i * 73856093) ^ (j * 19349663) ^ (seed * 83492791)
    h = (h ^ (h >> 15)) * 2246822519
    h = (h ^ (h >> 13)) * 3266489917
    h = h ^ (h >> 16)
    return ((h >> 8) & 0xFFFFFF) * (1.0 / 16777216.0)


@dataclass(frozen=True, eq=False)
class Grain:
    """A square of noise of all scales in two channels, with its mip levels; two turned copies cover the plane."""

    texels: NDArray[np.float32]
    """(N, 2) the levels one after the other, finest first, row by row: fine grain, and stain (nothing below 0.1 m)."""

    @staticmethod
    @cache
    def make() -> Grain:
        """Built once per process, always the same."""
        rng = np.random.default_rng(2013)
        fine, stain = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.float32)
        while len(fine) < _SIZE:
            fine = 0.72 * _doubled(fine) + rng.standard_normal((2 * len(fine),) * 2, dtype=np.float32)
            stain = _doubled(stain)
            if len(stain) <= _SIZE // 16:
                stain += rng.standard_normal(stain.shape, dtype=np.float32)
        level = np.stack([fine / np.std(fine), stain / np.std(stain)], axis=-1)
        level -= level.mean(axis=(0, 1))
        levels = [level]
        while len(level) > 4:
            padded = np.pad(level, ((4, 4), (4, 4), (0, 0)), mode="wrap")
            level = cv2.pyrDown(padded)[2:-2, 2:-2]
            levels.append(level)
        return Grain(np.concatenate([a.reshape(-1, 2) for a in levels]))


def _doubled(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, n) smoothly enlarged to (2n, 2n), wrapping around."""
    padded = np.pad(values, 2, mode="wrap")
    return np.asarray(cv2.resize(padded, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.float32)[4:-4, 4:-4]


@njit(**FAST)
def _look_up(texels, x, y, level):
    """Both channels, bilinear within a mip level, at (x, y) [texels of the finest level]."""
    size = _SIZE >> level
    start = (_SIZE * _SIZE - size * size) // 3 * 4
    factor = 1.0 / (1 << level)
    x, y = x * factor, y * factor
    xf, yf = math.floor(x), math.floor(y)
    fx, fy = np.float32(x - xf), np.float32(y - yf)
    i, j = int(xf) & (size - 1), int(yf) & (size - 1)
    i1, j1 = (i + 1) & (size - 1), (j + 1) & (size - 1)
    a, b, c, d = start + j * size + i, start + j * size + i1, start + j1 * size + i, start + j1 * size + i1
    p, q = texels[a, 0], texels[c, 0]
    p, q = p + (texels[b, 0] - p) * fx, q + (texels[d, 0] - q) * fx
    r, s = texels[a, 1], texels[c, 1]
    r, s = r + (texels[b, 1] - r) * fx, s + (texels[d, 1] - s) * fx
    return p + (q - p) * fy, r + (s - r) * fy


@njit(**FAST)
def grain(texels, x, y, width, seed):
    """Noise of deviation about 1 at (x, y) [m], filtered to a footprint `width` [m]: fine grain, and stain."""
    x, y = x / _TEXEL_M + (seed & 0xFFFF), y / _TEXEL_M + ((seed >> 8) & 0xFFFF)
    lod = math.log2(max(width / _TEXEL_M, 1.0))
    fine, stain = 0.0, 0.0
    for copy in range(2):  # the second one turned and larger, so that the sum does not repeat
        if copy:
            x, y, lod = 0.2476 * x - 0.1866 * y + 977.0, 0.1866 * x + 0.2476 * y + 313.0, max(0.0, lod - 1.6897)
        level = min(int(lod), _LEVELS - 2)
        part = min(1.0, lod - level)
        f0, s0 = _look_up(texels, x, y, level)
        if part > 0.0:
            f1, s1 = _look_up(texels, x, y, level + 1)
            f0, s0 = f0 + (f1 - f0) * part, s0 + (s1 - s0) * part
        weight = 0.6 if copy else 0.8
        fine, stain = fine + weight * f0, stain + weight * s0
    return fine, stain


@njit(**FAST)
def span(x: float, width: float, low: float, high: float) -> float:
    """How much of x +- width/2 lies in low..high, 0..1."""
    return max(0.0, min(x + 0.5 * width, high) - max(x - 0.5 * width, low)) / width


@njit(**FAST)
def rectangle(x: float, y: float, wx: float, wy: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """How much of the footprint lies in a rectangle, 0..1."""
    return span(x, wx, x0, x1) * span(y, wy, y0, y1)


@njit(**FAST)
def disc(x: float, y: float, width: float, cx: float, cy: float, radius: float) -> float:
    """How much of the footprint lies in a disc, 0..1."""
    return min(1.0, max(0.0, (radius - math.hypot(x - cx, y - cy)) / width + 0.5))


@njit(**FAST)
def joints(x: float, width: float, period: float, joint: float) -> float:
    """How much of x +- width/2 lies in joints of width `joint` centred on the multiples of period."""
    low, high = (x - 0.5 * width + 0.5 * joint) / period, (x + 0.5 * width + 0.5 * joint) / period
    part = joint / period
    below_low, below_high = math.floor(low), math.floor(high)
    area_low = below_low * part + min(low - below_low, part)
    area_high = below_high * part + min(high - below_high, part)
    return (area_high - area_low) * period / width


@njit(**FAST)
def _row_tint(x: float, width: float, size: float, row: int, seed: int) -> float:
    x, width = x / size, min(1.0, width / size)
    cell = math.floor(x)
    inside = x - cell
    own = hash01(int(cell), row, seed)
    if inside < 0.5 * width:
        part = 0.5 - inside / width
        return own + (hash01(int(cell) - 1, row, seed) - own) * part
    if inside > 1.0 - 0.5 * width:
        part = 0.5 - (1.0 - inside) / width
        return own + (hash01(int(cell) + 1, row, seed) - own) * part
    return own


@njit(**FAST)
def masonry(
    x: float, y: float, wx: float, wy: float, length: float, height: float, joint: float, shift: float, seed: int
) -> tuple[float, float]:
    """Rows of stones, each moved by `shift` lengths: the stone's own tint -1..1, and the part that is joint 0..1."""
    fade = min(1.0, max(0.0, 2.0 - max(wx / length, wy / height)))
    row = math.floor(y / height)
    inside, width = y / height - row, min(1.0, wy / height)
    offset = x + (shift * row + 0.35 * hash01(int(row), 7, seed)) * length
    tint, gaps = 0.0, joints(y, wy, height, joint)
    if fade > 0.0:
        tint = _row_tint(offset, wx, length, int(row), seed)
        other, part = 0, 0.0
        if inside < 0.5 * width:
            other, part = -1, 0.5 - inside / width
        elif inside > 1.0 - 0.5 * width:
            other, part = 1, 0.5 - (1.0 - inside) / width
        if part > 0.0:
            there = x + (shift * (row + other) + 0.35 * hash01(int(row) + other, 7, seed)) * length
            tint += (_row_tint(there, wx, length, int(row) + other, seed) - tint) * part
        tint = fade * (2.0 * tint - 1.0)
    upright = joints(offset, wx, length, joint) if fade > 0.0 else joint / length
    upright = fade * upright + (1.0 - fade) * joint / length
    return tint, gaps + upright - gaps * upright


_FONT = (  # 3 x 5 capitals, rows from the top, most significant bit = top left
    0b010101111101101, 0b110101110101110, 0b011100100100011, 0b110101101101110, 0b111100110100111, 0b111100110100100,
    0b011100101101011, 0b101101111101101, 0b111010010010111, 0b001001001101010, 0b101101110101101, 0b100100100100111,
    0b101111111101101, 0b110101101101101, 0b010101101101010, 0b110101110100100, 0b010101101111011, 0b110101110101101,
    0b011100010001110, 0b111010010010010, 0b101101101101111, 0b101101101101010, 0b101101111111101, 0b101101010101101,
    0b101101010010010, 0b111001010100111,
)  # fmt: skip


@njit(**FAST)
def lettering(x: float, y: float, wx: float, wy: float, cell: float, seed: int) -> float:
    """How much of the footprint is ink of seeded capitals of height 5 cells [m] standing on y = 0, 0..1."""
    if y < -wy or y > 5.0 * cell + wy:
        return 0.0
    ink = 0.0
    letter = math.floor(x / (4.0 * cell))
    x0 = letter * 4.0 * cell
    if hash01(letter, 3, seed) < 0.14:
        return 0.0
    bits = _FONT[int(hash01(letter, 5, seed) * 26.0)]
    for row in range(5):
        high = span(y, wy, (4 - row) * cell, (5 - row) * cell)
        if high > 0.0:
            for column in range(3):
                if (bits >> (14 - 3 * row - column)) & 1:
                    ink += high * span(x, wx, x0 + column * cell, x0 + (column + 1) * cell)
    return ink
