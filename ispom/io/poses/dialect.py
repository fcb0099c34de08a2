"""A dialect as a value: one program's format of poses, how it is recognised, and how it is read."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.pose_table import times_in
from ispom.io.poses.content import PoseContent
from ispom.io.rows import Row, latest, numbers
from ispom.types import FrameName, Trajectory

Kind = Literal["text", "JSON", "binary", "bag"]
ROW_NS = 1_000_000_000
"""Interval [ns] of the times of rows without times."""
MAX_SKEW = 1e-2
"""Largest deviation of R R^T from the identity."""
LISTED = 3
"""Largest number of stretches that a note lists."""
FLIP = np.diag([1.0, -1.0, -1.0])
"""(3, 3) opengl_from_opencv and its inverse: a camera with y up and z backwards, and one with y down and z forward."""


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """A trajectory from a file, and information about the file."""

    path: Path
    format: str
    """Title of the dialect."""
    trajectory: Trajectory
    """world_from_FRAME; only EuRoC's files define FRAME (the body): for the others it is rig."""
    timed: bool = True
    """Whether the times are known; else they are row numbers, or numbers of images as seconds."""
    unit: str = ""
    """Assumed unit of the times, where the file does not define it."""
    notes: tuple[str, ...] = ()
    """Sentences about assumptions that the file does not confirm."""
    images: tuple[str, ...] = ()
    """Names of the images of its poses, in their order, where the file has them."""
    numbered: bool = False
    """Whether rows have numbers of images, of which some may be missing; without `timed` these are seconds."""
    has_rotations: bool = True
    """Whether the file has rotations; if it has positions only, all rotations are the identity."""


@dataclass(frozen=True, eq=False)
class PoseDialect:
    """How the files of a program are recognised and read. Its conventions are in the docstring of its module."""

    name: str
    """Small letters, digits and _."""
    title: str
    """Usual name of the format."""
    files: str
    """Usual names of the files."""
    kind: Kind
    looked_for: str
    """Description of the dialect's signature in a file."""
    recognises: Callable[[PoseContent], bool]
    """Checks for the signature. Must be true for this dialect's files only, unless it has an `order`."""
    read: Callable[[PoseContent, NDArray[np.int64] | None], TrajectoryFile]
    """Reads a file; the times (N,) are those of the rows of a file that has none. Raises InputError that names what is
    missing, wrong or ambiguous."""
    order: int = 0
    """Position among the dialects that are tried only where no other dialect recognises a file."""


def rectangular(content: PoseContent, width: int, at_least: bool = False) -> list[Row]:
    """Returns the rows without the header. Raises InputError for a row that does not have `width` words (with
    `at_least`: that many or more), and for a file without rows."""
    rows = content.data
    for line, words in rows:
        if len(words) != width and not (at_least and len(words) > width):
            raise InputError(f"{content.path} line {line} has {len(words)} columns, not {width}: correct that line")
    if not rows:
        raise InputError(f"{content.path} holds no pose: give a trajectory with one line per pose")
    return rows


def values_of(path: Path, rows: Sequence[Row], first: int, last: int) -> Array:
    """Returns the numbers (N, last - first) in these columns. Raises InputError that names the invalid line."""
    return np.array([numbers(path, line, words[first:last]) for line, words in rows]).reshape(-1, last - first)


def rotations_of(path: Path, places: Sequence[str], matrices: Array) -> Array:
    """Returns the rotations (N, 3, 3) nearest to matrices (N, 3, 3). Raises InputError for a matrix that is not nearly
    a rotation, with its entry of `places`, such as "line 3"."""
    skewed = abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > MAX_SKEW
    wrong = np.flatnonzero(skewed | (np.linalg.det(matrices) <= 0))
    if len(wrong):
        raise InputError(f"{path} {places[wrong[0]]}: its first three columns are not a rotation: correct it")
    return Rotation.from_matrix(matrices).as_matrix() if len(matrices) else matrices


def of_matrices(
    path: Path, rows: Sequence[Row], matrices: Array, times: NDArray[np.int64], frame: FrameName = "rig"
) -> Trajectory:
    """Returns the trajectory of world_from_FRAME matrices (N, 3 or 4, 4) of these rows. Raises InputError for a matrix
    that is not rigid, and for times that decrease."""
    if matrices.shape[1] == 4 and (bad := np.flatnonzero(abs(matrices[:, 3] - (0, 0, 0, 1)).max(axis=1) > 1e-6)).size:
        raise InputError(f"{path} line {rows[bad[0]][0]}: the last row of its matrix is not 0 0 0 1: correct it")
    rotations = rotations_of(path, [f"line {line}" for line, _ in rows], matrices[:, :3, :3])
    xyzw = Rotation.from_matrix(rotations).as_quat()
    return latest(path, list(rows), times, matrices[:, :3, 3], xyzw, frame, every=True)


