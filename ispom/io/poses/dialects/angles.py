"""Tables with roll, pitch and yaw: `timestamp, x, y, z, roll, pitch, yaw`, named by a header; metres,
world_from_FRAME.

The rotation is Rz(yaw) Ry(pitch) Rx(roll), about the axes of the body in the order yaw, pitch, roll (aviation, ROS).
Units are in the header (roll [deg], yaw_rad), or follow from the values: angles above 2 pi are in degrees, those with
jumps of about 2 pi in radians. Other files are refused, since small angles may be in either unit. Times as in other
tables; without times, rows are images. Source: ROS REP 103.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.pose_table import times_in
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions, rectangular, untimed
from ispom.io.rows import numbers

TITLE = "roll, pitch and yaw"
JUMP_TOLERANCE_RAD = 0.1
"""Largest deviation of a jump from 2 pi [rad]."""


def _recognises(content: PoseContent) -> bool:
    roles = content.roles
    return roles is not None and bool(roles.xyz and roles.angles) and not roles.xyzw and not roles.geographic


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, roles = content.path, content.roles
    if roles is None:
        raise InputError(f"{path} has no header: write one")
    width = max(len(content.data[0][1]) if content.data else 0, max((*roles.times, *roles.xyz, *roles.angles)) + 1)
    rows = rectangular(content, width)
    values = np.array([numbers(path, line, [words[i] for i in (*roles.xyz, *roles.angles)]) for line, words in rows])
    in_degrees, notes = _in_degrees(content, values[:, 3:], roles.angle_unit)
    rotation = Rotation.from_euler("ZYX", values[:, [5, 4, 3]], degrees=in_degrees)
    unit, known = "", True
    if roles.times:
        times, unit = times_in(path, rows, roles.times, roles.unit)
    else:
        times, known = untimed(content, len(rows), times_ns)
    trajectory = of_quaternions(content, rows, times, values[:, :3] * roles.metres, rotation.as_quat())
    return TrajectoryFile(path, TITLE, trajectory, known, "" if roles.unit else unit, notes)


def _in_degrees(content: PoseContent, angles: Array, unit: str | None) -> tuple[bool, tuple[str, ...]]:
    path = content.path
    if unit is not None:
        return unit == "deg", ()
    if np.abs(angles).max() > 2 * np.pi + JUMP_TOLERANCE_RAD:
        return True, (f"{path}: roll, pitch and yaw are in degrees: some are larger than 2 pi",)
    jumps = np.abs(np.diff(angles, axis=0))
    if (np.abs(jumps - 2 * np.pi) < JUMP_TOLERANCE_RAD).any():
        return False, (f"{path}: roll, pitch and yaw are in radians: they jump by 2 pi",)
    raise InputError(
        f"{path} does not say whether roll, pitch and yaw are in radians or degrees, and its values may be both: call "
        "the columns roll_rad, pitch_rad and yaw_rad, or roll_deg, pitch_deg and yaw_deg"
    )


DIALECT = PoseDialect(
    "angles",
    TITLE,
    "poses.csv",
    "text",
    "a header with x, y, z, roll, pitch and yaw",
    _recognises,
    _read,
)
