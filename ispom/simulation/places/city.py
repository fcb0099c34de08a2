"""The simulated city: a seeded street between house fronts, with cars, trees, stalls and signs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ispom.simulation.rendering.materials import Material
from ispom.simulation.rendering.scene import Colour, Scene, SceneBuilder

ROAD_HALF_M = 6.0
STREET_FROM_M, STREET_TO_M = -24.0, 84.0
_WALLS: tuple[Colour, ...] = (
    (176, 92, 70), (198, 170, 128), (150, 118, 96), (205, 196, 178), (168, 176, 184), (190, 142, 96), (140, 148, 130),
    (196, 128, 112),
)  # fmt: skip
PAINTS: tuple[Colour, ...] = (
    (170, 40, 38), (36, 70, 132), (200, 198, 190), (52, 92, 62), (212, 164, 48), (78, 80, 88), (120, 52, 96),
    (40, 122, 130),
)  # fmt: skip
_GREEN: Colour = (78, 104, 48)
_BARK: Colour = (104, 82, 62)
_METAL: Colour = (92, 98, 104)
_STONE: Colour = (166, 160, 150)


def build_city(seed: int, more: Callable[[SceneBuilder], None] = lambda _: None) -> Scene:
    """Returns a street along z, 108 m long and 18-22 m wide; |x| < 3.5 m is free up to 4.5 m above ground.

    `more` adds faces after all others, which stay as they are.
    """
    builder = SceneBuilder(np.random.default_rng([seed, 2]))
    _ground(builder)
    line_street(builder, STREET_FROM_M, STREET_TO_M)
    _horizon(builder)
    more(builder)
    return builder.build()


def line_street(builder: SceneBuilder, start_m: float, end_m: float) -> None:
    """Adds the houses and things on both sides of a street along z, from `start_m` to `end_m`."""
    for side in (-1, 1):
        _houses(builder, side, start_m, end_m)
        _kerb_lane(builder, side, start_m, end_m)
        _pavement_lane(builder, side, start_m, end_m)


def pick_colour(builder: SceneBuilder, colours: tuple[Colour, ...]) -> Colour:
    """One of the colours, slightly varied."""
    base = np.array(colours[builder.rng.integers(len(colours))])
    r, g, b = np.clip(base * builder.rng.uniform(0.85, 1.15) + builder.rng.uniform(-10, 10, 3), 15, 235)
    return float(r), float(g), float(b)


def _ground(builder: SceneBuilder) -> None:
    length, half = STREET_TO_M - STREET_FROM_M, ROAD_HALF_M
    along = np.array([0.0, 0.0, length])
    builder.face(
        np.array([-half, 0.0, STREET_FROM_M]), np.array([2 * half, 0.0, 0.0]), along, Material.ROAD, (104, 104, 108)
    )
    for side in (-1, 1):
        middle = (STREET_FROM_M + STREET_TO_M) / 2
        builder.box((side * (half + 0.15), middle), (0.3, 0.15, length), Material.STONE, _STONE)
        builder.box((side * (half + 20.3), middle), (40.0, 0.14, length), Material.PAVING, (158, 148, 138))


def _houses(builder: SceneBuilder, side: int, start_m: float, end_m: float) -> None:
    """Fronts 9-11 m from the middle with gaps between them, through which a second row shows."""
    rng = builder.rng
    z = start_m + rng.uniform(0, 2)
    while z < end_m - 6:
        width, depth, height = rng.uniform(6.5, 12.5), rng.uniform(8, 11), rng.uniform(7.5, 15)
        front, middle = rng.uniform(9, 11), z + width / 2
        style, bay, floor = float(rng.integers(3)), rng.uniform(2.1, 3.1), rng.uniform(2.9, 3.5)
        colour = pick_colour(builder, _WALLS)
        x = side * (front + depth / 2)
        builder.box(
            (x, middle),
            (depth, height, width),
            Material.FACADE,
            colour,
            style,
            bay,
            floor,
            top=Material.ROOF,
            top_colour=(120, 70, 58),
        )
        rim = tuple(0.6 * c + 70 for c in colour)
        builder.box((x, middle), (depth + 0.7, 0.4, width + 0.1), Material.STONE, rim, bottom=height - 0.3)  # type: ignore[arg-type]
        _front_details(builder, side, front, z, width, height)
        builder.box(
            (side * (front + 22 + rng.uniform(0, 6)), middle + rng.uniform(-2, 2)),
            (10.0, rng.uniform(12, 22), rng.uniform(7, 11)),
            Material.FACADE,
            pick_colour(builder, _WALLS),
            float(rng.integers(3)),
            2.6,
            3.2,
        )
        z += width + (rng.uniform(2.5, 5.0) if rng.random() < 0.55 else 0.0)


def _front_details(builder: SceneBuilder, side: int, front: float, z: float, width: float, height: float) -> None:
    """Sign boards, hanging signs, awnings and balconies before one front."""
    rng, board = builder.rng, _between(builder, 2.5, min(5.5, width - 1.5))
    place = z + width / 2 + rng.uniform(-0.5, 0.5) * (width - board - 1)
    builder.box(
        (side * (front - 0.06), place), (0.12, 0.75, board), Material.SIGN, pick_colour(builder, PAINTS), bottom=2.95
    )
    if rng.random() < 0.6:
        reach = rng.uniform(0.8, 1.4)
        builder.box(
            (side * (front - reach / 2), place),
            (reach, 0.12, board * 0.9),
            Material.STRIPES,
            pick_colour(builder, PAINTS),
            bottom=2.6,
        )
    builder.box(
        (side * (front - 0.6), z + rng.uniform(0.4, width - 0.4)),
        (1.1, rng.uniform(0.6, 1.6), 0.14),
        Material.SIGN if rng.random() < 0.5 else Material.POSTER,
        pick_colour(builder, PAINTS),
        bottom=rng.uniform(3.9, 5.0),
    )
    for _ in range(rng.integers(1, 4)):
        at, up = z + rng.uniform(1.2, width - 1.2), rng.uniform(4.4, max(4.5, height - 2.5))
        builder.box((side * (front - 0.4), at), (0.8, 0.14, 1.9), Material.STONE, _STONE, bottom=up)
        builder.box(
            (side * (front - 0.78), at),
            (0.06, 0.85, 1.9),
            Material.WOOD,
            pick_colour(builder, PAINTS),
            bottom=up + 0.14,
        )


def _between(builder: SceneBuilder, low: float, high: float) -> float:
    return float(builder.rng.uniform(low, max(low, high)))


def _kerb_lane(builder: SceneBuilder, side: int, start_m: float, end_m: float) -> None:
    """Parked cars and crates at the edge of the road."""
    rng, z = builder.rng, start_m + 2.0
    while z < end_m - 16:
        if rng.random() < 0.6:
            add_car(builder, side * rng.uniform(4.75, 4.95), z + 2.2, rng.uniform(-0.05, 0.05))
            z += 4.4 + rng.uniform(0.8, 3.5)
        else:
            for _ in range(rng.integers(1, 4)):
                size = rng.uniform(0.45, 0.95, 3)
                builder.box(
                    (side * rng.uniform(4.6, 5.2), z),
                    tuple(size),
                    Material.WOOD,
                    (150, 112, 72),
                    yaw_rad=rng.uniform(-0.5, 0.5),
                )  # type: ignore[arg-type]
                z += 1.25
            z += rng.uniform(0.5, 3.0)


def add_car(builder: SceneBuilder, x: float, z: float, yaw: float) -> None:
    """Adds four boxes and wheels at (x, z), rotated by `yaw` [rad]; x is across."""
    colour = pick_colour(builder, PAINTS)
    length, shape = builder.rng.uniform(3.8, 4.5), builder.rng.uniform(0.5, 0.66)
    forward = np.array([np.sin(yaw), np.cos(yaw)])
    builder.box((x, z), (1.72, 0.62, length), Material.PAINT, colour, bottom=0.3, yaw_rad=yaw)
    cabin = (x - 0.25 * forward[0], z - 0.25 * forward[1])
    builder.box(cabin, (1.5, 0.55, shape * length), Material.CAR, colour, bottom=0.92, yaw_rad=yaw, top=Material.PAINT)
    for along in (-0.31, 0.31):
        wheel = (x + along * length * forward[0], z + along * length * forward[1])
        builder.box(wheel, (1.76, 0.6, 0.62), Material.PAINT, (44, 44, 48), yaw_rad=yaw)


def _pavement_lane(builder: SceneBuilder, side: int, start_m: float, end_m: float) -> None:
    """Trees, lamps, kiosks, poster pillars and planters between kerb and fronts."""
    rng, z = builder.rng, start_m + 3.0
    while z < end_m - 14:
        x, what = side * rng.uniform(6.9, 7.4), rng.random()
        if what < 0.35:
            _tree(builder, x, z)
        elif what < 0.5:
            builder.box((x, z), (0.18, 4.6, 0.18), Material.PAINT, _METAL)
            builder.box((x - side * 0.5, z), (1.3, 0.16, 0.3), Material.PAINT, _METAL, bottom=4.6)
            builder.box((x, z), (0.08, 1.3, 0.7), Material.POSTER, pick_colour(builder, PAINTS), bottom=2.5)
        elif what < 0.65:
            colour, size = pick_colour(builder, PAINTS), (1.5, 2.3, rng.uniform(1.6, 2.4))
            builder.box((x, z), size, Material.WOOD, colour)
            builder.box((x, z), (2.0, 0.14, size[2] + 0.5), Material.STRIPES, colour, bottom=2.3)
            builder.box(
                (x - side * 0.78, z),
                (0.06, 0.5, size[2] - 0.3),
                Material.SIGN,
                pick_colour(builder, PAINTS),
                bottom=1.7,
            )
            z += 1.2
        elif what < 0.8:
            builder.box(
                (x, z),
                (0.9, 2.5, 0.9),
                Material.POSTER,
                pick_colour(builder, PAINTS),
                yaw_rad=rng.uniform(0, 1.5),
                bottom=0.15,
            )
        else:
            length = rng.uniform(1.0, 2.2)
            builder.box((x, z), (0.7, 0.65, length), Material.STONE, _STONE)
            builder.box((x, z), (0.6, rng.uniform(0.3, 0.7), length - 0.1), Material.FOLIAGE, _GREEN, bottom=0.65)
        z += rng.uniform(2.6, 5.0)


def _tree(builder: SceneBuilder, x: float, z: float) -> None:
    rng, trunk = builder.rng, builder.rng.uniform(2.3, 3.0)
    builder.box((x, z), (0.3, trunk + 0.5, 0.3), Material.WOOD, _BARK, yaw_rad=rng.uniform(0, 1.5))
    for _ in range(11):
        size = rng.uniform(0.6, 1.35, 3)
        place = (x + rng.uniform(-0.85, 0.85), z + rng.uniform(-0.9, 0.9))
        builder.box(
            place,
            tuple(size),
            Material.FOLIAGE,
            _GREEN,
            bottom=trunk + rng.uniform(0, 1.6),
            yaw_rad=rng.uniform(0, 1.5),
        )  # type: ignore[arg-type]


def _horizon(builder: SceneBuilder) -> None:
    """Closes the street at both ends, and adds a bridge across it."""
    rng = builder.rng
    colour = pick_colour(builder, _WALLS)
    builder.box((0.0, STREET_TO_M), (26.0, 15.0, 8.0), Material.FACADE, colour, 2.0, 2.9, 3.3)
    builder.box(
        (rng.uniform(-4, 4), STREET_TO_M + 2), (6.0, 26.0, 6.0), Material.FACADE, (188, 178, 160), 2.0, 2.4, 3.6
    )
    builder.box((0.0, STREET_FROM_M - 4), (26.0, 12.0, 8.0), Material.FACADE, colour, 1.0, 2.7, 3.1)
    for x in (-22.0, 22.0):
        builder.box(
            (x, STREET_TO_M + 8),
            (16.0, rng.uniform(12, 20), 8.0),
            Material.FACADE,
            pick_colour(builder, _WALLS),
            1.0,
            2.5,
            3.0,
        )
    bridge = rng.uniform(42, 50)
    builder.box((0.0, bridge), (24.0, 0.5, 2.6), Material.STONE, _STONE, bottom=5.0)
    for z in (bridge - 1.3, bridge + 1.3):
        builder.box((0.0, z), (24.0, 1.0, 0.12), Material.PAINT, pick_colour(builder, PAINTS), bottom=5.5)
    builder.box(
        (rng.uniform(-2, 2), bridge - 1.42), (5.0, 0.9, 0.08), Material.SIGN, pick_colour(builder, PAINTS), bottom=5.5
    )
