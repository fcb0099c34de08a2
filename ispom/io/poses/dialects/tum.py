"""TUM's text: `timestamp tx ty tz qx qy qz qw` in seconds and metres, spaces or tabs between them, w last,
world_from_FRAME.

Times in milli-, micro- or nanoseconds, as ORB-SLAM3 and others write them, are recognised where they are dates in
that unit, or whole numbers at an interval that is usual in it only. The last four numbers are a quaternion of length
1; where the first four after the time are, it is another dialect. Seconds and nanoseconds without leading zeros
(100.33333333 for 100.033333333) are recognised by their intervals, with a note. Rows whose seven numbers are zero, as
motion capture writes where it does not see its body, are ignored with a note. Axes are those of the program: TUM's
own truth is that of a camera with x to the right, y down and z ahead. Source: TUM RGB-D benchmark, file formats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.pose_table import unpadded_nanoseconds
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions, rectangular, timed, values_of, with_pose
from ispom.io.trajectories import is_tum

COLUMNS = 8
"""Number of columns in TUM's format."""


def _recognises(content: PoseContent) -> bool:
    if content.columns is not None:
        return is_tum(content.columns)
    rotation_first = content.unit_length(1) and not content.unit_length(4)
    return content.width == COLUMNS and content.spaced and not rotation_first


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    rows = rectangular(content, COLUMNS)
    notes: tuple[str, ...] = ()
    unpadded = unpadded_nanoseconds([words[0] for _, words in rows])
    if unpadded is None:
        times, unit = timed(content, rows, None if content.columns is None else content.columns.unit)
    else:
        order = np.argsort(unpadded, kind="stable")
        times, unit, rows = unpadded[order], "s", [rows[i] for i in order]
        notes = (f"{content.path}: times are seconds and nanoseconds without leading zeros: they are even then",)
    values = values_of(content.path, rows, 1, COLUMNS)
    good, ignored = with_pose(content, rows, values)
    rows = [row for row, is_pose in zip(rows, good, strict=True) if is_pose]
    trajectory = of_quaternions(content, rows, times[good], values[good, :3], values[good, 3:])
    notes = (*notes, *ignored)
    return TrajectoryFile(content.path, "TUM", trajectory, unit="" if unit == "s" else unit, notes=notes)


DIALECT = PoseDialect(
    "tum",
    "TUM",
    "*.tum, groundtruth.txt, CameraTrajectory.txt",
    "text",
    "8 numbers in a row, with spaces between them, of which the last four are a quaternion",
    _recognises,
    _read,
)
