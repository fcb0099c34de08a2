"""The text files of a KITTI odometry drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.rows import increasing_times_ns, numbers, read_rows, read_text


def read_poses(path: Path, as_printed: bool = False) -> list[Pose]:
    """world_from_left per line of 12 numbers, a (3, 4) matrix in row order; its rotation is made orthonormal.

    `as_printed` keeps the rounding of the file's digits, for the same numbers as other programs get from it.
    """
    poses = []
    for line, words in read_rows(path, 12):
        matrix = numbers(path, line, words).reshape(3, 4)
        rotation = matrix[:, :3]
        if np.linalg.det(rotation) <= 0 or abs(rotation @ rotation.T - np.eye(3)).max() > 1e-2:
            raise InputError(f"{path} line {line}: its first three columns are not a rotation: correct that line")
        exact = rotation if as_printed else Rotation.from_matrix(rotation).as_matrix()
        poses.append(Pose(exact, matrix[:, 3]))
    return poses


def read_times(path: Path) -> NDArray[np.int64]:
    """(N,) [ns], increasing, of a file with seconds."""
    return increasing_times_ns(path, read_rows(path, 1))


def read_calibration(path: Path) -> dict[str, Array]:
    """Projection matrices (3, 4) by name, P0 and P1; other entries are left out."""
    found = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, colon, values = text.partition(":")
        if name.strip() not in ("P0", "P1"):
            continue
        words = values.split()
        if not colon or len(words) != 12:
            raise InputError(
                f"{path} line {line}: {name.strip()} needs 12 numbers, not {len(words)}: correct that line"
            )
        matrix = numbers(path, line, words).reshape(3, 4)
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise InputError(f"{path} line {line}: the focal length is not positive: correct that line")
        found[name.strip()] = matrix
    if "P0" not in found:
        raise InputError(f"{path} has no line 'P0: ...': give the calibration of this drive")
    return found
