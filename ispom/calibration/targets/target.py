"""A planar calibration target as a value: the points that are looked for on it, and what is printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ispom.geometry import Array

Kind = Literal["chessboard", "charuco", "aprilgrid", "tags", "circles", "acircles"]


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A black rectangle along the board's axes."""

    low_m: Array
    """(2,) its top left corner on the board, and (2,) its bottom right one."""
    high_m: Array


@dataclass(frozen=True, eq=False)
class Disc:
    """A black disc."""

    xy_m: Array
    """(2,) its centre on the board."""
    radius_m: float


@dataclass(frozen=True, eq=False)
class Tag:
    """One coded marker of the target."""

    number: int
    """Its id in the dictionary."""
    corners_m: Array
    """(4, 2) on the board, in the order of OpenCV: the first is the top left one of the marker's own image."""
    points: tuple[int, ...]
    """Indices of the target's points that these corners are; empty where the points are others (ChArUco)."""


@dataclass(frozen=True, eq=False)
class Target:
    """A board. Its frame: x right, y down for a viewer, z into it; (0, 0) is the top left of the pattern."""

    spec: str
    """The spec of `parse_target`, such as chessboard:9x6:0.0242."""
    kind: Kind
    columns: int
    """Number of inner corners (chessboard), squares (ChArUco), tags or circles."""
    rows: int
    pitch_m: float
    """Distance of these."""
    xyz_in_board: Array
    """(N, 3) [m] the points; their index is their id in a Detection."""
    size_m: tuple[float, float]
    """(width, height) of the printed pattern, without its white margin."""
    black: tuple[Rectangle | Disc, ...]
    """The printed shapes."""
    tags: tuple[Tag, ...] = ()
    dictionary: str = ""
    """OpenCV's name of the tags' dictionary, without DICT_."""
    border_bits: int = 1
    """Width of the black border of a tag, in its bits."""
    disc_radius_m: float = 0.0
    """Radius of the circles of a grid."""

    def __len__(self) -> int:
        return len(self.xyz_in_board)

    @property
    def tag_side_m(self) -> float:
        """Side of a board's tags; 0 for others."""
        return float(abs(self.tags[0].corners_m[0] - self.tags[0].corners_m[2]).max()) if self.tags else 0.0
