"""Band-limited noise and patterns, evaluated for many samples at once: nothing repeats, no face needs a texture.

Every function takes the widths of the samples' footprints on the surface and returns the mean over them, so that
nothing finer than a pixel is left to alias: aliasing would look like motion. All arrays are (N,) float32.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.floating]
Cells = NDArray[np.uint32]
"""Integers modulo 2^32, so that cells left of 0 have a number too."""

_SIZE, _TEXEL_M = 2048, 0.005
_LEVELS = 10
"""Mip levels of the grain: 2048 .. 4 texels wide."""
_COLUMNS = 64
"""OpenCV accepts images of at most 32767 rows: samples are laid out this wide."""


def cells(x: Values) -> Cells:
    """Returns the whole number at or below each value."""
    return np.floor(x).astype(np.int32).view(np.uint32)


def hash01(i: Cells | int, j: Cells | int, seed: Cells) -> Values:
    """Returns numbers (N,) in [0, 1) that depend only on the three integers."""
    h = seed * np.uint32(83492791) ^ _times(i, 73856093) ^ _times(j, 19349663)
    h ^= h >> np.uint32(15)
    h *= np.uint32(2246822519)
    h ^= h >> np.uint32(13)
    h *= np.uint32(3266489917)
    h ^= h >> np.uint32(16)
    h >>= np.uint32(8)
    return h.astype(np.float32) * np.float32(1 / 16777216)


def _times(x: Cells | int, factor: int) -> Cells | np.uint32:
    return np.uint32(x * factor & 0xFFFFFFFF) if isinstance(x, int) else x * np.uint32(factor)


@cache
def grain_levels() -> tuple[Values, Values]:
    """Noise of all scales, which wraps around: fine grain, and stain (nothing below 0.1 m). Always the same.

    Each (rows, 2049) holds the mip levels below each other, finest first, each with its first column and row again.
    """
    rng = np.random.default_rng(2013)
    fine, stain = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.float32)
    while len(fine) < _SIZE:
        fine = 0.72 * _doubled(fine) + rng.standard_normal((2 * len(fine),) * 2, dtype=np.float32)
        if len(stain) < _SIZE // 16:
            stain = _doubled(stain) + rng.standard_normal((2 * len(stain),) * 2, dtype=np.float32)
    while len(stain) < _SIZE:
        stain = _doubled(stain)
    return _below_each_other(fine), _below_each_other(stain)


def _below_each_other(level: Values) -> Values:
    level = (level - level.mean()) / level.std()
    rows = []
    for _ in range(_LEVELS):
        rows.append(np.pad(level, ((0, 1), (0, 1)), mode="wrap"))
        rows[-1] = np.pad(rows[-1], ((0, 0), (0, _SIZE + 1 - rows[-1].shape[1])))
        level = np.asarray(cv2.pyrDown(np.pad(level, 4, mode="wrap")), np.float32)[2:-2, 2:-2]
    return np.concatenate(rows)


def _doubled(values: Values) -> Values:
    """(n, n) smoothly enlarged to (2n, 2n), wrapping around."""
    padded = np.pad(values, 2, mode="wrap")
    return np.asarray(cv2.resize(padded, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.float32)[4:-4, 4:-4]


def _look_up(x: Values, y: Values, level: Values, factor: Values) -> tuple[Values, Values]:
    """Both kinds, bilinear within mip level 2^-factor, at (x, y) [texels of the finest level]."""
    x, y, width = x * factor, y * factor, _SIZE * factor
    x -= np.floor(x / width) * width
    y -= np.floor(y / width) * width
    y += level + 2 * (_SIZE - width)  # the rows above are those of the finer levels
    x, y = x.reshape(-1, _COLUMNS), y.reshape(-1, _COLUMNS)
    fine, stain = (cv2.remap(a, x, y, cv2.INTER_LINEAR).ravel() for a in grain_levels())
    return fine, stain  # type: ignore[return-value]


def grain(x: Values, y: Values, width: Values, seed: Cells) -> tuple[Values, Values]:
    """Noise of deviation about 1 at (x, y) [m], filtered to a footprint `width` [m]: fine grain, and stain."""
    count, spare = len(x), -len(x) % _COLUMNS
    x = np.concatenate([x * (1 / _TEXEL_M) + (seed & np.uint32(2047)).astype(np.float32), x[:1].repeat(spare)])
    y = np.concatenate(
        [y * (1 / _TEXEL_M) + (seed >> np.uint32(8) & np.uint32(2047)).astype(np.float32), y[:1].repeat(spare)]
    )
    texels = np.concatenate([width * (1 / _TEXEL_M), width[:1].repeat(spare)])
    fine, stain = np.float32(0), np.float32(0)
    # The second copy is rotated and larger, so that the sum does not repeat.
    for weight in (0.8, 0.6):
        if weight == 0.6:
            x, y = 0.2476 * x - 0.1866 * y + 977, 0.1866 * x + 0.2476 * y + 313
            texels = 0.31 * texels
        # The number's own exponent and mantissa: the level, and the fraction to the next one.
        bits = np.clip(texels, 1, 0.999 * 2 ** (_LEVELS - 1)).view(np.int32)
        exponent = bits >> 23
        factor = ((254 - exponent) << 23).view(np.float32)
        level = (exponent - 127).astype(np.float32)
        part = (bits & 0x7FFFFF).astype(np.float32) * 2.0**-23
        fine0, stain0 = _look_up(x, y, level, factor)
        fine1, stain1 = _look_up(x, y, level + 1, 0.5 * factor)
        fine = fine + weight * (fine0 + (fine1 - fine0) * part)
        stain = stain + weight * (stain0 + (stain1 - stain0) * part)
    return fine[:count], stain[:count]  # type: ignore[return-value,index]


def span(x: Values, width: Values, low: Values | float, high: Values | float) -> Values:
    """Returns the share of x +- width/2 that lies in low..high."""
    half = 0.5 * width
    return np.maximum(np.minimum(x + half, high) - np.maximum(x - half, low), 0) / width


def rectangle(
    x: Values, y: Values, wx: Values, wy: Values, x0: Values | float, y0: Values | float, x1: Values, y1: Values
) -> Values:
    """Returns the share of the footprint that lies in a rectangle."""
    return span(x, wx, x0, x1) * span(y, wy, y0, y1)


def disc(x: Values, y: Values, width: Values, cx: Values | float, cy: Values | float, radius: Values | float) -> Values:
    """Returns the share of the footprint that lies in a disc."""
    dx, dy = x - cx, y - cy
    return np.clip((radius - np.sqrt(dx * dx + dy * dy)) / width + 0.5, 0, 1)


def joints(x: Values, width: Values, period: Values | float, joint: Values | float) -> Values:
    """Returns the share of x +- width/2 that lies in joints of width `joint` centred on the multiples of period."""
    part = joint / period
    middle, half = (x + 0.5 * joint) / period, 0.5 * width / period
    low, high = middle - half, middle + half
    below_low, below_high = np.floor(low), np.floor(high)
    area = (below_high - below_low) * part + np.minimum(high - below_high, part) - np.minimum(low - below_low, part)
    return area / (2 * half)


def _across(inside: Values, width: Values) -> tuple[Values, Values]:
    """Returns which neighbour cell the footprint reaches (-1 or 1), and its share there."""
    right = np.floor(inside + 0.5)  # 0 left of the middle, 1 right of it
    edge = np.abs(inside - right)
    return 2 * right - 1, np.maximum(0.5 - edge / width, 0)


def _row_tint(x: Values, width: Values, row: Cells, seed: Cells) -> Values:
    """Mean number of the cells of a row, x and width in cells (at most 1 wide)."""
    whole = np.floor(x)
    side, part = _across(x - whole, np.minimum(width, 1))
    cell = whole.astype(np.int32)
    own = hash01(cell.view(np.uint32), row, seed)
    other = hash01((cell + side.astype(np.int32)).view(np.uint32), row, seed)
    return own + (other - own) * part


def masonry(
    x: Values,
    y: Values,
    wx: Values,
    wy: Values,
    seed: Cells,
    length: float,
    height: float,
    joint: float,
    shift: float,
) -> tuple[Values, Values]:
    """Rows of stones, each moved by `shift` lengths: the stone's own tint -1..1, and the part that is joint 0..1."""
    fade = np.clip(2 - np.maximum(wx * (1 / length), wy * (1 / height)), 0, 1)
    tint, upright = np.zeros_like(x), np.zeros_like(x)
    seen = np.flatnonzero(fade > 0)
    if len(seen):
        u, width, seed = x[seen] * (1 / length), wx[seen] * (1 / length), seed[seen]
        v = y[seen] * (1 / height)
        row = np.floor(v)
        side, part = _across(v - row, np.minimum(wy[seen] * (1 / height), 1))
        place, whole = u + _row_shift(row, shift, seed), row.astype(np.int32).view(np.uint32)
        shade = _row_tint(place, width, whole, seed)
        both = np.flatnonzero(part > 0)
        if len(both):
            near, s = (row + side)[both], seed[both]
            number = near.astype(np.int32).view(np.uint32)
            other = _row_tint(u[both] + _row_shift(near, shift, s), width[both], number, s)
            shade[both] += (other - shade[both]) * part[both]
        tint[seen] = 2 * shade - 1
        upright[seen] = joints(place, width, 1.0, joint / length) - joint / length
    gaps = joints(y, wy, height, joint)
    upright = fade * upright + joint / length
    return fade * tint, gaps + upright - gaps * upright


