"""The text files of a KITTI odometry drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.rows import increasing_times_ns, numbers, read_rows, read_text
from ispom.types import Trajectory


def read_poses(path: Path, as_printed: bool = False) -> list[Pose]:
    """world_from_left per line of 12 numbers, a (3, 4) matrix in row order; its rotation is made orthonormal.

    `as_printed` keeps the rounding of the file's digits, for the same numbers as other programs get from it.
    """
    rows = read_rows(path, 12)
    if not rows:
        return []
    matrices = np.stack([numbers(path, line, words) for line, words in rows]).reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    skewed = abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > 1e-2
    wrong = np.flatnonzero(skewed | (np.linalg.det(rotations) <= 0))
    if len(wrong):
        line = rows[wrong[0]][0]
        raise InputError(f"{path} line {line}: its first three columns are not a rotation: correct that line")
    exact = rotations if as_printed else Rotation.from_matrix(rotations).as_matrix()
    return [Pose(rotation, matrix[:, 3]) for rotation, matrix in zip(exact, matrices, strict=True)]


def poses_text(trajectory: Trajectory) -> str:
    """world_from_FRAME as such lines, and nothing of the times."""
    rows = np.concatenate([trajectory.rotations, trajectory.translations[:, :, None]], axis=2).reshape(-1, 12)
    return "".join(f"{' '.join(f'{v:.12e}' for v in row)}\n" for row in rows)


def read_times(path: Path) -> NDArray[np.int64]:
    """(N,) [ns], increasing, of a file with seconds."""
    return increasing_times_ns(path, read_rows(path, 1))


def read_calibration(path: Path, cameras: tuple[str, ...] = ("P0", "P1")) -> dict[str, Array]:
    """Projection matrices (3, 4) of these cameras by name, of which the first must be there; others are ignored."""
    found = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        name, colon, values = text.partition(":")
        if name.strip() not in cameras:
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
    if cameras[0] not in found:
        raise InputError(f"{path} has no line '{cameras[0]}: ...': give the calibration of this drive")
    return found
