"""EuRoC's CSV: `timestamp [ns], p_x, p_y, p_z, q_w, q_x, q_y, q_z[, ...]`, w first, metres, world_from_body.

Times are whole nanoseconds; velocities and biases behind the pose are ignored. The body is the IMU. Commas or
semicolons are between the numbers; where a header names the columns in another order, it is a CSV file with a header.
Source: EuRoC MAV datasets, state_groundtruth_estimate0/data.csv.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.pose_table import read_pose_table
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile
from ispom.io.trajectories import OWN

MIN_COLUMNS, LOOKED_AT = 8, 16
DATES_NS = 1e12
"""Larger times with a decimal point are dates in nanoseconds, as programs write whole numbers that were floats."""


def _recognises(content: PoseContent) -> bool:
    if content.columns is not None:
        return content.columns.order == OWN.order and content.columns.unit in (None, "ns")
    if content.header_fault is not None or content.spaced or content.width < MIN_COLUMNS or content.roles is not None:
        return False
    whole = content.column(0)
    if any("." in words[0] for _, words in content.data[:LOOKED_AT]) and whole.max() < DATES_NS:
        return False  # seconds
    return bool((whole == np.round(whole)).all()) and not (content.unit_length(5) and not content.unit_length(4))


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    columns = content.columns or OWN
    trajectory, unit = read_pose_table(content.path, columns, "body", every=True)
    return TrajectoryFile(content.path, "EuRoC", trajectory, unit="" if unit == "ns" else unit)


DIALECT = PoseDialect(
    "euroc",
    "EuRoC",
    "data.csv",
    "text",
    "at least 8 numbers in a row, with commas between them, whole nanoseconds first",
    _recognises,
    _read,
)
