"""Redwood's and Open3D's logs (`traj.log`): a line of three whole numbers, then a 4 x 4 matrix in four rows.

Matrices are world_from_camera, metres; the camera has x to the right, y down and z ahead. The first of the three
numbers is that of the image. The log has no times: `--times` gives those of the images. Source: redwood-data.org,
file formats; Open3D, PinholeCameraTrajectory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, numbered, of_matrices, values_of

TITLE = "Redwood"
ROWS_PER_POSE = 5
"""Number of rows of a pose."""


def _recognises(content: PoseContent) -> bool:
    if not content.is_text or len(content.rows) < ROWS_PER_POSE or content.head.lstrip()[:1] in (b"{", b"["):
        return False
    return [len(words) for _, words in content.rows[:ROWS_PER_POSE]] == [3, 4, 4, 4, 4] and content.width == 3


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, rows = content.path, content.rows
    if len(rows) % ROWS_PER_POSE:
        raise InputError(f"{path} has {len(rows)} rows, and each pose is {ROWS_PER_POSE} of them: restore the file")
    for i, (line, words) in enumerate(rows):
        width = 4 if i % ROWS_PER_POSE else 3
        if len(words) != width:
            raise InputError(f"{path} line {line} has {len(words)} columns, not {width}: correct that line")
    heads = rows[::ROWS_PER_POSE]
    matrices = np.stack(
        [values_of(path, rows[i + 1 : i + ROWS_PER_POSE], 0, 4) for i in range(0, len(rows), ROWS_PER_POSE)]
    )
    times, known = numbered(content, heads, times_ns)
    return TrajectoryFile(path, TITLE, of_matrices(path, heads, matrices, times), known, numbered=True)


DIALECT = PoseDialect(
    "redwood", TITLE, "traj.log", "text", "three numbers in a row, then four rows of four", _recognises, _read
)
