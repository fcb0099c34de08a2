"""Matrices of 4 x 4: 16 numbers in a row, or four rows of four numbers for each pose; world_from_FRAME, metres, no
times.

Replica's and NICE-SLAM's `traj.txt` and others have row order (0 0 0 1 is last); where 0 0 0 1 is each matrix's last
column instead, it is in column order, as OpenGL and Unity write it. Commas or spaces are between the numbers. Rows
are images, in their order. Axes are those of the program: Replica's camera has x to the right, y down and z ahead.
Source: NICE-SLAM, src/utils/datasets.py; ScanNet, README of the data.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_matrices, rectangular, untimed, values_of

LAST_ROW = np.array([0.0, 0, 0, 1])


def _recognises(content: PoseContent) -> bool:
    if content.width == 16:
        return content.columns is None and content.roles is None
    return content.width == 4 and content.roles is None and len(content.sample) >= 4 and _is_last(content.sample[3])


def _is_last(row: list[float]) -> bool:
    return bool((np.abs(np.array(row) - LAST_ROW) <= 1e-6).all())


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, rows = content.path, rectangular(content, content.width)
    values = values_of(path, rows, 0, content.width)
    if content.width == 4 and len(rows) % 4:
        raise InputError(f"{path} has {len(rows)} rows, and each pose is four of them: restore the file")
    rows = rows if content.width == 16 else rows[::4]
    matrices = in_row_order(values.reshape(-1, 4, 4))
    times, known = untimed(content, len(rows), times_ns)
    return TrajectoryFile(path, "4 x 4 matrices", of_matrices(path, rows, matrices, times), known)


def in_row_order(matrices: Array) -> Array:
    """Returns matrices (N, 4, 4) with 0 0 0 1 as last row; transposes those that have it as last column."""
    if np.abs(matrices[:, 3] - LAST_ROW).max() > 1e-6 and np.abs(matrices[:, :, 3] - LAST_ROW).max() <= 1e-6:
        return matrices.transpose(0, 2, 1)
    return matrices


DIALECT = PoseDialect(
    "matrices",
    "4 x 4 matrices",
    "traj.txt, pose.txt",
    "text",
    "16 numbers in a row, or rows of 4 whose fourth is 0 0 0 1",
    _recognises,
    _read,
)
