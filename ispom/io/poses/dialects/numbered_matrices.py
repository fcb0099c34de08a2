"""Matrices with a number or a time before them: 13 or 17 numbers in a row, a (3, 4) or (4, 4) matrix in row order.

The first number is that of the image, where it is whole and increases by small steps (KITTI-360's `poses.txt` and
`cam0_to_world.txt`): `--times` then gives the times of all images. Otherwise it is a time in seconds, or in another
unit in which it is a date. Matrices are world_from_FRAME, in metres; KITTI-360's poses are of the GPS/IMU (x ahead, y
to the right, z down), its cam0_to_world of the left camera. Source: KITTI-360, documentation of the poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import (
    PoseDialect,
    TrajectoryFile,
    counts_images,
    numbered,
    of_matrices,
    rectangular,
    timed,
    values_of,
)
from ispom.io.poses.dialects.matrices import in_row_order

TITLE = "numbered matrices"


def _recognises(content: PoseContent) -> bool:
    return content.width in (13, 17) and content.columns is None and content.roles is None and _is_matrix(content)


def _is_matrix(content: PoseContent) -> bool:
    """Checks the first rows for rotation matrices: EuRoC's files, and others with columns after a pose, have none."""
    values = np.array(content.sample)[:, 1:].reshape(len(content.sample), -1, 4)
    turns = (in_row_order(values) if values.shape[1] == 4 else values)[:, :3, :3]
    return bool(abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() < 0.1)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, rows = content.path, rectangular(content, content.width)
    values = values_of(path, rows, 1, content.width).reshape(len(rows), -1, 4)
    matrices = in_row_order(values) if content.width == 17 else values
    if counts_images(content):
        times, known = numbered(content, rows, times_ns)
        return TrajectoryFile(path, TITLE, of_matrices(path, rows, matrices, times), known, numbered=True)
    times, unit = timed(content, rows)
    return TrajectoryFile(path, TITLE, of_matrices(path, rows, matrices, times), unit="" if unit == "s" else unit)


DIALECT = PoseDialect(
    "numbered_matrices",
    TITLE,
    "poses.txt, cam0_to_world.txt",
    "text",
    "13 or 17 numbers in a row: the number of an image or a time, and a matrix",
    _recognises,
    _read,
)
