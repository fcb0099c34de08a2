"""g2o's graphs: lines `VERTEX_SE3:QUAT id x y z qx qy qz qw`, or `VERTEX_SE2 id x y angle` [rad]; metres, w last.

Vertices are world_from_body. Their numbers count as those of images; `--times` gives their times. Edges, landmarks
and other lines are ignored. GTSAM's numbers of keys (a letter in the upper byte) are taken in their order. Source:
g2o, g2o/types/slam3d and slam2d; GTSAM, gtsam/slam/dataset.cpp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, numbered, of_quaternions, untimed
from ispom.io.rows import Row, numbers

TITLE = "g2o"
COUNTS = {"VERTEX_SE3:QUAT": 7, "VERTEX_SE2": 3}
_WORDS = (*COUNTS, "EDGE_SE3:QUAT", "EDGE_SE2", "FIX", "VERTEX_XY", "VERTEX_TRACKXYZ", "PARAMS_SE3OFFSET")


def _recognises(content: PoseContent) -> bool:
    return bool(content.rows) and content.is_text and content.rows[0][1][0] in _WORDS


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path = content.path
    vertices = [(line, words) for line, words in content.rows if words[0] in COUNTS]
    if not vertices:
        raise InputError(f"{path} holds no vertex ({' or '.join(COUNTS)}): give a graph with poses")
    kind = vertices[0][1][0]
    rows: list[Row] = []
    for line, words in vertices:
        if words[0] != kind or len(words) != 2 + COUNTS[kind]:
            raise InputError(f"{path} line {line}: {kind}, a number and {COUNTS[kind]} values are needed: correct it")
        if not words[1].isascii() or not words[1].isdigit() or len(words[1]) > 20:
            raise InputError(f"{path} line {line}: '{words[1][:40]}' is no number of a vertex: correct it")
        rows.append((line, words[1:]))
    rows.sort(key=lambda row: int(row[1][0]))
    values = np.array([numbers(path, line, words[1:]) for line, words in rows])
    if COUNTS[kind] == 3:
        turned = Rotation.from_rotvec(np.outer(values[:, 2], [0.0, 0, 1])).as_quat()
        values = np.column_stack([values[:, :2], np.zeros(len(values)), turned])
    small = int(rows[-1][1][0]) < 10**9
    times, known = numbered(content, rows, times_ns) if small else untimed(content, len(rows), times_ns)
    trajectory = of_quaternions(content, rows, times, values[:, :3], values[:, 3:])
    return TrajectoryFile(path, TITLE, trajectory, known, numbered=small)


DIALECT = PoseDialect(
    "g2o", TITLE, "*.g2o", "text", "lines that begin with VERTEX_SE3:QUAT or VERTEX_SE2", _recognises, _read
)
