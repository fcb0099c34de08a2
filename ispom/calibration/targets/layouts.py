"""The boards, the positions of their points and black shapes, and their specs: KIND:COLUMNSxROWS:SIZES, in metres."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache

import cv2
import numpy as np

from ispom.calibration.targets.target import Disc, Rectangle, Tag, Target
from ispom.errors import InputError
from ispom.geometry import Array

APRILGRID = "APRILTAG_36h11"
APRILGRID_BORDER = 2
"""Kalibr prints its tags with a border of two bits."""
DISC_SHARE = 0.25
"""Default radius of a circle as a share of the distance to the next, as in OpenCV's pattern generator."""


def chessboard(spec: str, columns: int, rows: int, square_m: float) -> Target:
    """Makes a board of columns x rows inner corners. Corner (0, 0) is between four squares; the top left one is
    black."""
    squares = [(x, y) for y in range(rows + 1) for x in range(columns + 1)]
    black = tuple(_square(x * square_m, y * square_m, square_m) for x, y in squares if (x + y) % 2 == 0)
    points = _grid(columns, rows, square_m, square_m)
    size = (columns + 1) * square_m, (rows + 1) * square_m
    return Target(
        spec=spec,
        kind="chessboard",
        columns=columns,
        rows=rows,
        pitch_m=square_m,
        xyz_in_board=points,
        size_m=size,
        black=black,
    )


def charuco(spec: str, columns: int, rows: int, square_m: float, marker_m: float, dictionary: str) -> Target:
    """Makes a board of columns x rows squares, as OpenCV's CharucoBoard: markers in the white squares, row by row."""
    squares = [(x, y) for y in range(rows) for x in range(columns)]
    black: list[Rectangle | Disc] = [
        _square(x * square_m, y * square_m, square_m) for x, y in squares if (x + y) % 2 == 0
    ]
    gap, tags = (square_m - marker_m) / 2, []
    for number, (x, y) in enumerate(square for square in squares if sum(square) % 2):
        corners = _corners(x * square_m + gap, y * square_m + gap, marker_m)
        tags.append(Tag(number, corners, ()))
        black += marker_shapes(dictionary, number, corners, 1)
    points = _grid(columns - 1, rows - 1, square_m, square_m)
    size = columns * square_m, rows * square_m
    return Target(
        spec=spec,
        kind="charuco",
        columns=columns,
        rows=rows,
        pitch_m=square_m,
        xyz_in_board=points,
        size_m=size,
        black=tuple(black),
        tags=tuple(tags),
        dictionary=dictionary,
    )


def aprilgrid(spec: str, columns: int, rows: int, tag_m: float, spacing: float) -> Target:
    """Makes Kalibr's board: tag 0 at the bottom left, black squares of spacing x tag_m where four tags meet.

    Points 4 t to 4 t + 3 are the bottom left, bottom right, top right and top left corner of tag t, as in Kalibr.
    """
    gap = spacing * tag_m
    pitch = tag_m + gap
    tags: list[Tag] = []
    points = np.zeros((4 * columns * rows, 3))
    black: list[Rectangle | Disc] = []
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        upright = _corners(gap + column * pitch, gap + (rows - 1 - row) * pitch, tag_m)
        corners = upright[[2, 3, 0, 1]]  # OpenCV's image of a 36h11 tag is upside down on Kalibr's board
        ids = (4 * number + 1, 4 * number, 4 * number + 3, 4 * number + 2)
        points[list(ids), :2] = corners
        tags.append(Tag(number, corners, ids))
        black += marker_shapes(APRILGRID, number, corners, APRILGRID_BORDER)
    black += [_square(x * pitch, y * pitch, gap) for y in range(rows + 1) for x in range(columns + 1)]
    size = columns * pitch + gap, rows * pitch + gap
    return Target(
        spec=spec,
        kind="aprilgrid",
        columns=columns,
        rows=rows,
        pitch_m=pitch,
        xyz_in_board=points,
        size_m=size,
        black=tuple(black),
        tags=tuple(tags),
        dictionary=APRILGRID,
        border_bits=APRILGRID_BORDER,
    )


