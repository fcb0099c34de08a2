"""OpenVINS' states: `timestamp(s) q p v bg ba ...`, seconds, metres, the rotation before the position.

The quaternion is JPL's q_GtoI, x y z w: its four numbers, read as Hamilton's, are world_from_body, which is how they
are read. The body is the IMU; velocities, biases and calibrations behind the pose are ignored. A file without this
header, of 8 numbers in a row of which those behind the time are the quaternion, is read so where its first pose is
the identity with w last (or, noted, first); otherwise it is refused. Source: OpenVINS,
ov_core/src/utils/dataset_reader.h and ov_msckf/src/state/StateHelper.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import (
    PoseDialect,
    TrajectoryFile,
    of_quaternions,
    order_of_quaternions,
    rectangular,
    timed,
    values_of,
)

COLUMNS, TITLE = 8, "OpenVINS"
_HEADER = re.compile(r"^#\s*(?:timestamp|time)\s*\(?s?\)?[ ,]+q(?:_gtoi)?[ ,]+p(?:_iing)?\b", re.MULTILINE)


def _recognises(content: PoseContent) -> bool:
    if content.columns is not None or content.roles is not None or not content.unit_length(1):
        return False
    if content.width >= COLUMNS and _HEADER.search(content.comments):
        return True
    return content.width == COLUMNS and not content.unit_length(4)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    rows = rectangular(content, COLUMNS, at_least=content.width > COLUMNS)
    values = values_of(content.path, rows, 1, COLUMNS)
    xyzw, notes = values[:, :4], ()
    if not _HEADER.search(content.comments):
        comma = " " if content.spaced else ","
        xyzw, notes = order_of_quaternions(content, xyzw, comma.join(["timestamp", "Q", "x", "y", "z"]))
    times, unit = timed(content, rows)
    trajectory = of_quaternions(content, rows, times, values[:, 4:7], xyzw)
    return TrajectoryFile(content.path, TITLE, trajectory, unit="" if unit == "s" else unit, notes=notes)


DIALECT = PoseDialect(
    "openvins",
    TITLE,
    "state_estimate.txt, state_groundtruth.txt",
    "text",
    "the comment '# timestamp(s) q p', or 8 numbers of which the second to fifth are a quaternion",
    _recognises,
    _read,
)
