"""The colours of the simulated place: what each material looks like at metric coordinates of a face (u right, v up)."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numba import njit

from ispom.simulation.noise import FAST, disc, grain, hash01, joints, lettering, masonry, rectangle, span


class Material(IntEnum):
    """What a face is made of."""

    PLASTER = 0
    BRICK = 1
    STONE = 2
    FACADE = 3
    ROAD = 4
    PAVING = 5
    WOOD = 6
    PAINT = 7
    FOLIAGE = 8
    SIGN = 9
    STRIPES = 10
    ROOF = 11
    CAR = 12
    POSTER = 13


WIDTH, HEIGHT, RED, GREEN, BLUE, STYLE, BAY, FLOOR = range(8)
"""Columns of a face's parameters: size [m], colour 0-255; of a facade also its wall, bay width and floor height [m]."""

_LOOKS = np.array([
    # grain stain warmth | stones: length height [m], joint [m], shift per row, tint, brightness of the joint
    [0.15, 0.09, 0.04, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # plaster
    [0.12, 0.07, 0.07, 0.25, 0.08, 0.012, 0.50, 0.20, 1.35],  # brick
    [0.14, 0.07, 0.05, 0.75, 0.38, 0.020, 0.50, 0.17, 0.45],  # stone
    [0.00, 0.00, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # facade: looks like its wall
    [0.19, 0.07, 0.01, 1.90, 2.70, 0.040, 0.41, 0.13, 0.65],  # road
    [0.17, 0.06, 0.04, 0.62, 0.41, 0.018, 0.50, 0.22, 0.40],  # paving
    [0.15, 0.05, 0.04, 1.40, 0.14, 0.012, 0.37, 0.25, 0.40],  # wood
    [0.09, 0.06, 0.00, 0.95, 0.62, 0.015, 0.43, 0.06, 0.60],  # paint
    [0.34, 0.16, 0.12, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # foliage
    [0.11, 0.04, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # sign
    [0.13, 0.05, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # stripes
    [0.15, 0.07, 0.06, 0.24, 0.34, 0.030, 0.50, 0.25, 0.60],  # roof
    [0.07, 0.03, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # car
    [0.10, 0.04, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00],  # poster
])  # fmt: skip


@njit(**FAST)
def _mix(colour, other, part):
    """Between two colours, part 0..1."""
    return (
        colour[0] + (other[0] - colour[0]) * part,
        colour[1] + (other[1] - colour[1]) * part,
        colour[2] + (other[2] - colour[2]) * part,
    )


@njit(**FAST)
def _opening(colour, kind, seed, i, k, x, y, wx, wy, width, height, fine, stain):
    """A window (kind 0), shop front (1) or door (2) at (x, y) of its own 0..width, 0..height, laid over a colour."""
    cover = rectangle(x, y, wx, wy, 0.0, 0.0, width, height)
    if cover <= 0.0:
        return colour
    frame, tone, hue = 0.07, hash01(i, k, seed + 2), hash01(i, k, seed + 3)
    base = 38.0 + 45.0 * hash01(i, k, seed + 4) + 30.0 * y / height + 9.0 * fine + 14.0 * stain
    inner = (base, 1.03 * base, 1.13 * base)
    inside = rectangle(x, y, wx, wy, frame, frame if kind < 2 else 0.0, width - frame, height - frame)
    drawn = hash01(i, k, seed + 5)
    if kind == 0 and drawn > 0.3:  # a blind or curtain
        fold = 1.0 + 0.07 * fine + 0.08 * stain
        cloth = ((150 + 80 * hue) * fold, (150 + 60 * tone) * fold, (200 - 70 * hue) * fold)
        inner = _mix(inner, cloth, span(y, wy, height * (1.3 - 1.25 * drawn), height))
    if kind > 0:  # goods behind the glass, or the panels of a door
        length, rise, joint = (0.31, 0.4, 0.06) if kind == 1 else (0.46, 0.62, 0.04)
        tint, gap = masonry(x + 3.1 * i, y, wx, wy, length, rise, joint, 0.37 * (kind == 1), seed + 6 + i)
        if kind == 1:
            lit = (1.0 - gap) * span(y, wy, 0.3, height - 0.45)
            ware = (135 + 80 * math.sin(9 * tint), 125 + 75 * math.sin(14 * tint + hue), 115 + 70 * math.sin(21 * tint))
            inner = _mix(inner, ware, 0.85 * lit)
        else:
            light = (1.0 + 0.1 * fine + 0.1 * tint) * (1.0 - 0.5 * gap)
            inner = ((60 + 110 * hue) * light, (50 + 60 * tone) * light, (120 - 80 * hue) * light)
            inner = _mix(inner, (225.0, 205.0, 120.0), disc(x, y, max(wx, wy), width - 0.2, 1.05, 0.06))
    if kind < 2:
        pane = width / (2.0 + math.floor(2.0 * hash01(i, k, seed + 7)))
        inside *= (1.0 - joints(x, wx, pane, 0.045)) * (1.0 - span(y, wy, 0.66 * height, 0.66 * height + 0.05))
    light = 1.0 + 0.08 * fine
    around = ((225.0 - 150.0 * tone) * light, (222.0 - 140.0 * tone) * light, (215.0 - 150.0 * hue) * light)
    return _mix(colour, _mix(around, inner, inside), cover)


@njit(**FAST)
def _front(colour, p, seed, u, v, wu, wv, fine, stain):
    """A house front laid over its wall: shops and doors below, floors of windows above, no two alike."""
    bays = max(1.0, math.floor(p[WIDTH] / p[BAY]))
    bay, floor, ground = p[WIDTH] / bays, p[FLOOR], 3.7
    i = int(min(bays - 1.0, max(0.0, math.floor(u / bay))))
    x = u - i * bay
    if v < ground:
        dark = 1.0 - 0.28 * (1.0 - span(v, wv, 0.7, 100.0))
        colour = (colour[0] * dark, colour[1] * dark, colour[2] * dark)
        what, k = hash01(i, 0, seed + 1), 0
        kind = 2 if what < 0.3 else 1 if what < 0.85 else 3
        width, height, bottom = (1.15, 2.3, 0.05) if kind == 2 else (bay - 0.5, 2.15, 0.55)
    else:
        k = 1 + math.floor((v - ground) / floor)
        low = ground + (k - 1) * floor
        kind = 0 if low + floor < p[HEIGHT] - 0.2 else 3
        width, height = (
            min(bay - 0.6, 1.0 + 0.9 * hash01(i, k, seed + 15)),
            min(floor - 1.1, 1.4 + 0.7 * hash01(i, k, seed + 16)),
        )
        bottom = low + 0.75 + 0.25 * hash01(i, k, seed + 17)
        pale = (0.5 * p[RED] + 95 + 9 * fine, 0.5 * p[GREEN] + 90 + 9 * fine, 0.5 * p[BLUE] + 85 + 9 * fine)
        colour = _mix(colour, pale, span(v, wv, low - 0.02, low + 0.16))
    if kind == 3:
        return colour
    left = 0.5 * (bay - width) * (0.75 + 0.5 * hash01(i, k, seed + 18))
    lift = 0.2 if hash01(0, 0, seed + 19) > 0.4 else -0.3
    lift = 1.0 + lift * rectangle(x, v, wu, wv, left - 0.14, bottom - 0.12, left + width + 0.14, bottom + height + 0.14)
    colour = (colour[0] * lift, colour[1] * lift, colour[2] * lift)
    return _opening(colour, kind, seed, i, k, x - left, v - bottom, wu, wv, width, height, fine, stain)


@njit(**FAST)
def _street(colour, p, seed, u, v, wu, wv, fine, stain):
    """Worn lines and manholes on a road; u across it, v along it."""
    dash = math.floor(v / 4.3)
    start, middle = 4.3 * dash + 0.3 + hash01(dash, 1, seed), 0.5 * p[WIDTH]
    line = rectangle(u, v, wu, wv, middle - 0.07, start, middle + 0.07, start + 1.6 + hash01(dash, 2, seed))
    line = max(line, span(u, wu, 0.3, 0.42), span(u, wu, p[WIDTH] - 0.42, p[WIDTH] - 0.3))
    line *= min(1.0, max(0.0, 0.75 + 0.3 * fine + 0.3 * stain))
    colour = _mix(colour, (215.0, 212.0, 198.0), line)
    i, j = math.floor(u / 3.4), math.floor(v / 5.2)
    if hash01(i, j, seed + 3) < 0.6:
        w = math.sqrt(wu * wv)
        x, y = u - 3.4 * i - 0.8 - 1.8 * hash01(i, j, seed + 4), v - 5.2 * j - 0.8 - 3.5 * hash01(i, j, seed + 5)
        lid = disc(x, y, w, 0.0, 0.0, 0.36)
        if lid > 0.0:
            ribs = joints(x + y, wu + wv, 0.11, 0.05) + joints(x - y, wu + wv, 0.13, 0.05)
            shade = 60 + 12 * fine + 35 * ribs - 35 * (lid - disc(x, y, w, 0.0, 0.0, 0.29))
            colour = _mix(colour, (shade, shade, 1.05 * shade), lid)
    return colour


@njit(**FAST)
def _print(colour, p, seed, u, v, wu, wv, poster):
    """A name on a board; on a poster smaller, under coloured shapes."""
    pale = p[RED] + 2 * p[GREEN] < 360
    ink = (240.0, 232.0, 200.0) if pale else (30.0, 28.0, 45.0)
    cell = p[HEIGHT] / 45.0 if poster else 0.11 * p[HEIGHT]
    w = math.sqrt(wu * wv)
    for n in range(7 if poster else 0):
        cx, cy = p[WIDTH] * hash01(n, 1, seed), p[HEIGHT] * (0.2 + 0.8 * hash01(n, 2, seed))
        size = 0.28 * p[WIDTH] * (0.3 + hash01(n, 3, seed))
        box = rectangle(u, v, wu, wv, cx - size, cy - 0.6 * size, cx + size, cy + 0.6 * size)
        part = disc(u, v, w, cx, cy, size) if n % 2 else box
        colour = _mix(colour, (240 * hash01(n, 4, seed), 230 * hash01(n, 5, seed), 230 * hash01(n, 6, seed)), part)
    line = 7.0 * cell if poster and v > 8.0 * cell else 0.0
    letters = lettering(u - 2 * cell, v - 2 * cell - line, wu, wv, cell, seed + 50 + int(line > 0))
    colour = _mix(colour, ink, letters * span(u, wu, 0.06, p[WIDTH] - 0.1))
    return _mix(ink, colour, 0.3 + 0.7 * rectangle(u, v, wu, wv, 0.03, 0.03, p[WIDTH] - 0.03, p[HEIGHT] - 0.03))


@njit(**FAST)
def surface(texels, material, p, seed, u, v, wu, wv):
    """Mean colour (r, g, b), 0-255, of a face over a footprint of wu x wv [m] centred on (u, v) [m], in plain light."""
    fine, stain = grain(texels, u, v, math.sqrt(wu * wv), seed)
    look = _LOOKS[int(p[STYLE]) if material == Material.FACADE else material]
    light, warm = 1.0 + look[0] * fine + look[1] * stain, look[2] * stain
    if look[3] > 0.0:
        tint, gap = masonry(u, v, wu, wv, look[3], look[4], look[5], look[6], seed + 40)
        light = (light + look[7] * tint) * (1.0 - gap) + (1.0 + look[0] * fine) * look[8] * gap
        warm += look[2] * tint
    light = max(0.12, light)
    colour = (p[RED] * (light + warm), p[GREEN] * light, p[BLUE] * (light - warm))
    if material == Material.FACADE:
        return _front(colour, p, seed, u, v, wu, wv, fine, stain)
    if material == Material.ROAD:
        return _street(colour, p, seed, u, v, wu, wv, fine, stain)
    if material in (Material.SIGN, Material.POSTER):
        return _print(colour, p, seed, u, v, wu, wv, material == Material.POSTER)
    if material == Material.STRIPES:
        return _mix(colour, (232.0 * light, 226.0 * light, 210.0 * light), joints(u, wu, 0.5, 0.25))
    if material == Material.CAR:
        glass = 45 + 8 * fine + 10 * stain + 50 * v
        middle = span(u, wu, 0.5 * p[WIDTH] - 0.05, 0.5 * p[WIDTH] + 0.05)
        pane = rectangle(u, v, wu, wv, 0.09, 0.05, p[WIDTH] - 0.09, p[HEIGHT] - 0.06) * (1.0 - middle)
        return _mix(colour, (glass, 1.05 * glass, 1.12 * glass), pane)
    return colour


@njit(**FAST)
def sky(texels, x, y, z, width):
    """Colour (r, g, b) of the sky in a direction (x, y down, z), seen over an angle `width` [rad]."""
    up = max(0.0, -y) / math.sqrt(x * x + y * y + z * z)
    reach = 1.5 / (up + 0.15)
    _, stain = grain(texels, x * reach, z * reach, width * reach * reach, np.int64(7))
    cover = min(1.0, max(0.0, 0.42 + 0.36 * stain)) * min(1.0, 4.0 * up + 0.15)
    return _mix((205.0 - 115.0 * up, 220.0 - 80.0 * up, 238.0 - 30.0 * up), (248.0, 249.0, 251.0), cover)
