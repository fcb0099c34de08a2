"""House fronts: shops and doors below, floors of windows above, all different."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.simulation.rendering.noise import Cells, Values, disc, hash01, joints, masonry, rectangle, span

_GROUND_M = 3.7
"""Height of the ground floor."""
_FRAME_M = 0.07
WINDOW, SHOP, DOOR, BLANK = range(4)


@dataclass(frozen=True, eq=False)
class Fronts:
    """The openings of all bays of all floors, computed once."""

    first: NDArray[np.int64]
    """(F,) index of the first opening of a face, ground floor first, bay by bay; then (F,) per face:"""
    bays: Values
    bay_m: Values
    floor_m: Values
    lift: Values
    """Brightness around openings."""
    openings: Values
    """(O, 11): kind, left, bottom, width, height [m], tone, hue, dark, drawn 0..1, panes, and the bay's number."""

    @staticmethod
    def of(size: Array, bay: Array, floor: Array, seed: Cells, is_front: NDArray[np.bool_]) -> Fronts:
        """Makes fronts for faces of a size (F, 2) [m], with bays of about this width and floors of this height, (F,)
        [m]."""
        bay, floor = np.where(is_front, bay, 1.0), np.where(is_front, floor, 1.0)
        bays = np.where(is_front, np.maximum(1, np.floor(size[:, 0] / bay)), 0).astype(np.int64)
        floors = np.where(is_front, 2 + np.maximum(0, np.floor((size[:, 1] - _GROUND_M) / floor)), 0).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(bays * floors)])
        face = np.repeat(np.arange(len(bays)), bays * floors)
        k, i = np.divmod(np.arange(first[-1]) - first[face], bays[face])
        bay_m = size[:, 0] / np.maximum(bays, 1)
        openings = _openings(i, k, seed[face], bay_m[face], floor[face], size[face, 1])
        lift = np.where(hash01(0, 0, seed + np.uint32(19)) > 0.4, 0.2, -0.3)
        wide, bay_size, high, light = (a.astype(np.float32) for a in (bays, bay_m, floor, lift))
        return Fronts(first=first[:-1], bays=wide, bay_m=bay_size, floor_m=high, lift=light, openings=openings)

    def over(
        self, colour: Values, paint: Values, face: NDArray[np.intp], seed: Cells,
        u: Values, v: Values, wu: Values, wv: Values, fine: Values, stain: Values,
    ) -> Values:  # fmt: skip
        """(3, N) a wall's colour with the front laid over it; `paint` (3, N) is the wall's plain colour."""
        bays, floor_m = self.bays.take(face), self.floor_m.take(face)
        i = np.clip(np.floor(u / self.bay_m.take(face)), 0, bays - 1)
        k = np.floor(np.maximum((v - _GROUND_M) / floor_m + 1, 0))
        x = u - i * self.bay_m.take(face)
        upstairs = np.minimum(k, 1)
        # A darker base below, a pale band below each row of windows.
        dark = 1 - 0.28 * (1 - upstairs) * (1 - span(v, wv, 0.7, 100.0))
        low = _GROUND_M + (k - 1) * floor_m
        band = upstairs * span(v, wv, low - 0.02, low + 0.16)
        pale = 0.5 * paint + (np.array([[95], [90], [85]], np.float32) + 9 * fine)
        colour = colour * dark
        colour += (pale - colour) * band
        place = self.first.take(face) + (k * bays + i).astype(np.int64)
        opening = self.openings.take(place, axis=0, mode="clip").T
        _, left, bottom, width, height = opening[:5]
        x, y = x - left, v - bottom
        colour *= 1 + self.lift.take(face) * rectangle(x, y, wu, wv, -0.14, -0.12, width + 0.14, height + 0.14)
        cover = rectangle(x, y, wu, wv, 0.0, 0.0, width, height)
        seen = np.flatnonzero(cover > 0)
        if len(seen):
            shown = _opening(
                opening[:, seen], seed[seen], x[seen], y[seen], wu[seen], wv[seen], fine[seen], stain[seen]
            )
            colour[:, seen] += (shown - colour[:, seen]) * cover[seen]
        return colour


