"""Tables with a header that names times, positions and quaternions: `timestamp, x, y, z, qx, qy, qz, qw` in any order.

Commas, semicolons, tabs or spaces are between the columns; others are ignored. The header decides the order of the
quaternion, and may have units in brackets or behind the names ([ns], _ms, [mm]); times without one have the unit in
which they are dates, or their intervals usual. Seconds and nanoseconds may have a column each. Poses are
world_from_FRAME. Such are the CSV files of VSLAM-LAB, of `rostopic echo -p`, of Stray Scanner (odometry.csv), of
ISPOM and of spreadsheets. Source: files of these programs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.pose_table import read_pose_table
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile
from ispom.io.poses.dialects import euroc
from ispom.io.trajectories import is_tum


def _recognises(content: PoseContent) -> bool:
    columns = content.columns
    return columns is not None and not is_tum(columns) and not euroc.DIALECT.recognises(content)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    if (columns := content.columns) is None:
        raise InputError(f"{content.path} has no header: write one")
    trajectory, unit = read_pose_table(content.path, columns, "rig", every=True)
    if not len(trajectory):
        raise InputError(f"{content.path} holds no pose: give a trajectory with one line per pose")
    return TrajectoryFile(content.path, "CSV", trajectory, unit="" if columns.unit is not None else unit)


DIALECT = PoseDialect(
    "table",
    "CSV",
    "*.csv, odometry.csv",
    "text",
    "a header with a time, x, y, z, qx, qy, qz and qw",
    _recognises,
    _read,
)
