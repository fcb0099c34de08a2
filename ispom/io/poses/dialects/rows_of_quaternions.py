"""Times, positions and quaternions in rows without a header that are in the order of no benchmark; metres,
world_from_FRAME.

8 numbers with commas between them and seconds first (`t, x, y, z` and a quaternion), or 9 whose first two are whole
seconds and nanoseconds. Whether w is the first or the last of the quaternion is known from a header, or from the first
pose, if it is the identity in one of both orders only (with a note). Other files are refused. Source: files of several
programs, such as those of `rosbag` scripts and of Blender.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.pose_table import times_in
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import (
    PoseDialect,
    TrajectoryFile,
    of_quaternions,
    order_of_quaternions,
    rectangular,
    timed,
    values_of,
)

TITLE = "rows of times and quaternions"


def _recognises(content: PoseContent) -> bool:
    if content.columns is not None or content.roles is not None or content.header_fault is not None:
        return False
    if content.width == 9:
        return has_nanoseconds(content) and content.unit_length(5)
    first = content.column(0) if content.sample else np.zeros(0)
    return content.width == 8 and not content.spaced and content.unit_length(4) and bool((first % 1 != 0).any())


def has_nanoseconds(content: PoseContent) -> bool:
    """Checks that the first two columns are whole seconds and the nanoseconds after them."""
    seconds, rest = content.column(0), content.column(1)
    whole = (seconds % 1 == 0).all() and (rest % 1 == 0).all()
    return bool(whole and (np.diff(seconds) >= 0).all() and rest.min() >= 0 and 1e5 <= rest.max() < 1e9)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, rows, pose = content.path, rectangular(content, content.width), content.width - 7
    values = values_of(path, rows, pose, content.width)
    comma = " " if content.spaced else ","
    names = comma.join(["sec", "nsec", "x", "y", "z", "Q"] if pose == 2 else ["timestamp", "x", "y", "z", "Q"])
    xyzw, notes = order_of_quaternions(content, values[:, 3:], names)
    times, unit = times_in(path, rows, (0, 1), "s") if pose == 2 else timed(content, rows)
    trajectory = of_quaternions(content, rows, times, values[:, :3], xyzw)
    return TrajectoryFile(path, TITLE, trajectory, unit="" if unit == "s" else unit, notes=notes)


DIALECT = PoseDialect(
    "rows_of_quaternions",
    TITLE,
    "poses.csv",
    "text",
    "8 numbers with commas between them, seconds first, or 9 numbers that begin with whole seconds and nanoseconds",
    _recognises,
    _read,
)
