"""transforms.json of nerfstudio, instant-ngp, Polycam and Record3D's converters: `frames` with `file_path` and
`transform_matrix`.

Matrices are world_from_camera of a camera with x to the right, y up and z backwards (OpenGL); they are turned here to
y down and z ahead. The unit is that of the file, `applied_transform` and `applied_scale` stay applied. Frames are
taken in the order of their names, 2 before 10, and have no times, unless each has a `timestamp` [s]; `--times` gives
those of these images. Source: nerfstudio, docs/quickstart/data_conventions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import FLIP, PoseDialect, TrajectoryFile, natural, rotations_of, untimed
from ispom.io.values import number, time_ns
from ispom.types import Trajectory

TITLE, MATRIX, NAME, TIME = "nerfstudio", "transform_matrix", "file_path", "timestamp"
MAX_FRAMES = 100_000
"""Largest number of frames of a file."""


def _frames(content: PoseContent) -> list[Any]:
    values = content.objects[0][1] if content.objects and content.objects[0][0] == 0 else None
    frames = values.get("frames") if isinstance(values, dict) else None
    return frames if isinstance(frames, list) else []


def _recognises(content: PoseContent) -> bool:
    frames = _frames(content)
    return bool(frames) and isinstance(frames[0], dict) and MATRIX in frames[0]


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, frames = content.path, _frames(content)
    if len(frames) > MAX_FRAMES:
        raise InputError(f"{path} has more than {MAX_FRAMES} frames: give fewer")
    matrices: dict[str, list[float]] = {}
    for n, frame in enumerate(frames):
        where = f"{path}: frames[{n}]"
        if not isinstance(frame, dict) or not isinstance(frame.get(NAME), str):
            raise InputError(f"{where} has no {NAME}: correct it")
        if frame[NAME] in matrices:
            raise InputError(f"{where}: {frame[NAME][:80]} is given twice: remove one")
        matrices[frame[NAME]] = matrix_values(f"{where}.{MATRIX}", frame.get(MATRIX))
    names = sorted(matrices, key=natural)
    values = np.array([matrices[name] for name in names]).reshape(-1, 3, 4)
    rotations = rotations_of(path, [f"frame {name[:80]}" for name in names], values[:, :, :3]) @ FLIP
    own = {frame[NAME]: frame[TIME] for frame in frames if TIME in frame}
    if len(own) == len(names) and times_ns is None:
        stamps = np.array([time_ns(f"{path}: {name[:80]}", str(own[name])) for name in names], np.int64)
        order = np.argsort(stamps, kind="stable")
        trajectory = Trajectory(stamps[order], rotations[order], values[order, :, 3])
        return TrajectoryFile(path, TITLE, trajectory, images=tuple(names[i] for i in order))
    times, known = untimed(content, len(names), times_ns)
    return TrajectoryFile(path, TITLE, Trajectory(times, rotations, values[:, :, 3]), known, images=tuple(names))


def matrix_values(where: str, entry: Any) -> list[float]:
    """Returns 12 numbers, the first three rows of a matrix of 3 or 4 rows of 4, or of 12 or 16 numbers. Raises
    InputError, which begins with `where`."""
    flat = entry
    if isinstance(entry, list) and entry and all(isinstance(row, list) for row in entry):
        flat = [value for row in entry for value in row]
    if not isinstance(flat, list) or len(flat) not in (12, 16):
        raise InputError(f"{where} is no matrix of 4 x 4 or 3 x 4 numbers: correct it")
    values = [number(where, value) for value in flat]
    if len(values) == 16 and max(abs(a - b) for a, b in zip(values[12:], (0, 0, 0, 1), strict=True)) > 1e-6:
        raise InputError(f"{where}: its last row is not 0 0 0 1: correct it")
    return values[:12]


DIALECT = PoseDialect(
    "nerfstudio",
    TITLE,
    "transforms.json",
    "JSON",
    f"frames with a {MATRIX}",
    _recognises,
    _read,
)
