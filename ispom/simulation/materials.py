"""The colours of the simulated place: one function per material, of metric coordinates on a face (u right, v up)."""

from __future__ import annotations

import math
from enum import IntEnum

from numba import njit

from ispom.simulation.noise import (
    FAST,
    disc,
    hash01,
    joints,
    lettering,
    masonry,
    octaves,
    rectangle,
    span,
    value_noise,
)


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
"""Columns of a face's parameters: size [m], colour 0-255, wall style, bay width and floor height [m]."""


@njit(**FAST)
def _wall(style, seed, u, v, wu, wv):
    """Factor of brightness and of warmth of a wall: style 0 plaster, 1 brick, 2 stone."""
    w = math.sqrt(wu * wv)
    grain = octaves(u, v, w, seed, 1.6, 0.006, 0.85)
    stain = octaves(0.7 * u, 0.25 * v, w, seed + 31, 3.0, 0.4, 0.8)
    if style < 0.5:
        return 1.0 + 0.24 * grain + 0.12 * stain, 0.05 * stain
    if style < 1.5:
        tint, gap = masonry(u, v, wu, wv, 0.25, 0.08, 0.012, 0.5, seed + 40)
        return (1.0 + 0.20 * tint + 0.16 * grain + 0.1 * stain) * (1 - gap) + 1.35 * gap, 0.10 * tint * (1 - gap)
    tint, gap = masonry(u, v, wu, wv, 0.75, 0.38, 0.02, 0.5, seed + 40)
    return (1.0 + 0.17 * tint + 0.2 * grain + 0.1 * stain) * (1 - 0.55 * gap), 0.05 * tint


@njit(**FAST)
def _opening(kind, seed, i, k, x, y, wx, wy, width, height):
    """Colour of a window or shop front at (x, y) of its own 0..width, 0..height, frame included."""
    frame = 0.07
    tone = hash01(i, k, seed + 2)
    fr, fg, fb = 225.0 - 150.0 * tone, 222.0 - 140.0 * tone, 215.0 - 150.0 * hash01(i, k, seed + 3)
    w = math.sqrt(wx * wy)
    murk = octaves(x + 9.0 * i, y + 7.0 * k, w, seed + 5, 0.9, 0.03, 0.9)
    base = 38.0 + 45.0 * hash01(i, k, seed + 6) + 30.0 * y / height
    r, g, b = base * (1.0 + 0.45 * murk), base * (1.04 + 0.45 * murk), base * (1.15 + 0.4 * murk)
    drawn = hash01(i, k, seed + 7)
    if kind == 0 and drawn > 0.3:  # blind or curtain from above, with folds
        depth = height * min(0.97, 1.25 * drawn - 0.3)
        cover = span(y, wy, height - depth, height)
        fold = 1.0 + 0.16 * octaves(3.0 * x, 0.3 * y, w * 1.7, seed + 8 + k, 0.4, 0.05, 0.8)
        hue = hash01(i, k, seed + 9)
        cr, cg, cb = (150 + 80 * hue) * fold, (150 + 60 * tone) * fold, (130 + 70 * (1 - hue)) * fold
        r, g, b = r + (cr - r) * cover, g + (cg - g) * cover, b + (cb - b) * cover
    if kind == 1:  # goods behind the glass of a shop
        goods, gap = masonry(x + 3.1 * i, y, wx, wy, 0.34, 0.42, 0.06, 0.37, seed + 11 + i)
        hue = hash01(int(math.floor(x / 0.34)), int(math.floor(y / 0.42)), seed + 12 + i)
        lit = (1.0 - gap) * span(y, wy, 0.25, height - 0.5)
        r += lit * (70 + 85 * goods + 40 * hue * (1 - min(1.0, wx / 0.34)))
        g += lit * (62 + 80 * goods)
        b += lit * (45 + 70 * goods)
    inside = rectangle(x, y, wx, wy, frame, frame, width - frame, height - frame)
    pane = width / (2.0 + math.floor(2.0 * hash01(i, k, seed + 10)))
    bars = joints(x, wx, pane, 0.045) if kind != 2 else 0.0
    cross = span(y, wy, 0.66 * height, 0.66 * height + 0.05)
    inside *= (1.0 - bars) * (1.0 - cross)
    if kind == 2:  # a door: panelled wood, a handle
        tint, gap = masonry(x, y, wx, wy, 0.46, 0.62, 0.04, 0.0, seed + 13 + i)
        shade = (1.0 + 0.2 * murk + 0.1 * tint) * (1.0 - 0.5 * gap)
        hue = hash01(i, k, seed + 14)
        r, g, b = (60 + 110 * hue) * shade, (50 + 60 * tone) * shade, (40 + 80 * (1 - hue)) * shade
        knob = disc(x, y, w, width - 0.22, 1.05, 0.06)
        r, g, b = r + (225 - r) * knob, g + (205 - g) * knob, b + (120 - b) * knob
        inside = rectangle(x, y, wx, wy, frame, 0.0, width - frame, height - frame)
    grain = 1.0 + 0.12 * murk
    return (
        fr * grain + (r - fr * grain) * inside,
        fg * grain + (g - fg * grain) * inside,
        fb * grain + (b - fb * grain) * inside,
    )


