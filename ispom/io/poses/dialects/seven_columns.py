"""Poses without times: 7 numbers in a row, `x y z` and a quaternion, or the quaternion and `x y z`; metres,
world_from_FRAME.

The four numbers of unit length are the quaternion. Whether w is its first or its last one is known from a header of the
seven names, or from the first pose, if it is the identity in one of both orders only (with a note). Other files are
refused. Rows are images, in their order; `--times` gives the times. Source: files of several programs,
such as the trajectories of DROID-SLAM and of AirSim.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import (
    PoseDialect,
    TrajectoryFile,
    of_quaternions,
    order_of_quaternions,
    rectangular,
    untimed,
    values_of,
)

COLUMNS, TITLE = 7, "7 columns"


def _recognises(content: PoseContent) -> bool:
    roles = content.roles
    if roles is not None:
        return content.width > 0 and not roles.times and bool(roles.xyz and roles.xyzw) and not roles.geographic
    return content.width == COLUMNS and (content.unit_length(0) or content.unit_length(3))


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, roles, notes = content.path, content.roles, ()
    named = 0 if roles is None else max((*roles.xyz, *roles.xyzw)) + 1
    rows = rectangular(content, max(content.width, named))
    values = values_of(path, rows, 0, len(rows[0][1]))
    if roles is not None:
        positions, xyzw = values[:, roles.xyz] * roles.metres, values[:, roles.xyzw]
    else:
        if content.unit_length(0) and content.unit_length(3):
            raise InputError(
                f"{path} has quaternions in its first or its last four columns: write the names as its first line, "
                "such as 'x y z qx qy qz qw'"
            )
        first = content.unit_length(0)
        positions, quaternions = (values[:, 4:], values[:, :4]) if first else (values[:, :3], values[:, 3:])
        xyzw, notes = order_of_quaternions(content, quaternions, "Q x y z" if first else "x y z Q")
    times, known = untimed(content, len(rows), times_ns)
    trajectory = of_quaternions(content, rows, times, positions, xyzw)
    return TrajectoryFile(path, TITLE, trajectory, known, notes=notes)


DIALECT = PoseDialect(
    "seven_columns",
    TITLE,
    "poses.txt",
    "text",
    "7 numbers in a row of which four are a quaternion, or a header with x, y, z, qx, qy, qz and qw, but no time",
    _recognises,
    _read,
)