def tag_board(spec: str, columns: int, rows: int, tag_m: float, gap_m: float, dictionary: str) -> Target:
    """Makes OpenCV's GridBoard: tag 0 at the top left, row by row; points 4 t to 4 t + 3 clockwise from top left."""
    tags: list[Tag] = []
    black: list[Rectangle | Disc] = []
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        corners = _corners(column * (tag_m + gap_m), row * (tag_m + gap_m), tag_m)
        tags.append(Tag(number, corners, tuple(range(4 * number, 4 * number + 4))))
        black += marker_shapes(dictionary, number, corners, 1)
    points = np.concatenate([np.column_stack([tag.corners_m, np.zeros(4)]) for tag in tags])
    size = columns * (tag_m + gap_m) - gap_m, rows * (tag_m + gap_m) - gap_m
    return Target(
        spec=spec,
        kind="tags",
        columns=columns,
        rows=rows,
        pitch_m=tag_m + gap_m,
        xyz_in_board=points,
        size_m=size,
        black=tuple(black),
        tags=tuple(tags),
        dictionary=dictionary,
    )


def circles(spec: str, columns: int, rows: int, pitch_m: float, radius_m: float, asymmetric: bool) -> Target:
    """Makes a grid of discs, row by row.

    In an asymmetric one, as in OpenCV, every second row is moved by half a step of 2 x pitch_m, and rows are pitch_m
    apart.
    """
    if asymmetric:
        xy = np.array([((2 * x + y % 2) * pitch_m, y * pitch_m) for y in range(rows) for x in range(columns)])
    else:
        xy = _grid(columns, rows, pitch_m)[:, :2]
    xy = xy + radius_m
    size = tuple((xy.max(0) + radius_m).tolist())
    black = tuple(Disc(centre, radius_m) for centre in xy)
    points = np.column_stack([xy, np.zeros(len(xy))])
    kind = "acircles" if asymmetric else "circles"
    return Target(
        spec=spec,
        kind=kind,
        columns=columns,
        rows=rows,
        pitch_m=pitch_m,
        xyz_in_board=points,
        size_m=(size[0], size[1]),
        black=black,
        disc_radius_m=radius_m,
    )


@cache
def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of a name such as APRILTAG_36h11 or 5X5_100. Raises KeyError where it has none."""
    number = getattr(cv2.aruco, f"DICT_{name}", None)
    if number is None:
        raise KeyError(name)
    return cv2.aruco.getPredefinedDictionary(number)


def marker_cells(dictionary: str, number: int, border_bits: int) -> Array:
    """Returns the image (B, B) of a marker with its border: 0 black, 1 white."""
    found = dictionary_of(dictionary)
    side = found.markerSize + 2 * border_bits
    return np.asarray(cv2.aruco.generateImageMarker(found, number, side, borderBits=border_bits) > 127, float)


def marker_shapes(dictionary: str, number: int, corners_m: Array, border_bits: int) -> list[Rectangle]:
    """Returns the marker's black cells, each run of a row one rectangle."""
    cells = marker_cells(dictionary, number, border_bits)
    side = len(cells)
    right, down = (corners_m[1] - corners_m[0]) / side, (corners_m[3] - corners_m[0]) / side
    out = []
    for y, row in enumerate(cells):
        ends = np.flatnonzero(np.diff(np.concatenate([[1], row, [1]])))
        for start, stop in ends.reshape(-1, 2):
            a = corners_m[0] + start * right + y * down
            ends_m = np.stack([a, a + (stop - start) * right + down])
            out.append(Rectangle(ends_m.min(0), ends_m.max(0)))
    return out


def _grid(columns: int, rows: int, pitch_m: float, start_m: float = 0.0) -> Array:
    """(columns rows, 3) row by row."""
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.stack([start_m + x * pitch_m, start_m + y * pitch_m, np.zeros(len(x))], axis=1)


def _corners(x: float, y: float, side: float) -> Array:
    """Returns corners (4, 2) clockwise from the top left."""
    return np.array([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])


def _square(x: float, y: float, side: float) -> Rectangle:
    return Rectangle(np.array([x, y]), np.array([x + side, y + side]))


