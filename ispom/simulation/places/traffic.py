"""Traffic in the simulated street: vehicles in its lanes, people on its pavements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.simulation.places.city import PAINTS, STREET_FROM_M, STREET_TO_M, add_car, build_city, pick_colour
from ispom.simulation.rendering.materials import Material
from ispom.simulation.rendering.scene import RayCaster, Scene, SceneBuilder

LANE_M = 2.98
"""Distance from the middle of the street: between the parked cars and the flight."""
PAVEMENT_M = (6.2, 6.7)
DRIVING_M_S, WALKING_M_S = (5.0, 10.0), (0.9, 1.7)
_CLOTHES, _SKIN = (64, 68, 84), (188, 144, 116)


@dataclass(frozen=True)
class Mover:
    """Some faces that move along the street; beyond its end they come in again at its start."""

    faces: slice
    """Faces of the scene, which has them at z = 0."""
    start_m: float
    """z at time 0."""
    speed_m_s: float
    """Along z; negative: against it."""

    def along_m(self, time_ns: int) -> float:
        """z at a time."""
        length = STREET_TO_M - STREET_FROM_M
        return STREET_FROM_M + (self.start_m - STREET_FROM_M + self.speed_m_s * time_ns * 1e-9) % length


@dataclass(frozen=True, eq=False)
class Traffic:
    """A scene in which some faces move."""

    scene: Scene
    movers: tuple[Mover, ...]

    def at(self, time_ns: int) -> Scene:
        """Returns the scene at a time."""
        corner = self.scene.corner.copy()
        for mover in self.movers:
            corner[mover.faces, 2] += mover.along_m(time_ns)
        moved = replace(self.scene, corner=corner)
        return replace(moved, caster=RayCaster(moved.triangles))

    def shifts(self, face: NDArray[np.int32], from_ns: int, to_ns: int) -> Array:
        """Returns the displacements (N, 3) [m] of faces (N,) from one time to another; no face is -1."""
        along = np.zeros(len(self.scene.corner) + 1)
        for mover in self.movers:
            along[mover.faces] = mover.along_m(to_ns) - mover.along_m(from_ns)
        return along[face][:, None] * (0.0, 0.0, 1.0)


def city_with_traffic(seed: int, vehicles: int, people: int) -> Traffic:
    """Returns the city of a seed, in which everything else is as without."""
    rng, movers = np.random.default_rng([seed, 6]), list[Mover]()

    def add(builder: SceneBuilder) -> None:
        own, builder.rng = builder.rng, rng
        for n in range(vehicles + people):
            first, way = len(builder.corners), 1 if n % 2 else -1  # one on each side in turn
            if n < vehicles:
                add_car(builder, way * LANE_M, 0.0, 0.0 if way > 0 else np.pi)
                speed = rng.uniform(*DRIVING_M_S)
            else:
                _person(builder, way * rng.uniform(*PAVEMENT_M))
                speed = rng.uniform(*WALKING_M_S) * rng.choice([-1, 1])
            faces = slice(first, len(builder.corners))
            movers.append(Mover(faces, float(rng.uniform(STREET_FROM_M, STREET_TO_M)), float(way * speed)))
        builder.rng = own

    scene = build_city(seed, add)
    return Traffic(scene, tuple(movers))


def _person(builder: SceneBuilder, x: float) -> None:
    legs, body = builder.rng.uniform(0.75, 0.9), builder.rng.uniform(0.6, 0.7)
    for side in (-0.1, 0.1):
        builder.box((x + side, 0.0), (0.15, legs, 0.2), Material.WOOD, _CLOTHES)
    builder.box((x, 0.0), (0.45, body, 0.26), Material.STRIPES, pick_colour(builder, PAINTS), bottom=legs)
    builder.box((x, 0.0), (0.19, 0.25, 0.21), Material.PLASTER, _SKIN, bottom=legs + body)
