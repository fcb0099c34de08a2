"""The simulated building: a corridor, a flight of stairs up, and a hall; and how one walks through it."""

from __future__ import annotations

import numpy as np

from ispom.simulation.places.city import PAINTS, pick_colour
from ispom.simulation.rendering.materials import Material
from ispom.simulation.rendering.scene import Colour, Scene, SceneBuilder

CORRIDOR_HALF_M, CORRIDOR_M, CEILING_M = 1.3, 16.0, 2.8
STEPS, TREAD_M, RISE_M = 12, 0.3, 0.17
HALL_HALF_M, HALL_M, HALL_CEILING_M = 7.0, 20.0, 5.5
STAIRS_FROM_M = CORRIDOR_M
HALL_FROM_M, HALL_FLOOR_M = CORRIDOR_M + STEPS * TREAD_M, STEPS * RISE_M
_START_M = -4.0
_WALL: Colour = (196, 186, 168)
_FLOOR: Colour = (136, 120, 104)


def build_building(seed: int) -> Scene:
    """Free along z within 1 m of the middle, up to eye level and more above each floor."""
    builder = SceneBuilder(np.random.default_rng([seed, 9]))
    _corridor(builder)
    _stairs(builder)
    _hall(builder)
    return builder.build()


def _wall(builder: SceneBuilder, x: float, z0: float, z1: float, low: float, high: float, material: Material) -> None:
    """Adds a wall along z at the side x, visible from the middle; heights are above the lower floor."""
    side, along = np.sign(x), z1 - z0
    start = np.array([x, -low, z0 if side < 0 else z1])
    builder.face(
        start, np.array([0.0, 0.0, along if side < 0 else -along]), np.array([0.0, low - high, 0.0]), material, _WALL
    )


def _level(builder: SceneBuilder, half: float, z0: float, z1: float, height: float, up: bool, colour: Colour) -> None:
    """Adds a floor, visible from above, or a ceiling, visible from below."""
    corner = np.array([-half if up else half, -height, z0])
    across = np.array([2 * half if up else -2 * half, 0.0, 0.0])
    builder.face(corner, across, np.array([0.0, 0.0, z1 - z0]), Material.PAVING if up else Material.PLASTER, colour)


def _end(builder: SceneBuilder, half: float, z: float, low: float, high: float, material: Material) -> None:
    """Adds a wall across z, visible from smaller z."""
    across, up = np.array([-2 * half, 0.0, 0.0]), np.array([0.0, low - high, 0.0])
    builder.face(np.array([half, -low, z]), across, up, material, _WALL)


def _corridor(builder: SceneBuilder) -> None:
    rng = builder.rng
    _level(builder, CORRIDOR_HALF_M, _START_M, CORRIDOR_M, 0.0, True, _FLOOR)
    _level(builder, CORRIDOR_HALF_M, _START_M, CORRIDOR_M, CEILING_M, False, (205, 203, 196))
    for side in (-1, 1):
        _wall(builder, side * CORRIDOR_HALF_M, _START_M, CORRIDOR_M, 0.0, CEILING_M, Material.BRICK)
        z = _START_M + rng.uniform(0.3, 1.5)
        while z < CORRIDOR_M - 1.2:
            if rng.random() < 0.45:
                builder.box(
                    (side * CORRIDOR_HALF_M, z + 0.5), (0.08, 2.05, 0.95), Material.WOOD, pick_colour(builder, PAINTS)
                )
            else:
                size = rng.uniform(0.5, 0.9)
                what = Material.POSTER if rng.random() < 0.6 else Material.SIGN
                colour, low = pick_colour(builder, PAINTS), rng.uniform(0.9, 1.5)
                builder.box((side * CORRIDOR_HALF_M, z + 0.5), (0.05, size, size), what, colour, bottom=low)
            z += rng.uniform(1.2, 2.0)
    for z in np.arange(_START_M + 1, CORRIDOR_M, 2.5):
        builder.box((0.0, float(z)), (0.9, 0.06, 0.25), Material.PAINT, (222, 222, 216), bottom=CEILING_M - 0.06)


def _stairs(builder: SceneBuilder) -> None:
    high = HALL_FLOOR_M + CEILING_M
    for n in range(STEPS):
        z, height = STAIRS_FROM_M + n * TREAD_M, (n + 1) * RISE_M
        builder.box((0.0, z + TREAD_M / 2), (2 * CORRIDOR_HALF_M, height, TREAD_M), Material.STONE, (150, 146, 140))
    for side in (-1, 1):
        _wall(builder, side * CORRIDOR_HALF_M, CORRIDOR_M, HALL_FROM_M, 0.0, high, Material.BRICK)
        for z in np.arange(CORRIDOR_M + 0.4, HALL_FROM_M, 0.8):
            low = (z - STAIRS_FROM_M) / TREAD_M * RISE_M
            colour = pick_colour(builder, PAINTS)
            place = (side * CORRIDOR_HALF_M, float(z))
            builder.box(place, (0.05, 0.5, 0.4), Material.POSTER, colour, bottom=float(low) + 1.2)
    _end(builder, CORRIDOR_HALF_M, CORRIDOR_M, CEILING_M, high, Material.PLASTER)
    _level(builder, CORRIDOR_HALF_M, CORRIDOR_M, HALL_FROM_M, high, False, (205, 203, 196))


def _hall(builder: SceneBuilder) -> None:
    rng, floor, end = builder.rng, HALL_FLOOR_M, HALL_FROM_M + HALL_M
    _level(builder, HALL_HALF_M, HALL_FROM_M, end, floor, True, (150, 132, 110))
    _level(builder, HALL_HALF_M, HALL_FROM_M, end, floor + HALL_CEILING_M, False, (190, 188, 180))
    _end(builder, HALL_HALF_M, end, floor, floor + HALL_CEILING_M, Material.BRICK)
    for side in (-1, 1):
        _wall(builder, side * HALL_HALF_M, HALL_FROM_M, end, floor, floor + HALL_CEILING_M, Material.STONE)
        for z in np.arange(HALL_FROM_M + 2.5, end - 1, 4.0):
            size, column = (0.5, HALL_CEILING_M, 0.5), (side * 3.6, float(z))
            builder.box(column, size, Material.STONE, (170, 160, 146), bottom=floor)
            what = (Material.POSTER, Material.SIGN, Material.STRIPES)[rng.integers(3)]
            board, colour = (0.06, rng.uniform(0.9, 1.8), rng.uniform(1.0, 2.2)), pick_colour(builder, PAINTS)
            builder.box((side * (HALL_HALF_M - 0.04), float(z) + 2), board, what, colour, bottom=floor + 1.1)
            seat, place = (0.5, 0.45, 1.6), (side * rng.uniform(1.9, 2.8), float(z) + 2)
            builder.box(place, seat, Material.WOOD, pick_colour(builder, PAINTS), bottom=floor)
    for z in np.arange(HALL_FROM_M + 2, end, 3.0):
        lamp = (0.0, float(z))
        builder.box(lamp, (1.6, 0.08, 0.4), Material.PAINT, (224, 224, 220), bottom=floor + HALL_CEILING_M - 0.5)
    for x in np.arange(-6, 6.1, 2.4):
        board, colour = (1.6, rng.uniform(0.8, 1.6), 0.06), pick_colour(builder, PAINTS)
        builder.box((float(x), end - 0.04), board, Material.POSTER, colour, bottom=floor + 1.2)
