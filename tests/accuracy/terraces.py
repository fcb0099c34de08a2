"""Streets of equal houses, for the bench of loops: what is seen from one place is seen from many others."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ispom.geometry import Array, Pose
from ispom.simulation.places.city import ROAD_HALF_M, line_street
from ispom.simulation.places.town import SIDE_M, Placed, streets
from ispom.simulation.rendering.materials import Material, Surfaces
from ispom.simulation.rendering.scene import Colour, Scene

ALIKE_M = 20.0
"""Period of a street: houses, and what stands before them, repeat after this length."""
FROM_M, COUNT = 26.0, 4
"""Distance from the middle of a crossing to the first period, and the number of periods of a street."""
_UP_M = 0.02
_GROUND: Colour = (150, 146, 138)
_ROAD: Colour = (104, 104, 108)


@dataclass
class Alike(Placed):
    """Faces keep a seed of their own, so that they can look the same in several places."""

    seeds: list[int] = field(default_factory=list)
    seeded: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def face(self, corner: Array, u: Array, v: Array, material: Material, colour: Colour, *more: float) -> None:
        super().face(corner, u, v, material, colour, *more)
        self.seeds.append(int(self.seeded.integers(1, 2**31)))

    def begun(self, seed: list[int]) -> None:
        """What follows is the same for the same seed."""
        self.rng, self.seeded = np.random.default_rng([*seed, 0]), np.random.default_rng([*seed, 1])

    def build(self) -> Scene:
        surfaces = Surfaces.of(np.array(self.materials), np.array(self.seeds), np.array(self.parameters))
        return replace(super().build(), surfaces=surfaces)


def build_terraces(seed: int) -> Scene:
    """The streets of sim:town, with equal houses; only ground and road differ from place to place."""
    builder = Alike(np.random.default_rng(seed))
    builder.begun([seed, 0])
    far, low = np.eye(3) * 4 * SIDE_M, (1 - 4) / 2 * SIDE_M
    builder.face(np.array([low, 0.0, low]), far[0], far[2], Material.PAVING, _GROUND)
    for number, street in enumerate(streets()):
        builder.world_from_street = street
        builder.begun([seed, 1, number])
        half = ROAD_HALF_M
        across, along = np.array([2 * half, 0.0, 0.0]), np.array([0.0, 0.0, SIDE_M])
        builder.face(np.array([-half, -_UP_M, -half]), across, along, Material.ROAD, _ROAD)
        for k in range(COUNT):
            builder.begun([seed, 2])
            line_street(builder, FROM_M + k * ALIKE_M, FROM_M + (k + 1) * ALIKE_M)
        builder.begun([seed, 3])
        for x, z in ((16.0, SIDE_M - 16.0), (0.0, SIDE_M + 22.0), (-22.0, SIDE_M)):
            builder.box((x, z), (12.0, 12.0, 12.0), Material.FACADE, (172, 150, 120), 1.0, 2.6, 3.2)
    builder.world_from_street = Pose()
    return builder.build()
