"""Maps of tags whose places were surveyed: a YAML file with the pose, or the four corners, of each tag.

    tags:
      0: {position: [1.2, 0.0, 3.4], xyzw: [0, 0, 0, 1]}     # world_from_tag
      7: {corners: [[0, 0, 2], [0.16, 0, 2], [0.16, 0.16, 2], [0, 0.16, 2]]}

Lengths are metres. The tag's axes are x to its right, y down and z into it, as one sees it upright; its origin is the
centre of its black square. Corners are those of the black square, clockwise from the top left as one sees it upright: a
square that begins at another corner, or goes round the other way, is a square, too, and stands turned in the world.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.mapping import finite_numbers, read_mapping
from ispom.solvers.rigid import horn

MAX_TAGS = 1000
"""Largest number of tags of a map: the largest dictionary has 2320, a building some hundred."""
MAX_OFF = 0.05
"""Largest distance of a surveyed corner from that of a square of the given side, relative to the side. Corners that
somebody measured are right to a few percent; a wrong side, or corners in another order, are off by tens of percent."""
UNIT_TOLERANCE = 0.01
"""Largest deviation of a quaternion's norm from 1: what rounding to two digits leaves."""


def read_tag_map(path: Path, corners: Array) -> dict[int, Pose]:
    """Returns world_from_tag by number. `corners` (4, 3) are those of a tag in its own frame [m].

    Raises InputError where the file is missing, malformed, or contradicts the side of the tags.
    """
    content = read_mapping(path)
    tags = content.get("tags")
    if content.keys() != {"tags"} or not isinstance(tags, dict) or not tags:
        raise InputError(f"{path} is no map of tags: give one with an entry `tags`, the place of each by its number")
    if len(tags) > MAX_TAGS:
        raise InputError(f"{path} holds {len(tags)} tags, more than {MAX_TAGS}: give a map of fewer")
    for number in tags:
        if not isinstance(number, int) or isinstance(number, bool) or number < 0:
            raise InputError(f"{path}: {str(number)[:40]!r} is no number of a tag: correct it")
    return {number: _pose(path, f"tag {number}", value, corners) for number, value in tags.items()}


def _pose(path: Path, where: str, value: Any, corners: Array) -> Pose:
    names = value.keys() if isinstance(value, dict) else set()
    if names == {"position", "xyzw"}:
        xyzw = np.array(finite_numbers(path, f"{where}: xyzw", value["xyzw"], 4))
        if abs(np.linalg.norm(xyzw) - 1) > UNIT_TOLERANCE:
            raise InputError(f"{path}: {where}: xyzw has the norm {np.linalg.norm(xyzw):.3g}, not 1: correct it")
        return Pose.from_xyzw(xyzw, np.array(finite_numbers(path, f"{where}: position", value["position"], 3)))
    if names == {"corners"}:
        listed = value["corners"]
        if not isinstance(listed, list) or len(listed) != 4:
            raise InputError(f"{path}: {where} needs 4 corners: correct it")
        measured = np.array([finite_numbers(path, f"{where}: corners", corner, 3) for corner in listed])
        return _fitted(path, where, measured, corners)
    raise InputError(f"{path}: {where} needs either position and xyzw, or corners: correct it")


def _fitted(path: Path, where: str, measured: Array, corners: Array) -> Pose:
    """Returns world_from_tag that brings the tag's corners (4, 3) closest to the measured ones (4, 3)."""
    side = float(np.linalg.norm(corners[1] - corners[0]))
    pose = Pose(*horn(corners, measured))
    off = float(np.linalg.norm(pose.apply(corners) - measured, axis=1).max())
    if off > MAX_OFF * side:
        sides = np.linalg.norm(np.roll(measured, -1, axis=0) - measured, axis=1)
        raise InputError(
            f"{path}: the corners of {where} are no square with sides of {side:g} m, in their order (sides "
            f"of {sides.min():.4g} to {sides.max():.4g} m): correct them, or the side"
        )
    return pose
