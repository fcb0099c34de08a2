"""Trajectories as files: TUM's text, EuRoC's CSV, KITTI's poses, tables with other headers; CSV for spreadsheets.

TUM: `timestamp tx ty tz qx qy qz qw`, seconds and metres. EuRoC: `timestamp [ns], px, py, pz, qw, qx, qy, qz[, ...]`.
All poses are world_from_FRAME.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.geometry import Array
from ispom.io.pose_table import Columns, header_columns, read_pose_table
from ispom.io.rows import latest, numbers, read_rows, times_ns
from ispom.types import FrameName, Landmarks, Trajectory, WorldLines

ORDER = tuple(range(8))


def is_tum(columns: Columns) -> bool:
    """Returns whether a header names TUM's columns, in its order and no others."""
    return columns.order == ORDER and columns.count == len(ORDER) and columns.unit in (None, "s") and columns.spaced


def tum_text(trajectory: Trajectory) -> str:
    """Returns the file's content; times keep every nanosecond, other values nine decimals."""
    values = np.round(np.hstack([trajectory.translations, trajectory.xyzw]), 9) + 0.0  # no "-0.000000000"
    times = [seconds_text(int(t)) for t in trajectory.times_ns]
    return "".join(f"{t} {' '.join(f'{v:.9f}' for v in row)}\n" for t, row in zip(times, values, strict=True))


def read_tum(path: Path, frame: FrameName = "rig", every: bool = False) -> Trajectory:
    """Reads a trajectory; `frame` is that of its poses. Raises InputError that names the invalid line.

    Of several poses at one time the last is used: the published ground truth of TUM's fr2_desk has such a pair. With
    `every`, all of them stay. A header that names the columns in another order is followed.
    """
    columns = header_columns(path)
    if columns is not None and not is_tum(columns):
        return read_pose_table(path, columns, frame, every)[0]
    rows = [row for row in read_rows(path, 8) if columns is None or row[0] != columns.line]
    times = times_ns(path, rows)
    values = np.array([numbers(path, line, words[1:]) for line, words in rows]).reshape(-1, 7)
    return latest(path, rows, times, values[:, :3], values[:, 3:], frame, every)


def seconds_text(time_ns: int) -> str:
    """Returns decimal seconds by integer arithmetic: a float has too few digits for nanoseconds since 1970."""
    whole, rest = divmod(abs(time_ns), 10**9)
    return f"{'-' if time_ns < 0 else ''}{whole}.{rest:09d}"


# Trajectories as EuRoC's ground-truth CSV: `timestamp [ns], px, py, pz, qw, qx, qy, qz[, ...]`, world_from_FRAME.


HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
OWN = Columns((0,), (1, 2, 3), (5, 6, 7, 4), "ns", 8)
"""EuRoC's columns; further ones (velocity, biases of the gyroscope and accelerometer) are ignored."""


def euroc_text(trajectory: Trajectory) -> str:
    """Returns the file's content: whole nanoseconds, other values with nine decimals."""
    values = np.round(np.hstack([trajectory.translations, trajectory.xyzw[:, [3, 0, 1, 2]]]), 9) + 0.0
    rows = zip(trajectory.times_ns.tolist(), values.tolist(), strict=True)
    return f"{HEADER}\n" + "".join(f"{t},{','.join(f'{v:.9f}' for v in row)}\n" for t, row in rows)


def read_euroc(path: Path, frame: FrameName = "body", every: bool = False) -> Trajectory:
    """Reads `state_groundtruth_estimate0/data.csv` and the like. Raises InputError that names the invalid line.

    The header gives the order of the columns; without one they are EuRoC's. Of several poses at one time the last is
    used; with `every`, all of them stay.
    """
    return read_pose_table(path, header_columns(path) or OWN, frame, every)[0]


# Trajectories as VSLAM-LAB's `groundtruth.csv` and `00000_KeyFrameTrajectory.csv`.

VSLAM_LAB_HEADER = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw"


def vslam_lab_text(trajectory: Trajectory) -> str:
    """Returns the file's content: whole nanoseconds, other values with nine decimals."""
    lines = _lines(trajectory.times_ns, np.hstack([trajectory.translations, trajectory.xyzw]))
    return f"{VSLAM_LAB_HEADER}\n{lines}"


# Trajectories and landmarks as CSV with a header, for spreadsheets and data frames.


def trajectory_csv(trajectory: Trajectory) -> str:
    """Writes one pose per line, world_from_FRAME."""
    header = "time_ns,x,y,z,qx,qy,qz,qw\n"
    return header + _lines(trajectory.times_ns, np.hstack([trajectory.translations, trajectory.xyzw]))


def landmarks_csv(landmarks: Landmarks) -> str:
    """Writes one point per line, in the trajectory's world and unit."""
    colours = (",".join(map(str, rgb)) for rgb in landmarks.rgb.tolist())
    points = _lines(landmarks.ids, landmarks.xyz_in_world).splitlines()
    return "id,x,y,z,red,green,blue\n" + "".join(f"{p},{c}\n" for p, c in zip(points, colours, strict=True))


def world_lines_csv(lines: WorldLines) -> str:
    """Writes one line of the scene per row, in the trajectory's world and unit: its group and both ends.

    The group is the number of a direction that lines share, or of the tag of which the line is a side.
    """
    keys = np.array([f"{n},{group}" for n, group in enumerate(lines.group.tolist())])
    return "id,group,x1,y1,z1,x2,y2,z2\n" + _lines(keys, lines.xyz_in_world.reshape(-1, 6))


def _lines(keys: np.ndarray, values: Array) -> str:
    rows = (np.round(values, 9) + 0.0).tolist()  # no "-0.0"
    return "".join(f"{k},{','.join(f'{v:.9f}' for v in r)}\n" for k, r in zip(keys.tolist(), rows, strict=True))
