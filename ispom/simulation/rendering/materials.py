"""The colours of the simulated place: each material as a function of metric coordinates of a face (u right, v up)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.simulation.rendering.facades import Fronts
from ispom.simulation.rendering.noise import (
    Cells,
    Values,
    cells,
    disc,
    grain,
    hash01,
    joints,
    lettering,
    masonry,
    rectangle,
    span,
)


class Material(IntEnum):
    """The material of a face."""

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


_COUNT = len(Material)
WIDTH, HEIGHT, RED, GREEN, BLUE, STYLE, BAY, FLOOR = range(8)
"""Columns of a face's parameters: size [m], colour 0-255; of a facade also its wall, bay width and floor height [m]."""

_LOOKS = (
    # grain stain warmth | stones: length height [m], joint [m], shift per row, tint, brightness of the joint
    (0.15, 0.09, 0.04, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # plaster
    (0.12, 0.07, 0.07, 0.25, 0.08, 0.012, 0.50, 0.20, 1.35),  # brick
    (0.14, 0.07, 0.05, 0.75, 0.38, 0.020, 0.50, 0.17, 0.45),  # stone
    (0.00, 0.00, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # facade: looks like its wall
    (0.19, 0.07, 0.01, 1.90, 2.70, 0.040, 0.41, 0.13, 0.65),  # road
    (0.17, 0.06, 0.04, 0.62, 0.41, 0.018, 0.50, 0.22, 0.40),  # paving
    (0.15, 0.05, 0.04, 1.40, 0.14, 0.012, 0.37, 0.25, 0.40),  # wood
    (0.09, 0.06, 0.00, 0.95, 0.62, 0.015, 0.43, 0.06, 0.60),  # paint
    (0.34, 0.16, 0.12, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # foliage
    (0.11, 0.04, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # sign
    (0.13, 0.05, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # stripes
    (0.15, 0.07, 0.06, 0.24, 0.34, 0.030, 0.50, 0.25, 0.60),  # roof
    (0.07, 0.03, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # car
    (0.10, 0.04, 0.00, 0.00, 1.00, 0.000, 0.00, 0.00, 1.00),  # poster
)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The properties of all faces of a scene, as the shader looks them up."""

    look: NDArray[np.uint8]
    """(F,) the material, of facades 14 + their wall: samples are sorted by it, to be shaded together."""
    seed: Cells
    size: tuple[Values, Values]
    """(F,) width and height [m]."""
    paint: Values
    """(3, F) plain colour 0-255."""
    fronts: Fronts

    @staticmethod
    def of(material: NDArray[np.int64], seed: NDArray[np.int64], parameters: Array) -> Surfaces:
        """Makes surfaces from parameters (F, 8)."""
        facade, seeds = material == Material.FACADE, seed.astype(np.uint32)
        single = parameters.T.astype(np.float32)
        look = np.where(facade, _COUNT + parameters[:, STYLE].astype(np.int64), material).astype(np.uint8)
        return Surfaces(
            look,
            seeds,
            (single[WIDTH].copy(), single[HEIGHT].copy()),
            single[RED : BLUE + 1].copy(),
            Fronts.of(parameters[:, :2], parameters[:, BAY], parameters[:, FLOOR], seeds, facade),
        )

    def colour(self, look: int, face: NDArray[np.intp], u: Values, v: Values, wu: Values, wv: Values) -> Values:
        """Returns mean colours (3, N), 0-255, of faces that share a look, in plain light.

        Footprints of wu x wv [m] are centred on (u, v) [m].
        """
        material = Material.FACADE if look >= _COUNT else Material(look)
        rough, stained, warmth, length, height, joint, shift, tinted, bright = _LOOKS[look % _COUNT]
        seed, paint = self.seed.take(face), self.paint.take(face, axis=1)
        fine, stain = grain(u, v, np.sqrt(wu * wv), seed)
        light, warm = 1 + rough * fine + stained * stain, warmth * stain
        if length > 0:
            tint, gap = masonry(u, v, wu, wv, seed + np.uint32(40), length, height, joint, shift)
            light = (light + tinted * tint) * (1 - gap) + (1 + rough * fine) * (bright * gap)
            warm = warm + warmth * tint
        light = np.maximum(light, 0.12)
        colour = np.stack([paint[0] * (light + warm), paint[1] * light, paint[2] * (light - warm)])
        if material == Material.FACADE:
            return self.fronts.over(colour, paint, face, seed, u, v, wu, wv, fine, stain)
        width, height = (a.take(face) for a in self.size)
        if material == Material.ROAD:
            return _street(colour, width, seed, u, v, wu, wv, fine, stain)
        if material in (Material.SIGN, Material.POSTER):
            return _print(colour, paint, width, height, seed, u, v, wu, wv, material == Material.POSTER)
        if material == Material.STRIPES:
            return _mix(colour, np.array([[232], [226], [210]], np.float32) * light, joints(u, wu, 0.5, 0.25))
        if material == Material.CAR:
            glass = 45 + 8 * fine + 10 * stain + 50 * v
            middle = span(u, wu, 0.5 * width - 0.05, 0.5 * width + 0.05)
            pane = rectangle(u, v, wu, wv, 0.09, 0.05, width - 0.09, height - 0.06) * (1 - middle)
            return _mix(colour, np.stack([glass, 1.05 * glass, 1.12 * glass]), pane)
        return colour


def _mix(colour: Values, other: Values, part: Values) -> Values:
    """Blends two colours (3, N); part 0..1."""
    return colour + (other - colour) * part


def _street(
    colour: Values, width: Values, seed: Cells,
    u: Values, v: Values, wu: Values, wv: Values, fine: Values, stain: Values,
) -> Values:  # fmt: skip
    """Worn lines and manholes on a road; u across it, v along it."""
    dash = np.floor(v / 4.3)
    number, middle = cells(dash), 0.5 * width
    start = 4.3 * dash + 0.3 + hash01(number, 1, seed)
    stop = start + 1.6 + hash01(number, 2, seed)
    line = rectangle(u, v, wu, wv, middle - 0.07, start, middle + 0.07, stop)
    line = np.maximum(line, np.maximum(span(u, wu, 0.3, 0.42), span(u, wu, width - 0.42, width - 0.3)))
    line = line * np.clip(0.75 + 0.3 * fine + 0.3 * stain, 0, 1)
    colour = _mix(colour, np.array([[215], [212], [198]], np.float32), line)
    column, row = np.floor(u / 3.4), np.floor(v / 5.2)
    i, j = cells(column), cells(row)
    x = u - 3.4 * column - 0.8 - 1.8 * hash01(i, j, seed + np.uint32(4))
    y = v - 5.2 * row - 0.8 - 3.5 * hash01(i, j, seed + np.uint32(5))
    w = np.sqrt(wu * wv)
    lid = disc(x, y, w, 0.0, 0.0, 0.36) * (hash01(i, j, seed + np.uint32(3)) < 0.6)
    some = np.flatnonzero(lid > 0)
    if len(some):
        x, y, both, part = x[some], y[some], (wu + wv)[some], lid[some]
        ribs = joints(x + y, both, 0.11, 0.05) + joints(x - y, both, 0.13, 0.05)
        shade = 60 + 12 * fine[some] + 35 * ribs - 35 * (part - disc(x, y, w[some], 0.0, 0.0, 0.29))
        colour[:, some] = _mix(colour[:, some], np.stack([shade, shade, 1.05 * shade]), part)
    return colour


def _print(
    colour: Values, paint: Values, width: Values, height: Values, seed: Cells,
    u: Values, v: Values, wu: Values, wv: Values, poster: bool,
) -> Values:  # fmt: skip
    """Returns a name on a board; on a poster smaller, under coloured shapes."""
    pale = paint[0] + 2 * paint[1] < 360
    ink = np.where(pale, np.array([[240], [232], [200]], np.float32), np.array([[30], [28], [45]], np.float32))
    cell = height / 45 if poster else 0.11 * height
    for n in range(7 if poster else 0):
        part = [hash01(n, k, seed) for k in range(1, 7)]
        cx, cy, size = width * part[0], height * (0.2 + 0.8 * part[1]), 0.28 * width * (0.3 + part[2])
        if n % 2:
            shape = disc(u, v, np.sqrt(wu * wv), cx, cy, size)
        else:
            shape = rectangle(u, v, wu, wv, cx - size, cy - 0.6 * size, cx + size, cy + 0.6 * size)
        colour = _mix(colour, np.stack([240 * part[3], 230 * part[4], 230 * part[5]]), shape)
    second = (v > 8 * cell) & poster
    letters = lettering(
        u - 2 * cell, v - 2 * cell - 7 * cell * second, wu, wv, cell, seed + np.uint32(50) + second.astype(np.uint32)
    )
    colour = _mix(colour, ink, letters * span(u, wu, 0.06, width - 0.1))
    return _mix(ink, colour, 0.3 + 0.7 * rectangle(u, v, wu, wv, 0.03, 0.03, width - 0.03, height - 0.03))


def sky(x: Values, y: Values, z: Values, width: Values) -> Values:
    """Returns colours (3, N) of the sky in directions (x, y down, z), for angles of view `width` [rad]."""
    up = np.maximum(-y, 0) / np.sqrt(x * x + y * y + z * z)
    reach = 1.5 / (up + 0.15)
    _, stain = grain(x * reach, z * reach, width * reach * reach, np.full(len(x), 7, np.uint32))
    cover = np.clip(0.42 + 0.36 * stain, 0, 1) * np.minimum(1, 4 * up + 0.15)
    plain = np.stack([205 - 115 * up, 220 - 80 * up, 238 - 30 * up])
    return _mix(plain, np.array([[248], [249], [251]], np.float32), cover)