def _row_shift(row: Values, shift: float, seed: Cells) -> Values:
    return shift * row + 0.35 * hash01(row.astype(np.int32).view(np.uint32), 7, seed)


_FONT = np.array([  # 3 x 5 capitals, rows from the top, most significant bit = top left
    0b010101111101101, 0b110101110101110, 0b011100100100011, 0b110101101101110, 0b111100110100111, 0b111100110100100,
    0b011100101101011, 0b101101111101101, 0b111010010010111, 0b001001001101010, 0b101101110101101, 0b100100100100111,
    0b101111111101101, 0b110101101101101, 0b010101101101010, 0b110101110100100, 0b010101101111011, 0b110101110101101,
    0b011100010001110, 0b111010010010010, 0b101101101101111, 0b101101101101010, 0b101101111111101, 0b101101010101101,
    0b101101010010010, 0b111001010100111,
])  # fmt: skip
_PIXELS = (_FONT[:, None] >> np.arange(14, -1, -1) & 1).astype(np.float32).reshape(-1, 5, 3)


def lettering(x: Values, y: Values, wx: Values, wy: Values, cell: Values, seed: Cells) -> Values:
    """Returns the share of the footprint that is ink of seeded capitals of height 5 cells [m] standing on y = 0."""
    letter = np.floor(x / (4 * cell))
    number = letter.astype(np.int32).view(np.uint32)
    pixels = _PIXELS[(hash01(number, 5, seed) * 26).astype(np.intp)] * (hash01(number, 3, seed) >= 0.14)[:, None, None]
    x = x - letter * 4 * cell
    ink = np.zeros_like(x)
    for row in range(5):
        high = span(y, wy, (4 - row) * cell, (5 - row) * cell)
        for column in range(3):
            ink += pixels[:, row, column] * high * span(x, wx, column * cell, (column + 1) * cell)
    return ink
