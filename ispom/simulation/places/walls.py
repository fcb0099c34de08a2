"""Places of one wall, for degenerate cases: all points in a plane, nothing to track, repetitive texture.

The wall is the plane z = WALL_M, and fills the view of a camera that moves along x at z about 0 and looks at it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.simulation.rendering.materials import Material, Surfaces
from ispom.simulation.rendering.noise import Values
from ispom.simulation.rendering.scene import Scene, SceneBuilder

WALL_M = 6.0
TILE_M = 0.5
"""Period of the repetitive wall, along u and v."""
PLAIN = (150.0, 146.0, 140.0)
"""Colour of the wall without texture."""
Wall = Literal["wall", "blank", "tiles"]


def build_wall(seed: int, kind: Wall) -> Scene:
    """wall: textured; blank: one colour; tiles: every 0.5 m the same."""
    builder = SceneBuilder(np.random.default_rng([seed, 3]))
    corner, along, up = np.array([120.0, 30.0, WALL_M]), np.array([-240.0, 0.0, 0.0]), np.array([0.0, -60.0, 0.0])
    builder.face(corner, along, up, Material.STONE, (168, 152, 132))
    scene = builder.build()
    if kind == "wall":
        return scene
    surfaces = {"blank": Blank, "tiles": Tiled}[kind]
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