def untimed(content: PoseContent, count: int, times_ns: NDArray[np.int64] | None) -> tuple[NDArray[np.int64], bool]:
    """Returns the times (N,) of `count` rows without times, and whether they are known. Raises InputError for another
    number of times."""
    if times_ns is None:
        return np.arange(count, dtype=np.int64) * ROW_NS, False
    if len(times_ns) != count:
        raise InputError(f"{content.path} has {count} poses for {len(times_ns)} times: give the times of its rows")
    return times_ns, True


def numbered(
    content: PoseContent, rows: Sequence[Row], times_ns: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], bool]:
    """Returns the times of rows whose first words are numbers of images, and whether they are known.

    `times_ns` are those of all images. Raises InputError for numbers that are not whole and increasing, and for one
    without a time.
    """
    index: list[int] = []
    for line, words in rows:
        whole = re.fullmatch(r"\+?([0-9]{1,9})(?:\.0*)?(?:e\+?0+)?", words[0])
        if whole is None or (index and int(whole[1]) <= index[-1]):
            raise InputError(
                f"{content.path} line {line}: '{words[0][:40]}' is no number of an image that is larger than the one "
                "before: put the lines in order"
            )
        index.append(int(whole[1]))
    if times_ns is None:
        return np.array(index, np.int64) * ROW_NS, False
    if index and index[-1] >= len(times_ns):
        raise InputError(
            f"{content.path} line {rows[-1][0]}: image {index[-1]} is none of the {len(times_ns)} whose times are "
            "given: give those of all images"
        )
    return times_ns[index], True


def counts_images(content: PoseContent) -> bool:
    """Checks that the first column of the sample has increasing whole numbers that are too small to be dates."""
    first = content.column(0)
    whole = bool((first == np.round(first)).all() and first.min() >= 0 and first.max() < 1e8)
    return whole and bool((np.diff(first) > 0).all()) and bool(len(first) < 2 or np.median(np.diff(first)) <= 100)


def timed(content: PoseContent, rows: Sequence[Row], unit: str | None = None) -> tuple[NDArray[np.int64], str]:
    """Returns the times (N,) [ns] in the first words, and their unit, which is inferred from the values where it is
    None. Raises InputError that names the invalid line."""
    return times_in(content.path, list(rows), (0,), unit)


def order_of_quaternions(content: PoseContent, values: Array, header: str) -> tuple[Array, tuple[str, ...]]:
    """Returns quaternions (N, 4) as x, y, z, w, of a file that does not define their order, and a note about the
    reason.

    An order is chosen if the first pose is the identity in that order only, as odometry starts there. Raises InputError
    otherwise, with both headers to choose from: `header` has Q in the place of the quaternion's columns.
    """
    first = np.abs(values[0])
    for name, place, order in (("last", 3, [0, 1, 2, 3]), ("first", 0, [1, 2, 3, 0])):
        if abs(first[place] - 1) <= 1e-6 and first.sum() - first[place] <= 1e-6:
            note = f"{content.path}: w is taken as the {name} of a quaternion: the first pose is then the identity"
            return values[:, order], (note,)
    comma = "," if "," in header else " "
    orders = (comma.join(("qx", "qy", "qz", "qw")), comma.join(("qw", "qx", "qy", "qz")))
    choice = " or ".join(f"'{header.replace('Q', names)}'" for names in orders)
    raise InputError(
        f"{content.path} does not say whether w is the first or the last of a quaternion: write {choice} as its first "
        "line"
    )


def with_pose(content: PoseContent, rows: Sequence[Row], poses: Array) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Returns (N,) which rows have a pose, and a note about the others.

    Motion capture that does not see its body writes zeros, also for the quaternion: `poses` (N, 7).
    """
    good = (poses != 0).any(axis=1)
    if good.all() or not good.any():
        return np.ones(len(rows), bool), ()
    edges = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]]).astype(int)))
    ends = list(zip(edges[::2], edges[1::2] - 1, strict=True))
    places = [
        f"line {rows[a][0]} (time {rows[a][1][0]})"
        if a == b
        else f"lines {rows[a][0]} to {rows[b][0]} (times {rows[a][1][0]} to {rows[b][1][0]})"
        for a, b in ends[:LISTED]
    ]
    more = f" and {len(ends) - LISTED} more stretches" if len(ends) > LISTED else ""
    return good, (f"{content.path}: {', '.join(places)}{more} hold zeros instead of a pose: they are ignored",)


def of_quaternions(
    content: PoseContent, rows: Sequence[Row], times: NDArray[np.int64], positions: Array, xyzw: Array
) -> Trajectory:
    """Returns world_from_rig of all rows. Raises InputError as `latest`."""
    return latest(content.path, list(rows), times, positions, xyzw, "rig", every=True)


def natural(name: str) -> list[tuple[int, str]]:
    """Returns a key that orders names by the numbers in them: 2 before 10."""
    return [(int(part), "") if part.isdigit() and len(part) < 20 else (0, part) for part in re.split(r"([0-9]+)", name)]
