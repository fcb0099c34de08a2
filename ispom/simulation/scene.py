"""A scene of textured rectangles: what to cast rays at, and what the shader must know of each face."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp
from ispom.simulation.caster import RayCaster
from ispom.simulation.materials import Material, Surfaces
from ispom.simulation.noise import Values

Colour = tuple[float, float, float]
SUN = np.array([0.45, -0.75, -0.48])
"""Towards the sun, in the world (y down)."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Rectangular faces in the world (x right, y down, z along the street), ready for ray casting and shading."""

    corner: Array
    """(Q, 3) where u = v = 0 [m]."""
    axes: Array
    """(Q, 3, 3) rows: unit u, unit v, outward normal."""
    light: Values
    """(Q,) brightness from the sun and the sky."""
    surfaces: Surfaces
    caster: RayCaster
    """Face q is triangles 2q and 2q + 1."""

    @property
    def triangles(self) -> NDArray[np.float32]:
        """(2Q, 3, 3) their corners [m]."""
        return _triangles(self.corner, self.axes, np.stack(self.surfaces.size, axis=1))


@dataclass
class SceneBuilder:
    """Collects faces; `build` makes the Scene."""

    rng: np.random.Generator
    corners: list[Array] = field(default_factory=list)
    axes: list[Array] = field(default_factory=list)
    materials: list[int] = field(default_factory=list)
    parameters: list[tuple[float, ...]] = field(default_factory=list)

    def face(self, corner: Array, u: Array, v: Array, material: Material, colour: Colour, *more: float) -> None:
        """A rectangle from a corner along edges u and v [m]; seen from outside u goes right and v up."""
        width, height = float(np.linalg.norm(u)), float(np.linalg.norm(v))
        u, v = u / width, v / height
        self.corners.append(corner)
        self.axes.append(np.stack([u, v, np.cross(u, v)]))
        self.materials.append(int(material))
        self.parameters.append((width, height, *colour, *more, *[0.0] * (3 - len(more))))

    def box(
        self,
        centre_xz: tuple[float, float],
        size: tuple[float, float, float],
        side: Material,
        colour: Colour,
        *more: float,
        bottom: float = 0.0,
        yaw_rad: float = 0.0,
        top: Material | None = None,
        top_colour: Colour | None = None,
    ) -> None:
        """A box of size (x, height, z) [m] standing `bottom` above the ground, turned about the vertical."""
        turn = so3_exp(np.array([0.0, yaw_rad, 0.0]))
        base = np.array([centre_xz[0], -bottom, centre_xz[1]])
        (sx, _, sz), up = size, np.array([0.0, -size[1], 0.0])
        ring = [(-sx / 2, -sz / 2), (sx / 2, -sz / 2), (sx / 2, sz / 2), (-sx / 2, sz / 2)]
        foot = [base + turn @ np.array([x, 0.0, z]) for x, z in ring]
        for a, b in zip(foot, foot[1:] + foot[:1], strict=True):
            self.face(a, b - a, up, side, colour, *more)
        lid = Material.PLASTER if side == Material.FACADE else side
        cap, cap_colour = lid if top is None else top, top_colour or colour
        self.face(foot[0] + up, foot[1] - foot[0], foot[3] - foot[0], cap, cap_colour)
        if bottom > 0:
            self.face(foot[3], foot[2] - foot[3], foot[0] - foot[3], lid, colour)

    def build(self) -> Scene:
        """The scene with every face lit and seeded."""
        corner, axes = np.array(self.corners), np.array(self.axes)
        parameters = np.array(self.parameters)
        triangles = _triangles(corner, axes, parameters[:, :2])
        sun = np.clip(axes[:, 2] @ (SUN / np.linalg.norm(SUN)), 0, 1)
        light = 0.66 + 0.42 * sun - 0.12 * np.clip(axes[:, 2, 1], 0, 1)
        seeds = self.rng.integers(1, 2**31, len(corner))
        surfaces = Surfaces.of(np.array(self.materials), seeds, parameters)
        return Scene(corner, axes, light.astype(np.float32), surfaces, RayCaster(triangles))


def _triangles(corner: Array, axes: Array, size: Array) -> NDArray[np.float32]:
    """(2Q, 3, 3) of faces (Q) with widths and heights (Q, 2)."""
    u, v = axes[:, 0] * size[:, :1], axes[:, 1] * size[:, 1:]
    vertices = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
    return vertices[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3).astype(np.float32)