@njit(**FAST)
def _facade(p, seed, u, v, wu, wv):
    """A house front: a ground floor of shops and doors, floors of windows no two of which are alike."""
    style, bay, floor = p[STYLE], p[BAY], p[FLOOR]
    light, warm = _wall(style, seed, u, v, wu, wv)
    r, g, b = p[RED] * (light + warm), p[GREEN] * light, p[BLUE] * (light - warm)
    bays = max(1.0, math.floor(p[WIDTH] / bay))
    bay = p[WIDTH] / bays
    i = int(min(bays - 1.0, max(0.0, math.floor(u / bay))))
    x = u - i * bay
    ground = 3.7
    if v < ground:
        base = 0.72 + 0.28 * span(v, wv, 0.7, 100.0) + 0.1 * (style == 0)
        r, g, b = r * base, g * base, b * base
        what = hash01(i, 0, seed + 1)
        kind = 2 if what < 0.3 else 1 if what < 0.85 else 3
        width = 1.15 if kind == 2 else bay - 0.5
        height, bottom = (2.3, 0.05) if kind == 2 else (2.15, 0.55)
        k = 0
    else:
        k = 1 + int(math.floor((v - ground) / floor))
        top = ground + k * floor
        kind = 0 if top < p[HEIGHT] - 0.2 else 3
        width = min(bay - 0.6, 1.0 + 0.9 * hash01(i, k, seed + 15))
        height = min(floor - 1.1, 1.35 + 0.7 * hash01(i, k, seed + 16))
        bottom = top - floor + 0.75 + 0.25 * hash01(i, k, seed + 17)
        ledge = span(v, wv, top - floor - 0.02, top - floor + 0.16)
        r, g, b = (
            r + (0.5 * p[RED] + 95 - r) * ledge,
            g + (0.5 * p[GREEN] + 90 - g) * ledge,
            b + (85 + 0.5 * p[BLUE] - b) * ledge,
        )
    if kind < 3:
        left = 0.5 * (bay - width) * (0.75 + 0.5 * hash01(i, k, seed + 18))
        surround = rectangle(x, v, wu, wv, left - 0.14, bottom - 0.12, left + width + 0.14, bottom + height + 0.14)
        lift = 1.18 if hash01(0, 0, seed + 19) > 0.4 else 0.7
        r, g, b = r * (1 + (lift - 1) * surround), g * (1 + (lift - 1) * surround), b * (1 + (lift - 1) * surround)
        cover = rectangle(x, v, wu, wv, left, bottom, left + width, bottom + height)
        if cover > 0.0:
            wr, wg, wb = _opening(kind, seed, i, k, x - left, v - bottom, wu, wv, width, height)
            r, g, b = r + (wr - r) * cover, g + (wg - g) * cover, b + (wb - b) * cover
    return r, g, b


