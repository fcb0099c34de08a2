"""JSON: an object for each pose, one in each line (JSON lines), or in one list: `{"time": ..., "position": {"x": ...},
...}`.

Names are those of the columns of tables, at any depth (`pose.position.x`, `orientation.w`, `header.stamp.sec`); lists
of three are x, y, z. A list of four is a quaternion of unknown order, which counts only where the first pose is the
identity in one order, with a note. Instead of both, a matrix of 4 x 4 or 3 x 4 may be there, called
`world_from_camera`, `camera_to_world`, `c2w`, `T_wc`, or, with a note, `pose`, `transform` or `matrix`:
world_from_FRAME; `world_to_camera`, `w2c`, `T_cw` and `extrinsics` are inverted. Metres; times as in tables. Source:
files of several programs.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.pose_table import Roles, roles_of, times_in
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import (
    PoseDialect,
    TrajectoryFile,
    of_quaternions,
    order_of_quaternions,
    rotations_of,
    untimed,
)
from ispom.io.poses.dialects import nerfstudio
from ispom.io.poses.dialects.nerfstudio import matrix_values
from ispom.io.rows import Row, numbers

TITLE = "JSON objects"
FORWARD = {"world_from_camera", "camera_to_world", "cameratoworld", "cam2world", "cam_to_world", "c2w", "t_wc"}
FORWARD |= {"t_world_camera", "world_from_body", "t_wb", "twc"}
INVERSE = {
    "world_to_camera",
    "worldtocamera",
    "world2cam",
    "camera_from_world",
    "w2c",
    "t_cw",
    "extrinsics",
    "extrinsic",
}
INVERSE |= {"t_camera_world", "tcw"}
UNDIRECTED = {"pose", "transform", "matrix", "transformation", "t", "transform_matrix", "pose_matrix"}
_MATRICES = FORWARD | INVERSE | UNDIRECTED
MAX_NAMES = 200
"""Largest number of values of an object, with those of nested objects."""


def _objects(content: PoseContent) -> list[tuple[int, Any]]:
    found = content.objects
    if len(found) == 1 and found[0][0] == 0:
        whole = found[0][1]
        if isinstance(whole, dict):  # of one line, or with the list inside
            lists = [value for value in whole.values() if isinstance(value, list) and value]
            inner = [value for value in lists if all(isinstance(each, dict) for each in value)]
            whole = inner[0] if len(inner) == 1 else [whole]
        return [(n, value) for n, value in enumerate(whole, 1)]
    return found


def _flat(where: str, values: dict[str, Any], prefix: str = "") -> dict[str, str]:
    """Returns the words of an object by names with dots; lists of three are x, y and z, those of four q0 to q3."""
    found: dict[str, str] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found |= _flat(where, value, f"{name}.")
        elif isinstance(value, list) and len(value) in (3, 4) and all(isinstance(each, str) for each in value):
            letters = "xyz" if len(value) == 3 else "0123"
            found |= {f"{name}.{letter}": each for letter, each in zip(letters, value, strict=True)}
        elif isinstance(value, str):
            found[name] = value
        if len(found) > MAX_NAMES:
            raise InputError(f"{where} has more than {MAX_NAMES} values: it is no pose")
    return found


def _matrix_key(values: dict[str, Any]) -> str:
    """Returns the name of the matrix of a pose; "" without one."""
    return next((key for key, v in values.items() if key.lower() in _MATRICES and isinstance(v, list)), "")


def _list_of_four(flat: dict[str, str]) -> str:
    """Returns the name of a quaternion that is a list; "" without one."""
    names = [re.sub(r"\.[0-9]$", "", key) for key in flat if key.endswith(".3")]
    return names[0] if len(names) == 1 else ""


def _recognises(content: PoseContent) -> bool:
    objects = _objects(content) if content.objects and not nerfstudio.DIALECT.recognises(content) else []
    if not objects or not isinstance(objects[0][1], dict):
        return False
    values = objects[0][1]
    if _matrix_key(values):
        return True
    flat = _flat(str(content.path), values)
    roles = roles_of(list(flat))
    return roles is not None and bool(roles.xyz) and bool(roles.xyzw or _list_of_four(flat))


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, objects = content.path, _objects(content)
    flats: list[dict[str, str]] = []
    for n, values in objects:
        if not isinstance(values, dict):
            raise InputError(f"{path}: object {n} is no object with names: correct it")
        flats.append(_flat(f"{path}: object {n}", values))
    key = _matrix_key(objects[0][1])
    names = list(flats[0])
    roles = roles_of(names)
    notes: tuple[str, ...] = ()
    rows = [(n, [flat.get(name, "") for name in names]) for (n, _), flat in zip(objects, flats, strict=True)]
    if key:
        matrices = np.array([matrix_values(f"{path}: object {n}: {key}", v.get(key)) for n, v in objects])
        matrices = matrices.reshape(-1, 3, 4)
        rotations = rotations_of(path, [f"object {n}" for n, _ in objects], matrices[:, :, :3])
        positions = matrices[:, :, 3]
        if key.lower() in INVERSE:
            rotations = rotations.transpose(0, 2, 1)
            positions = -np.einsum("nij,nj->ni", rotations, positions)
        elif key.lower() in UNDIRECTED:
            notes = (f"{path}: {key} is taken as world_from_camera, as the file does not say its direction",)
        xyzw = Rotation.from_matrix(rotations).as_quat()
    else:
        if roles is None or not roles.xyz:
            raise InputError(f"{path}: its objects have no x, y and z: add them")
        positions = _values(content, rows, roles.xyz) * roles.metres
        if roles.xyzw:
            xyzw = _values(content, rows, roles.xyzw)
        else:
            called = _list_of_four(flats[0])
            four = _values(content, rows, tuple(names.index(f"{called}.{i}") for i in range(4)))
            xyzw, notes = order_of_quaternions(content, four, '{"timestamp": ..., "orientation": {Q}}')
    times, unit, known = _times(content, rows, roles, times_ns)
    trajectory = of_quaternions(content, rows, times, positions, xyzw)
    return TrajectoryFile(path, TITLE, trajectory, known, unit, notes)


def _values(content: PoseContent, rows: list[Row], columns: tuple[int, ...]) -> Array:
    return np.array([numbers(content.path, line, [words[i] for i in columns]) for line, words in rows])


def _times(
    content: PoseContent, rows: list[Row], roles: Roles | None, times_ns: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], str, bool]:
    if roles is None or not roles.times:
        times, known = untimed(content, len(rows), times_ns)
        return times, "", known
    times, unit = times_in(content.path, rows, roles.times, roles.unit)
    return times, "" if roles.unit else unit, True


DIALECT = PoseDialect(
    "json_objects",
    TITLE,
    "poses.jsonl, poses.json",
    "JSON",
    "objects with a time, a position and an orientation, or a matrix",
    _recognises,
    _read,
)
