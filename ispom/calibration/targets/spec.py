"""Targets by their spec: KIND:COLUMNSxROWS:SIZES, in metres."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from ispom.calibration.targets import layouts
from ispom.calibration.targets.target import Target
from ispom.errors import InputError

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
    """The target of a spec such as `chessboard:9x6:0.0242`; InputError says what is wrong and what a right one is."""
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
        sizes = [*sizes, layouts.DISC_SHARE * sizes[0]][:2]
        if 2 * sizes[1] >= sizes[0] * (2**0.5 if kind == "acircles" else 1):
            raise InputError(f"--target {spec}: circles of radius {sizes[1]:g} m touch each other: correct the sizes")
    builders: dict[str, Callable[[], Target]] = {
        "chessboard": lambda: layouts.chessboard(spec, columns, rows, sizes[0]),
        "charuco": lambda: layouts.charuco(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "aprilgrid": lambda: layouts.aprilgrid(spec, columns, rows, sizes[0], sizes[1]),
        "apriltag": lambda: layouts.tag_board(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "aruco": lambda: layouts.tag_board(spec, columns, rows, sizes[0], sizes[1], dictionary),
        "circles": lambda: layouts.circles(spec, columns, rows, sizes[0], sizes[1], asymmetric=False),
        "acircles": lambda: layouts.circles(spec, columns, rows, sizes[0], sizes[1], asymmetric=True),
    }
    if kind == "aprilgrid":
        _dictionary(spec, layouts.APRILGRID, columns * rows)
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
        found = layouts.dictionary_of(name)
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
