"""KITTI's poses: 12 numbers in a row, a (3, 4) matrix in row order, metres, world_from_left.

x is to the right, y down, z ahead. The file has no times: rows are images, in their order; `--times` gives them.
KITTI's digits are kept as they are printed. Source: KITTI odometry benchmark, development kit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.kitti import read_poses
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, untimed
from ispom.types import Trajectory

COLUMNS = 12
"""Number of columns in KITTI's format: a (3, 4) matrix."""


def _recognises(content: PoseContent) -> bool:
    return content.width == COLUMNS and content.spaced and content.columns is None


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    poses = read_poses(content.path, as_printed=True)
    times, known = untimed(content, len(poses), times_ns)
    trajectory = Trajectory(times, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    return TrajectoryFile(content.path, "KITTI", trajectory, known)


DIALECT = PoseDialect(
    "kitti", "KITTI", "poses/00.txt", "text", "12 numbers in a row, with spaces between them", _recognises, _read
)
