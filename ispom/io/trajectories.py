"""Trajectory files of any program: TUM, KITTI and EuRoC, and tables whose header names their columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.euroc import OWN, read_euroc
from ispom.io.kitti import read_poses
from ispom.io.pose_table import header_columns, read_pose_table
from ispom.io.rows import read_text
from ispom.io.tum import is_tum, read_tum
from ispom.types import Trajectory

Format = Literal["TUM", "KITTI", "EuRoC", "CSV"]
ROW_NS = 1_000_000_000
"""Rows of a KITTI file count as seconds where their times are not known."""


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    path: Path
    format: Format
    trajectory: Trajectory
    """world_from_FRAME; what FRAME is, only EuRoC's files tell (the body): the others' is called rig."""
    timed: bool = True
    """False: times are row numbers."""
    unit: str = ""
    """Of the times of a table whose header does not say it."""


def read_trajectory(path: Path, times_ns: NDArray[np.int64] | None = None) -> TrajectoryFile:
    """At least one pose; `times_ns` are those of a KITTI file's rows. Every line counts, also of a repeated time.

    InputError names file and line of a mistake.
    """
    columns = header_columns(path)
    if columns is not None and not is_tum(columns):
        own = columns.order == OWN.order and columns.unit in (None, "ns")
        trajectory, unit = read_pose_table(path, columns, "body" if own else "rig", every=True)
        if not len(trajectory):
            raise InputError(f"{path} holds no pose: give a trajectory with one line per pose")
        said = columns.unit is not None or (own and unit == "ns")
        return TrajectoryFile(path, "EuRoC" if own else "CSV", trajectory, unit="" if said else unit)
    match found := _format(path):
        case "KITTI":
            return TrajectoryFile(path, found, _kitti(path, times_ns), times_ns is not None)
        case "TUM":
            return TrajectoryFile(path, found, read_tum(path, every=True))
        case "EuRoC":
            return TrajectoryFile(path, found, read_euroc(path, every=True))


def _format(path: Path) -> Format:
    """By the first line with values."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith(("#", "%")):
            continue
        if "," in text or ";" in text:
            return "EuRoC"
        columns = len(text.split())
        if columns in (8, 12):
            return "TUM" if columns == 8 else "KITTI"
        raise InputError(
            f"{path} line {number} has {columns} columns, which no trajectory has: give a TUM (8), KITTI (12) or EuRoC "
            "file (comma-separated), or a header that names the columns (timestamp, x, y, z, qx, qy, qz, qw)"
        )
    raise InputError(f"{path} holds no pose: give a trajectory in TUM, KITTI or EuRoC format")


def _kitti(path: Path, times_ns: NDArray[np.int64] | None) -> Trajectory:
    poses = read_poses(path, as_printed=True)
    if times_ns is None:
        times_ns = np.arange(len(poses)) * ROW_NS
    if len(times_ns) != len(poses):
        raise InputError(f"{path} has {len(poses)} poses for {len(times_ns)} times: give the times of its rows")
    return Trajectory(times_ns, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