@njit(**FAST)
def _road(p, seed, u, v, wu, wv):
    """Asphalt with patches, worn lines, cracks and manholes; u across the street, v along it."""
    w = math.sqrt(wu * wv)
    grain = octaves(u, v, w, seed, 2.5, 0.006, 0.88)
    patch, gap = masonry(u, v, wu, wv, 1.9, 2.7, 0.05, 0.41, seed + 3)
    wear = octaves(u, v, w, seed + 9, 0.8, 0.02, 0.9)
    light = (1.0 + 0.34 * grain + 0.2 * patch * (abs(patch) > 0.35)) * (1.0 - 0.35 * gap)
    vein = abs(value_noise(1.3 * u, 1.3 * v, seed + 20) + 0.5 * value_noise(3.1 * u, 3.1 * v, seed + 21))
    light *= 1.0 - 0.4 * max(0.0, 1.0 - vein / (0.03 + 1.4 * w)) * 0.03 / (0.03 + 1.4 * w)
    r, g, b = p[RED] * light, p[GREEN] * light, p[BLUE] * light
    dash = int(math.floor(v / 4.3))
    start = 0.3 + hash01(dash, 1, seed)
    middle = 0.5 * p[WIDTH]
    line = rectangle(
        u, v - 4.3 * dash, wu, wv, middle - 0.07, start, middle + 0.07, start + 1.6 + hash01(dash, 2, seed)
    )
    line = max(line, span(u, wu, 0.3, 0.42), span(u, wu, p[WIDTH] - 0.42, p[WIDTH] - 0.3))
    line *= min(1.0, max(0.0, 0.65 + 0.9 * wear))
    r, g, b = r + (215 - r) * line, g + (212 - g) * line, b + (198 - b) * line
    i, j = int(math.floor(u / 3.4)), int(math.floor(v / 5.2))
    if hash01(i, j, seed + 30) < 0.6:
        x, y = u - 3.4 * i - 0.8 - 1.8 * hash01(i, j, seed + 31), v - 5.2 * j - 0.8 - 3.5 * hash01(i, j, seed + 32)
        lid = disc(x, y, w, 0.0, 0.0, 0.36)
        if lid > 0.0:
            tint, ribs = masonry(x, y, wu, wv, 0.13, 0.09, 0.03, 0.5, seed + i)
            shade = 62 + 40 * tint + 60 * ribs + 25 * grain
            rim = lid - disc(x, y, w, 0.0, 0.0, 0.29)
            shade += (30 - shade) * rim
            r, g, b = r + (shade - r) * lid, g + (shade - g) * lid, b + (1.05 * shade - b) * lid
    return r, g, b


@njit(**FAST)
def _paving(p, seed, u, v, wu, wv):
    """Slabs, each of its own tone, worn and spotted."""
    w = math.sqrt(wu * wv)
    tint, gap = masonry(u, v, wu, wv, 0.62, 0.41, 0.018, 0.5, seed + 1)
    grain = octaves(u, v, w, seed + 2, 1.7, 0.006, 0.88)
    light = (1.0 + 0.24 * tint + 0.26 * grain) * (1.0 - 0.6 * gap)
    warm = 0.06 * tint
    return p[RED] * (light + warm), p[GREEN] * light, p[BLUE] * (light - warm)


@njit(**FAST)
def _print(p, seed, u, v, wu, wv, poster):
    """A sign (a name on a board) or a poster (shapes under a name)."""
    w = math.sqrt(wu * wv)
    grain = octaves(u, v, w, seed + 2, 0.8, 0.008, 0.85)
    light = 1.0 + 0.16 * grain
    r, g, b = p[RED] * light, p[GREEN] * light, p[BLUE] * light
    ink = 0.0
    dark = 0.299 * p[RED] + 0.587 * p[GREEN] + 0.114 * p[BLUE] > 120
    ir, ig, ib = (30.0, 28.0, 45.0) if dark else (240.0, 232.0, 200.0)
    if poster:
        for n in range(7):
            cx, cy = p[WIDTH] * hash01(n, 1, seed), p[HEIGHT] * (0.2 + 0.8 * hash01(n, 2, seed))
            size = 0.28 * p[WIDTH] * (0.3 + hash01(n, 3, seed))
            if n % 2:
                part = disc(u, v, w, cx, cy, size)
            else:
                part = rectangle(u, v, wu, wv, cx - size, cy - 0.6 * size, cx + size, cy + 0.6 * size)
            cr, cg, cb = 240 * hash01(n, 4, seed), 230 * hash01(n, 5, seed), 230 * hash01(n, 6, seed)
            r, g, b = r + (cr * light - r) * part, g + (cg * light - g) * part, b + (cb * light - b) * part
        cell = p[HEIGHT] / 45.0
        for n in range(2):
            ink = max(ink, lettering(u - 2 * cell, v - (2 + 7 * n) * cell, wu, wv, cell, seed + 50 + n))
    else:
        cell = 0.11 * p[HEIGHT]
        ink = lettering(u - 2 * cell, v - 2.0 * cell, wu, wv, cell, seed + 50)
    ink *= span(u, wu, 0.06, p[WIDTH] - 0.1)
    r, g, b = r + (ir - r) * ink, g + (ig - g) * ink, b + (ib - b) * ink
    inside = rectangle(u, v, wu, wv, 0.03, 0.03, p[WIDTH] - 0.03, p[HEIGHT] - 0.03)
    return ir * 0.8 + (r - ir * 0.8) * inside, ig * 0.8 + (g - ig * 0.8) * inside, ib * 0.8 + (b - ib * 0.8) * inside


