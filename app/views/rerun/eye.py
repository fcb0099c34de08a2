"""The eye of the 3-D view: pure functions of the path that it shows.

In the shared world y points down, so the eye's up is -y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array, Pose

FOV_RAD = np.radians(55.0)
"""Vertical field of view of Rerun."""
ROOM = 1.25
"""Distance of the eye, relative to the least distance at which the whole path is visible."""
MOST_POINTS = 500
"""About the number of points of a path from which the eye's distance is computed."""
UP = np.array([0.0, -1.0, 0.0])
FROM_THE_SIDE_RAD = np.radians(50.0)
"""Angle between the path's main direction and the view, seen from above."""
ELEVATION_RAD = np.radians(32.0)
FOLLOWING_HEIGHT = 0.4
"""Height of the following eye above the camera, relative to its distance behind it."""


@dataclass(frozen=True, eq=False)
class Eye:
    """The eye in Rerun's form; all fields are (3,)."""

    position: Array
    target: Array
    up: Array


def eye_on(path: Array, least: float) -> Eye:
    """Returns the eye that sees the whole path (N, 3) obliquely from above. `least`: extent of the smallest scene that
    is framed."""
    side = _horizontal(_main_direction(path), FROM_THE_SIDE_RAD)
    forward = np.cos(ELEVATION_RAD) * side - np.sin(ELEVATION_RAD) * UP
    return _fitted(path, forward, UP, least)


def eye_above(path: Array, least: float) -> Eye:
    """Returns the eye that sees the whole path as on a map, with its first direction upwards."""
    return _fitted(path, -UP, np.array([0.0, 0.0, 1.0]), least)


def eye_from_side(path: Array, least: float) -> Eye:
    """Returns the eye that sees the whole path from the side, which shows heights."""
    return _fitted(path, _horizontal(_main_direction(path), np.radians(90.0)), UP, least)


def eye_of(world_from_camera: Pose, distance: float) -> Eye:
    """Returns the eye with the view of the camera."""
    forward = world_from_camera.rotation @ np.array([0.0, 0.0, 1.0])
    up = world_from_camera.rotation @ UP
    return Eye(world_from_camera.translation, world_from_camera.translation + distance * forward, up)


def eye_behind(world_from_camera: Pose, distance: float) -> Eye:
    """Returns the eye behind and above the camera, looking in its direction."""
    forward = world_from_camera.rotation @ np.array([0.0, 0.0, 1.0])
    position = world_from_camera.translation + distance * (FOLLOWING_HEIGHT * UP - forward)
    return Eye(position, world_from_camera.translation + 0.5 * distance * forward, UP)


def extent(path: Array) -> float:
    """Returns the longest side of the box around a path (N, 3)."""
    return float(np.ptp(path, axis=0).max()) if len(path) else 0.0


def is_framed(path: Array, framed: Array, least: float) -> bool:
    """Returns whether a view that frames the path `framed` (M, 3) also frames `path` (N, 3): it lies inside, and is not
    much smaller."""
    low, high = _box(framed, least)
    new_low, new_high = _box(path, least)
    room = (ROOM - 1) * float((high - low).max())
    is_inside = bool((new_low >= low - room).all() and (new_high <= high + room).all())
    return is_inside and float((new_high - new_low).max()) > 0.4 * float((high - low).max())


def _fitted(path: Array, forward: Array, up: Array, least: float) -> Eye:
    low, high = _box(path, least)
    centre = (low + high) / 2
    points = path[:: max(1, len(path) // MOST_POINTS)] - centre if len(path) else np.zeros((1, 3))
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    half = np.tan(FOV_RAD / 2)
    sides = np.maximum(np.abs(points @ right), np.abs(points @ above))
    distance = max(float((sides / half - points @ forward).max()), 0.5 * least / half)
    return Eye(centre - ROOM * distance * forward, centre, above)


def _box(path: Array, least: float) -> tuple[Array, Array]:
    """Returns two corners (3,) of the box around a path, whose extent is at least `least`."""
    low, high = (path.min(0), path.max(0)) if len(path) else (np.zeros(3), np.zeros(3))
    missing = np.maximum(least - (high - low), 0.0) / 2
    return low - missing, high + missing


def _main_direction(path: Array) -> Array:
    """Returns the horizontal direction (3,) in which the path extends most, towards its end; forward for a path without
    extent."""
    flat = (path - path.mean(0)) * [1.0, 0.0, 1.0] if len(path) > 1 else np.zeros((1, 3))
    _, extents, directions = np.linalg.svd(flat, full_matrices=False)
    if extents[0] < 1e-9:
        return np.array([0.0, 0.0, 1.0])
    along = directions[0]
    way = float((path[-1] - path[0]) @ along)
    return along if way >= 0 else -along


def _horizontal(direction: Array, angle_rad: float) -> Array:
    """The direction turned to the left, seen from above."""
    x, _, z = direction
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([cos * x - sin * z, 0.0, sin * x + cos * z])
