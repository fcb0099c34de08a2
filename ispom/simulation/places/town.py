"""The simulated town: four streets around a block, with crossings, a park inside, and a route that comes back."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose, so3_exp
from ispom.simulation.places.city import ROAD_HALF_M, line_street
from ispom.simulation.rendering.materials import Material
from ispom.simulation.rendering.scene import Colour, Scene, SceneBuilder

SIDE_M = 132.0
"""Distance of two crossings; the town's corners are at (0, 0) and (SIDE_M, SIDE_M) of x and z."""
CORNER_M = 10.0
"""Radius of the route's corners."""
SPEED_M_S = 6.0
LAP_M = 4 * (SIDE_M - 2 * CORNER_M) + 2 * np.pi * CORNER_M
"""Length of the route until it is back."""
_SET_BACK_M = 26.0
"""Distance from the middle of a crossing to the first house."""
_CORNER_HOUSE: Colour = (172, 150, 120)
_ROAD_ABOVE_M = 0.02


class Placed(SceneBuilder):
    """Puts faces where a street is: given in its frame, z along it."""

    world_from_street: Pose = Pose()

    def face(self, corner: Array, u: Array, v: Array, material: Material, colour: Colour, *more: float) -> None:
        turn = self.world_from_street.rotation
        super().face(self.world_from_street.apply(corner), turn @ u, turn @ v, material, colour, *more)


def streets() -> tuple[Pose, ...]:
    """world_from_street of the four, each from the middle of a crossing along z to that of the next, turning right."""
    corners = np.array([(0, 0), (0, SIDE_M), (SIDE_M, SIDE_M), (SIDE_M, 0)], float)
    turns = [so3_exp(np.array([0, k * np.pi / 2, 0])) for k in range(4)]
    return tuple(Pose(turn, np.array([x, 0, z])) for turn, (x, z) in zip(turns, corners, strict=True))


def build_town(seed: int) -> Scene:
    """Streets of SIDE_M, free up to 4.5 m above ground within 3.5 m of their middle."""
    builder = Placed(np.random.default_rng([seed, 4]))
    far, middle = 4 * SIDE_M, SIDE_M / 2
    ground = np.array([middle - far / 2, 0.0, middle - far / 2])
    builder.face(ground, np.array([far, 0.0, 0.0]), np.array([0.0, 0.0, far]), Material.PAVING, (150, 146, 138))
    for world_from_street in streets():
        builder.world_from_street = world_from_street
        _street(builder)
    builder.world_from_street = Pose()
    return builder.build()


def _street(builder: Placed) -> None:
    """One side of the town: road, crossing at its beginning, houses, and what closes the view at its end."""
    half = ROAD_HALF_M
    across, up = np.array([2 * half, 0.0, 0.0]), -_ROAD_ABOVE_M
    for start, end in ((-half, half), (half, SIDE_M - half)):
        along = np.array([0.0, 0.0, end - start])
        builder.face(np.array([-half, up, start]), across, along, Material.ROAD, (104, 104, 108))
    line_street(builder, _SET_BACK_M, SIDE_M - _SET_BACK_M)
    rng = builder.rng
    # The inner corner, and two beyond the crossing: ahead, and to the left.
    for x, z in ((16.0, SIDE_M - 16.0), (0.0, SIDE_M + 22.0), (-22.0, SIDE_M), (-22.0, SIDE_M + 22.0)):
        size = (rng.uniform(11, 13), rng.uniform(9, 17), rng.uniform(11, 13))
        style, bay, floor = float(rng.integers(3)), rng.uniform(2.2, 3.0), rng.uniform(2.9, 3.4)
        builder.box((x, z), size, Material.FACADE, _CORNER_HOUSE, style, bay, floor)


def on_route(along_m: float) -> Pose:
    """world_from_route: z ahead, at a length [m] from where the first street leaves its crossing."""
    straight, arc = SIDE_M - 2 * CORNER_M, np.pi / 2 * CORNER_M
    number, along = divmod(along_m, straight + arc)
    street = streets()[int(number) % 4]
    if along <= straight:
        return street @ Pose(translation=np.array([0.0, 0.0, CORNER_M + along]))
    angle = (along - straight) / CORNER_M
    place = np.array([CORNER_M * (1 - np.cos(angle)), 0.0, CORNER_M + straight + CORNER_M * np.sin(angle)])
    return street @ Pose(so3_exp(np.array([0.0, angle, 0.0])), place)