FORMS = {
    "chessboard": "chessboard:9x6:0.0242 (inner corners, side of a square)",
    "charuco": "charuco:8x5:0.03:0.022[:4X4_50] (squares, side of a square, side of a marker, dictionary)",
    "aprilgrid": "aprilgrid:6x6:0.088:0.3 (tags, side of a tag, gap as a share of it)",
    "apriltag": "apriltag:4x3:0.05:0.01[:APRILTAG_36h11] (tags, side of a tag, gap, dictionary)",
    "aruco": "aruco:5x7:0.04:0.01[:4X4_50] (tags, side of a tag, gap, dictionary)",
    "circles": "circles:7x5:0.03[:0.0075] (circles, distance, radius)",
    "acircles": "acircles:4x11:0.02[:0.005] (asymmetric circles, half of their distance in a row, radius)",
}
_SIZES = {"chessboard": (1, 1), "charuco": (2, 2), "aprilgrid": (2, 2), "apriltag": (2, 2), "aruco": (2, 2)}
_SIZES |= {"circles": (1, 2), "acircles": (1, 2)}
_DICTIONARIES = {"charuco": "4X4_50", "apriltag": "APRILTAG_36h11", "aruco": "4X4_50"}
_LEAST = {"chessboard": 3, "charuco": 3}
MOST = 60
"""Columns or rows."""
LARGEST_M = 10.0


def parse_target(spec: str) -> Target:
    """Makes the target of a spec such as `chessboard:9x6:0.0242`. Raises InputError with a valid example."""
    kind, *rest = spec.strip().split(":")
    form = FORMS.get(kind)
    if form is None:
        raise InputError(f"--target {spec}: there is no target called '{kind}', give one of {', '.join(FORMS)}")
    if not rest or not (match := re.fullmatch(r"(\d{1,3})[xX](\d{1,3})", rest[0])):
        raise InputError(f"--target {spec}: columns and rows are missing, write it as {form}")
    columns, rows = int(match[1]), int(match[2])
    least = _LEAST.get(kind, 1)
    if not (least <= min(columns, rows) and max(columns, rows) <= MOST and columns * rows >= 4):
        raise InputError(f"--target {spec}: {columns}x{rows} is not from {least} to {MOST} each, write it as {form}")
    dictionary = _DICTIONARIES.get(kind, "")
    fewest, most = _SIZES[kind]
    if dictionary and len(rest) == most + 2:
        dictionary = _dictionary(spec, rest.pop(), columns * rows // (2 if kind == "charuco" else 1))
    elif dictionary:
        _dictionary(spec, dictionary, columns * rows // (2 if kind == "charuco" else 1))
    if not fewest <= len(rest) - 1 <= most:
        raise InputError(f"--target {spec}: its sizes are not as expected, write it as {form}")
    return _made(kind, spec, columns, rows, [_size(spec, word, form) for word in rest[1:]], dictionary)


def _made(kind: str, spec: str, columns: int, rows: int, sizes: list[float], dictionary: str) -> Target:
    if kind == "charuco" and sizes[1] >= sizes[0]:
        raise InputError(f"--target {spec}: markers of {sizes[1]:g} m do not fit in squares of {sizes[0]:g} m")
    if kind in ("circles", "acircles"):
        sizes = [*sizes, DISC_SHARE * sizes[0]][:2]
        if 2 * sizes[1] >= sizes[0] * (2**0.5 if kind == "acircles" else 1):
            raise InputError(f"--target {spec}: circles of radius {sizes[1]:g} m touch each other: correct the sizes")
    builders: dict[str, Callable[[], Target]] = {
        "chessboard": lambda: chessboard(spec, columns, rows, sizes[0]),
        "charuco": lambda: charuco(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "aprilgrid": lambda: aprilgrid(spec, columns, rows, sizes[0], sizes[1]),
        "apriltag": lambda: tag_board(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "aruco": lambda: tag_board(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "circles": lambda: circles(spec, columns, rows, sizes[0], sizes[1], asymmetric=False),
        "acircles": lambda: circles(spec, columns, rows, sizes[0], sizes[1], asymmetric=True),
    }
    if kind == "aprilgrid":
        _dictionary(spec, APRILGRID, columns * rows)
    return builders[kind]()


def _size(spec: str, word: str, form: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not (0 < value <= LARGEST_M):
        raise InputError(f"--target {spec}: '{word}' is not a size up to {LARGEST_M:g} m, write it as {form}")
    return value


def _dictionary(spec: str, name: str, count: int) -> str:
    name = name.removeprefix("DICT_")
    try:
        found = dictionary_of(name)
    except KeyError:
        raise InputError(
            f"--target {spec}: there is no dictionary {name}, give one of OpenCV's, such as 4X4_50, 5X5_100, "
            "6X6_250 or APRILTAG_36h11"
        ) from None
    if len(found.bytesList) < count:
        raise InputError(
            f"--target {spec}: the dictionary {name} has {len(found.bytesList)} markers, the board needs {count}: "
            "give a larger dictionary, or fewer tags"
        )
    return name
