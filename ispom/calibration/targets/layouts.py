"""The boards themselves: where their points and their black shapes are."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from ispom.calibration.targets.target import Disc, Rectangle, Tag, Target
from ispom.geometry import Array

APRILGRID = "APRILTAG_36h11"
APRILGRID_BORDER = 2
"""Kalibr prints its tags with a border of two bits."""
DISC_SHARE = 0.25
"""Radius of a circle, of the distance to the next where no radius is said: as OpenCV's pattern generator."""


def chessboard(spec: str, columns: int, rows: int, square_m: float) -> Target:
    """Of columns x rows inner corners. Corner (0, 0) is between four squares of which the top left one is black."""
    squares = [(x, y) for y in range(rows + 1) for x in range(columns + 1)]
    black = tuple(_square(x * square_m, y * square_m, square_m) for x, y in squares if (x + y) % 2 == 0)
    points = _grid(columns, rows, square_m, square_m)
    size = (columns + 1) * square_m, (rows + 1) * square_m
    return Target(spec, "chessboard", columns, rows, square_m, points, size, black)


def charuco(spec: str, columns: int, rows: int, square_m: float, marker_m: float, dictionary: str) -> Target:
    """Of columns x rows squares, as OpenCV's CharucoBoard: markers in the white squares, numbered row by row."""
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
    return Target(spec, "charuco", columns, rows, square_m, points, size, tuple(black), tuple(tags), dictionary)


def aprilgrid(spec: str, columns: int, rows: int, tag_m: float, spacing: float) -> Target:
    """Kalibr's: tag 0 at the bottom left, black squares of spacing x tag_m where four tags meet.

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
        corners = upright[[2, 3, 0, 1]]  # OpenCV's picture of a 36h11 tag stands upside down on Kalibr's board
        ids = (4 * number + 1, 4 * number, 4 * number + 3, 4 * number + 2)
        points[list(ids), :2] = corners
        tags.append(Tag(number, corners, ids))
        black += marker_shapes(APRILGRID, number, corners, APRILGRID_BORDER)
    black += [_square(x * pitch, y * pitch, gap) for y in range(rows + 1) for x in range(columns + 1)]
    size = columns * pitch + gap, rows * pitch + gap
    return Target(
        spec, "aprilgrid", columns, rows, pitch, points, size, tuple(black), tuple(tags), APRILGRID, APRILGRID_BORDER
    )


def tag_board(spec: str, columns: int, rows: int, tag_m: float, gap_m: float, dictionary: str) -> Target:
    """OpenCV's GridBoard: tag 0 at the top left, numbered row by row; points 4 t to 4 t + 3 clockwise from top left."""
    tags: list[Tag] = []
    black: list[Rectangle | Disc] = []
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        corners = _corners(column * (tag_m + gap_m), row * (tag_m + gap_m), tag_m)
        tags.append(Tag(number, corners, tuple(range(4 * number, 4 * number + 4))))
        black += marker_shapes(dictionary, number, corners, 1)
    points = np.concatenate([np.column_stack([tag.corners_m, np.zeros(4)]) for tag in tags])
    size = columns * (tag_m + gap_m) - gap_m, rows * (tag_m + gap_m) - gap_m
    return Target(spec, "tags", columns, rows, tag_m + gap_m, points, size, tuple(black), tuple(tags), dictionary)


def circles(spec: str, columns: int, rows: int, pitch_m: float, radius_m: float, asymmetric: bool) -> Target:
    """A grid of discs row by row; in an asymmetric one, as OpenCV has it, every second row is moved by half a step of
    2 x pitch_m, and rows are pitch_m apart."""
    if asymmetric:
        xy = np.array([((2 * x + y % 2) * pitch_m, y * pitch_m) for y in range(rows) for x in range(columns)])
    else:
        xy = _grid(columns, rows, pitch_m)[:, :2]
    xy = xy + radius_m
    size = tuple((xy.max(0) + radius_m).tolist())
    black = tuple(Disc(centre, radius_m) for centre in xy)
    points = np.column_stack([xy, np.zeros(len(xy))])
    kind = "acircles" if asymmetric else "circles"
    return Target(spec, kind, columns, rows, pitch_m, points, (size[0], size[1]), black, disc_radius_m=radius_m)


@cache
def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of a name such as APRILTAG_36h11 or 5X5_100; KeyError where it has none."""
    number = getattr(cv2.aruco, f"DICT_{name}", None)
    if number is None:
        raise KeyError(name)
    return cv2.aruco.getPredefinedDictionary(number)


def marker_cells(dictionary: str, number: int, border_bits: int) -> Array:
    """(B, B) of a marker's picture with its border: 0 black, 1 white."""
    found = dictionary_of(dictionary)
    side = found.markerSize + 2 * border_bits
    return np.asarray(cv2.aruco.generateImageMarker(found, number, side, borderBits=border_bits) > 127, float)


def marker_shapes(dictionary: str, number: int, corners_m: Array, border_bits: int) -> list[Rectangle]:
    """The marker's black cells, each run of a row one rectangle."""
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
    """(4, 2) clockwise from the top left."""
    return np.array([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])


def _square(x: float, y: float, side: float) -> Rectangle:
    return Rectangle(np.array([x, y]), np.array([x + side, y + side]))