@njit(**FAST)
def _car(p, seed, u, v, wu, wv):
    """The side of a car's cabin: panes between pillars."""
    w = math.sqrt(wu * wv)
    murk = octaves(u, v, w, seed, 0.8, 0.02, 0.85)
    glass = 45 + 28 * murk + 50 * v
    pane = rectangle(u, v, wu, wv, 0.09, 0.05, p[WIDTH] - 0.09, p[HEIGHT] - 0.06) * (
        1.0 - span(u, wu, 0.5 * p[WIDTH] - 0.05, 0.5 * p[WIDTH] + 0.05)
    )
    light = 1.0 + 0.1 * murk
    r, g, b = p[RED] * light, p[GREEN] * light, p[BLUE] * light
    return r + (glass - r) * pane, g + (1.05 * glass - g) * pane, b + (1.12 * glass - b) * pane


@njit(**FAST)
def surface(material, p, seed, u, v, wu, wv):
    """Mean colour (r, g, b), 0-255, of a face over a footprint of wu x wv [m] centred on (u, v) [m], in plain light."""
    if material == Material.FACADE:
        return _facade(p, seed, u, v, wu, wv)
    if material == Material.ROAD:
        return _road(p, seed, u, v, wu, wv)
    if material == Material.PAVING:
        return _paving(p, seed, u, v, wu, wv)
    if material in (Material.SIGN, Material.POSTER):
        return _print(p, seed, u, v, wu, wv, material == Material.POSTER)
    if material == Material.CAR:
        return _car(p, seed, u, v, wu, wv)
    w = math.sqrt(wu * wv)
    if material <= Material.STONE:
        light, warm = _wall(float(material), seed, u, v, wu, wv)
        return p[RED] * (light + warm), p[GREEN] * light, p[BLUE] * (light - warm)
    if material == Material.FOLIAGE:
        leaves = octaves(u, v, w, seed, 0.7, 0.012, 0.95)
        hue = octaves(u, v, w, seed + 20, 0.5, 0.05, 0.9)
        light = max(0.15, 1.0 + 0.75 * leaves)
        return p[RED] * light * (1.0 + 0.25 * hue), p[GREEN] * light, p[BLUE] * light * (1.0 - 0.2 * hue)
    if material == Material.WOOD:
        tint, gap = masonry(u, v, wu, wv, 1.4, 0.14, 0.012, 0.37, seed + 1)
        grain = octaves(0.3 * u, v, w, seed, 0.5, 0.006, 0.9)
        light = (1.0 + 0.25 * tint + 0.25 * grain) * (1.0 - 0.6 * gap)
        return p[RED] * light, p[GREEN] * light, p[BLUE] * light * (1.0 - 0.1 * tint)
    if material == Material.ROOF:
        tint, gap = masonry(u, v, wu, wv, 0.24, 0.34, 0.03, 0.5, seed + 1)
        light = (1.0 + 0.25 * tint + 0.2 * octaves(u, v, w, seed, 2.0, 0.02, 0.85)) * (1.0 - 0.4 * gap)
        return p[RED] * light, p[GREEN] * light * (1.0 + 0.08 * tint), p[BLUE] * light
    if material == Material.STRIPES:
        strip = 2.0 * joints(u, wu, 0.5, 0.25)
        light = 1.0 + 0.22 * octaves(u, v, w, seed, 0.8, 0.008, 0.88)
        r, g, b = (
            p[RED] + (232 - p[RED]) * 0.5 * strip,
            p[GREEN] + (226 - p[GREEN]) * 0.5 * strip,
            p[BLUE] + (210 - p[BLUE]) * 0.5 * strip,
        )
        return r * light, g * light, b * light
    dirt = octaves(u, v, w, seed, 1.1, 0.008, 0.9)
    seam, gap = masonry(u, v, wu, wv, 0.95, 0.62, 0.015, 0.43, seed + 1)
    light = (1.0 + 0.2 * dirt + 0.07 * seam) * (1.0 - 0.4 * gap) * (0.8 + 0.2 * span(v, wv, 0.12, 100.0))
    return p[RED] * light, p[GREEN] * light, p[BLUE] * light


@njit(**FAST)
def sky(x, y, z, width):
    """Colour (r, g, b) of the sky in a direction (x, y down, z), seen over an angle `width` [rad]."""
    up = max(0.0, -y) / math.sqrt(x * x + y * y + z * z)
    r, g, b = 205.0 - 115.0 * up, 220.0 - 80.0 * up, 238.0 - 30.0 * up
    reach = 1.0 / (up + 0.12)
    scale = width * reach * reach
    cloud = octaves(x * reach + 50.0, z * reach, scale, 77, 1.3, 0.02, 0.72)
    cover = min(1.0, max(0.0, 0.35 + 0.9 * cloud)) * min(1.0, 4.0 * up + 0.15)
    return r + (250 - r) * cover, g + (250 - g) * cover, b + (252 - b) * cover
