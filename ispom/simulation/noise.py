"""Band-limited noise and patterns, evaluated per pixel: nothing repeats and no texture is stored.

Every function takes the widths of the pixel's footprint on the surface and answers with the mean over it (a box filter), so that
nothing finer than a pixel is left to alias: aliasing would look like motion of its own.
"""

from __future__ import annotations

import math

from numba import njit

FAST = {"cache": True, "nogil": True, "inline": "never"}


@njit(**FAST)
def hash01(i: int, j: int, seed: int) -> float:
    """A number in [0, 1) that depends on nothing but the three integers."""
    h = (i * 73856093) ^ (j * 19349663) ^ (seed * 83492791)
    h = (h ^ (h >> 15)) * 2246822519
    h = (h ^ (h >> 13)) * 3266489917
    h = h ^ (h >> 16)
    return ((h >> 8) & 0xFFFFFF) * (1.0 / 16777216.0)


@njit(**FAST)
def value_noise(x: float, y: float, seed: int) -> float:
    """Smooth noise in -1..1 with one random value per unit square."""
    xf, yf = math.floor(x), math.floor(y)
    i, j = int(xf), int(yf)
    x, y = x - xf, y - yf
    x, y = x * x * (3.0 - 2.0 * x), y * y * (3.0 - 2.0 * y)
    a, b = hash01(i, j, seed), hash01(i + 1, j, seed)
    c, d = hash01(i, j + 1, seed), hash01(i + 1, j + 1, seed)
    low, high = a + (b - a) * x, c + (d - c) * x
    return 2.0 * (low + (high - low) * y) - 1.0


@njit(**FAST)
def octaves(x: float, y: float, width: float, seed: int, coarsest: float, finest: float, gain: float) -> float:
    """Noise in about -1..1 of all scales coarsest..finest [m], without those that a footprint `width` [m] cannot carry."""
    total, norm, amplitude, scale = 0.0, 0.0, 1.0, coarsest
    while scale >= finest:
        norm += amplitude * amplitude
        fade = min(1.0, scale / (1.5 * width) - 1.0)  # all of it above 3 footprints, nothing below 1.5
        if fade > 0.0:
            total += amplitude * fade * value_noise(x / scale, y / scale, seed)
        x, y = 0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y  # octaves whose lattices do not line up
        amplitude *= gain
        scale *= 0.5
        seed += 1
    return 1.4 * total / math.sqrt(norm)


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
    """Rows of stones, each row moved by `shift` lengths: the stone's own tint -1..1, and the part that is joint 0..1."""
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
    letter = int(math.floor(x / (4.0 * cell)))
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
