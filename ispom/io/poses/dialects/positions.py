"""Positions without rotations: `time x y z` in a row, or a header with a time, x, y and z; metres.

Times are seconds, or in a unit in which they are dates. Such are total stations, laser trackers and GNSS receivers.
The errors of rotations, and those in the body, are left out. Source: files of such instruments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.io.pose_table import POSE_COLUMNS, times_in
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions, rectangular, untimed
from ispom.io.poses.dialects import matrices
from ispom.io.rows import numbers

COLUMNS, TITLE = 4, "positions"
MIN_ROWS = 3
"""Least number of rows with four columns and without a header: fewer may be the end of another, truncated file."""


def _recognises(content: PoseContent) -> bool:
    roles = content.roles
    if roles is not None:
        if content.header_fault is not None or (content.spaced and content.width >= POSE_COLUMNS):
            return False  # further columns may be a rotation
        return bool(roles.times and roles.xyz) and not (roles.xyzw or roles.angles or roles.geographic)
    four = content.width == COLUMNS and len(content.sample) >= MIN_ROWS
    steps = np.diff(content.column(0)) if four else np.zeros(1)
    increasing = bool((steps >= 0).all() and (steps > 0).any())
    return increasing and not matrices.DIALECT.recognises(content)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, roles = content.path, content.roles
    columns = (1, 2, 3) if roles is None else roles.xyz
    width = max(content.width, COLUMNS if roles is None else max((*columns, *roles.times)) + 1)
    rows = rectangular(content, width)
    values = np.array([numbers(path, line, [words[i] for i in columns]) for line, words in rows])
    unit, known, stated = "", True, None if roles is None else roles.unit
    if roles is None or roles.times:
        times, unit = times_in(path, rows, (0,) if roles is None else roles.times, stated)
    else:
        times, known = untimed(content, len(rows), times_ns)
    metres = 1.0 if roles is None else roles.metres
    trajectory = of_quaternions(content, rows, times, values * metres, np.tile([0.0, 0, 0, 1], (len(rows), 1)))
    assumed = "" if stated or (roles is None and unit == "s") else unit
    return TrajectoryFile(path, TITLE, trajectory, known, assumed, has_rotations=False)


DIALECT = PoseDialect(
    "positions",
    TITLE,
    "leica.csv",
    "text",
    "4 numbers in a row of which the first increases, or a header with a time, x, y and z",
    _recognises,
    _read,
)
