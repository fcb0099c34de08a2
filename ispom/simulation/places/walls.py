"""Places of one wall: all points in a plane, nothing to track, repetitive texture, tags with known sides.

The wall is the plane z = WALL_M, and fills the view of a camera that moves along x at z about 0 and looks at it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ispom.geometry import Array
from ispom.simulation.rendering.materials import Material, Surfaces
from ispom.simulation.rendering.noise import Values
from ispom.simulation.rendering.scene import Scene, SceneBuilder

WALL_M = 6.0
TILE_M = 0.5
"""Period of the repetitive wall, along u and v."""
PLAIN = (150.0, 146.0, 140.0)
"""Colour of the wall without texture."""
CORNER_M = (120.0, 30.0)
"""x and y of the wall's lower right corner, from which u runs to the left and v up."""
CELL_M = 0.15
"""Cell of a printed tag: the black square has 8, 1.2 m, and around it a white border of one."""
PITCH_CELLS, TAG_COLUMNS, TAG_ROWS = 14, 40, 12
"""From one tag to the next, and the number of tags along x and y, around the wall's middle."""
INK, PAPER = 25.0, 215.0
"""Grey levels of a print."""
Wall = Literal["wall", "blank", "tiles", "tags"]


def build_wall(seed: int, kind: Wall) -> Scene:
    """wall: textured; blank: one colour; tiles: every 0.5 m the same; tags: AprilTags (36h11) every 2.1 m."""
    builder = SceneBuilder(np.random.default_rng([seed, 3]))
    corner, along, up = np.array([*CORNER_M, WALL_M]), np.array([-240.0, 0.0, 0.0]), np.array([0.0, -60.0, 0.0])
    builder.face(corner, along, up, Material.STONE, (168, 152, 132))
    scene = builder.build()
    if kind == "wall":
        return scene
    surfaces = {"blank": Blank, "tiles": Tiled, "tags": Tagged}[kind]
    values = {f.name: getattr(scene.surfaces, f.name) for f in fields(Surfaces)}
    return replace(scene, surfaces=surfaces(**values), light=np.ones_like(scene.light))


@dataclass(frozen=True, eq=False)
class Blank(Surfaces):
    """One colour."""

    def colour(self, look: int, face: NDArray[np.intp], u: Values, v: Values, wu: Values, wv: Values) -> Values:
        return np.repeat(np.array(PLAIN, np.float32)[:, None], len(u), axis=1)


@dataclass(frozen=True, eq=False)
class Tiled(Surfaces):
    """Repeats the first tile everywhere."""

    def colour(self, look: int, face: NDArray[np.intp], u: Values, v: Values, wu: Values, wv: Values) -> Values:
        return super().colour(look, face, u % np.float32(TILE_M), v % np.float32(TILE_M), wu, wv)


@dataclass(frozen=True, eq=False)
class Tagged(Surfaces):
    """Has prints of tags."""

    def colour(self, look: int, face: NDArray[np.intp], u: Values, v: Values, wu: Values, wv: Values) -> Values:
        stone = super().colour(look, face, u, v, wu, wv)
        column = (CORNER_M[0] - u) / CELL_M + TAG_COLUMNS * PITCH_CELLS / 2
        row = (CORNER_M[1] - v) / CELL_M + TAG_ROWS * PITCH_CELLS / 2
        covered, light = (_mean(table, row, column, wv / CELL_M, wu / CELL_M) for table in _prints())
        return np.asarray(stone * (1 - covered) + light, np.float32)


def _mean(table: Array, row: Values, column: Values, height: Values, width: Values) -> Array:
    """(N,) over rectangles around (row, column), of the array whose summed area table this is: exact, as the sum up to
    a place between cells is linear in both directions."""
    top, bottom, left, right = row - height / 2, row + height / 2, column - width / 2, column + width / 2

    def total(at_row: Values, at_column: Values) -> Array:
        return map_coordinates(table, [at_row, at_column], order=1, mode="nearest")

    sums = total(bottom, right) - total(top, right) - total(bottom, left) + total(top, left)
    return sums / (height * width)


@cache
def _prints() -> tuple[Array, Array]:
    """Summed area tables of all tags, in cells: where there is paper, and its grey levels (0 where there is none)."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    covered = np.zeros((TAG_ROWS * PITCH_CELLS, TAG_COLUMNS * PITCH_CELLS))
    light = covered.copy()
    for tag in range(TAG_ROWS * TAG_COLUMNS):
        row, column = (PITCH_CELLS * place + 2 for place in divmod(tag, TAG_COLUMNS))
        place = np.s_[row : row + 10, column : column + 10]
        covered[place], light[place] = 1.0, PAPER
        bits = cv2.aruco.generateImageMarker(dictionary, tag, 8)
        light[row + 1 : row + 9, column + 1 : column + 9] = np.where(bits > 0, PAPER, INK)
    return np.asarray(cv2.integral(covered), float), np.asarray(cv2.integral(light), float)
