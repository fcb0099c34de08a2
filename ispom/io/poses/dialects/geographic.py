"""Tables with latitude and longitude [deg] and perhaps a height [m], named by a header: positions only.

They are made metres east, north and up of the first row, on the ellipsoid WGS 84; without a height it is 0. Angles in
such files have no common convention (yaw from the north or the east, clockwise or not), so that rotations are not
used. Times as in other tables; without times, rows are images. Source: NIMA TR8350.2 (WGS 84).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.pose_table import times_in
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions, rectangular, untimed
from ispom.io.rows import numbers

TITLE = "latitude and longitude"
RADIUS_M, FLATTENING = 6_378_137.0, 1 / 298.257223563
"""Equatorial radius and flattening of WGS 84, as defined in NIMA TR8350.2."""
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)


def _recognises(content: PoseContent) -> bool:
    return content.roles is not None and bool(content.roles.geographic)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, roles = content.path, content.roles
    if roles is None:
        raise InputError(f"{path} has no header: write one")
    width = max(len(content.data[0][1]) if content.data else 0, max((*roles.times, *roles.geographic)) + 1)
    rows = rectangular(content, width)
    values = np.array([numbers(path, line, [words[i] for i in roles.geographic]) for line, words in rows])
    wrong = np.flatnonzero((abs(values[:, 0]) > 90) | (abs(values[:, 1]) > 360))
    if len(wrong):
        raise InputError(f"{path} line {rows[wrong[0]][0]}: it is no latitude and longitude in degrees: correct it")
    unit, known = "", True
    if roles.times:
        times, unit = times_in(path, rows, roles.times, roles.unit)
    else:
        times, known = untimed(content, len(rows), times_ns)
    positions = east_north_up(np.column_stack([values, np.zeros(len(values))])[:, :3])
    xyzw = np.tile([0.0, 0, 0, 1], (len(rows), 1))
    trajectory = of_quaternions(content, rows, times, positions, xyzw)
    note = f"{path}: positions are metres east, north and up of the first row; it has no rotations that are used"
    return TrajectoryFile(path, TITLE, trajectory, known, "" if roles.unit else unit, (note,), has_rotations=False)


def east_north_up(places: Array) -> Array:
    """Returns positions (N, 3) [m] east, north and up of the first of the places (N, 3): latitude and longitude [deg]
    and height [m] on the ellipsoid WGS 84."""
    latitude, longitude, height = np.radians(places[:, 0]), np.radians(places[:, 1]), places[:, 2]
    normal = RADIUS_M / np.sqrt(1 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    up = (normal * (1 - ECCENTRICITY_2) + height) * np.sin(latitude)
    earth = np.column_stack([across * np.cos(longitude), across * np.sin(longitude), up])
    (s, c), (sl, cl) = (np.sin(latitude[0]), np.cos(latitude[0])), (np.sin(longitude[0]), np.cos(longitude[0]))
    turn = np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    return (earth - earth[0]) @ turn.T


DIALECT = PoseDialect(
    "geographic",
    TITLE,
    "gps.csv",
    "text",
    "a header with latitude and longitude",
    _recognises,
    _read,
)