def _openings(
    bay_index: NDArray[np.int64], floor_index: NDArray[np.int64], seed: Cells, bay: Array, floor: Array, top: Array
) -> Values:
    """(O, 11) as in Fronts."""
    i, k = bay_index.astype(np.uint32), floor_index.astype(np.uint32)

    def chance(salt: int) -> Values:
        return hash01(i, k, seed + np.uint32(salt))

    ground, low = k == 0, _GROUND_M + (floor_index - 1) * floor
    what = chance(1)
    below = np.where(what < 0.3, DOOR, np.where(what < 0.85, SHOP, BLANK))
    kind = np.where(ground, below, np.where(low + floor < top - 0.2, WINDOW, BLANK))
    width = np.minimum(bay - 0.6, 1.0 + 0.9 * chance(15))
    height = np.minimum(floor - 1.1, 1.4 + 0.7 * chance(16))
    bottom = low + 0.75 + 0.25 * chance(17)
    width = np.where(kind == DOOR, 1.15, np.where(kind == SHOP, bay - 0.5, width))
    height = np.where(kind == DOOR, 2.3, np.where(kind == SHOP, 2.15, height))
    bottom = np.where(kind == DOOR, 0.05, np.where(kind == SHOP, 0.55, bottom))
    left = 0.5 * (bay - width) * (0.75 + 0.5 * chance(18))
    bottom = np.where(kind == BLANK, 1e6, bottom)  # nowhere
    panes = 2 + np.floor(2 * chance(7))
    columns = (kind, left, bottom, width, height, chance(2), chance(3), 38 + 45 * chance(4), chance(5), panes, i)
    return np.stack(columns, axis=1).astype(np.float32)


def _opening(
    opening: Values, seed: Cells, x: Values, y: Values, wx: Values, wy: Values, fine: Values, stain: Values
) -> Values:
    """(3, N) colours of windows, shop fronts and doors at (x, y) of their own 0..width, 0..height."""
    kind, _, _, width, height, tone, hue, dark, drawn, panes, bay = opening
    is_door = kind == DOOR
    base = dark + 30 * y / height + 9 * fine + 14 * stain
    inner = np.stack([base, 1.03 * base, 1.13 * base])
    # Blinds and curtains.
    cloth = np.stack([150 + 80 * hue, 150 + 60 * tone, 200 - 70 * hue]) * (1 + 0.07 * fine + 0.08 * stain)
    closed = span(y, wy, height * (1.3 - 1.25 * drawn), height) * ((kind == WINDOW) & (drawn > 0.3))
    inner += (cloth - inner) * closed
    for which, goods in ((SHOP, _goods), (DOOR, _panels)):
        some = np.flatnonzero(kind == which)
        if len(some):
            own = np.uint32(6) + bay[some].astype(np.uint32)
            inner[:, some] = goods(
                inner[:, some], opening[:, some], seed[some] + own, x[some], y[some], wx[some], wy[some], fine[some]
            )
    bottom = np.where(is_door, np.float32(0), np.float32(_FRAME_M))
    inside = rectangle(x, y, wx, wy, _FRAME_M, bottom, width - _FRAME_M, height - _FRAME_M)
    bars = (1 - joints(x, wx, width / panes, 0.045)) * (1 - span(y, wy, 0.66 * height, 0.66 * height + 0.05))
    inside *= np.maximum(bars, is_door)
    light = 1 + 0.08 * fine
    around = np.stack([225 - 150 * tone, 222 - 140 * tone, 215 - 150 * hue]) * light
    return around + (inner - around) * inside


def _goods(inner, opening, seed, x, y, wx, wy, _fine):
    """Wares behind the glass of a shop."""
    height, hue, bay = opening[4], opening[6], opening[10]
    tint, gap = masonry(x + 3.1 * bay, y, wx, wy, seed, 0.31, 0.4, 0.06, 0.37)
    lit = (1 - gap) * span(y, wy, 0.3, height - 0.45)
    ware = np.stack([135 + 80 * np.sin(9 * tint), 125 + 75 * np.sin(14 * tint + hue), 115 + 70 * np.sin(21 * tint)])
    return inner + (ware - inner) * (0.85 * lit)


def _panels(_inner, opening, seed, x, y, wx, wy, fine):
    """A door's, with its handle."""
    width, tone, hue, bay = opening[3], opening[5], opening[6], opening[10]
    tint, gap = masonry(x + 3.1 * bay, y, wx, wy, seed, 0.46, 0.62, 0.04, 0.0)
    light = (1 + 0.1 * fine + 0.1 * tint) * (1 - 0.5 * gap)
    wood = np.stack([60 + 110 * hue, 50 + 60 * tone, 120 - 80 * hue]) * light
    handle = disc(x, y, np.maximum(wx, wy), width - 0.2, 1.05, 0.06)
    return wood + (np.array([[225], [205], [120]], np.float32) - wood) * handle
