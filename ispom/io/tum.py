"""Trajectories as TUM text: `timestamp tx ty tz qx qy qz qw`, world_from_FRAME, seconds and metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.io.pose_table import Columns, header_columns, read_pose_table
from ispom.io.rows import latest, numbers, read_rows, times_ns
from ispom.types import FrameName, Trajectory

ORDER = tuple(range(8))


def is_tum(columns: Columns) -> bool:
    """Whether a header names TUM's columns, in its order and no others."""
    return columns.order == ORDER and columns.count == len(ORDER) and columns.unit in (None, "s") and columns.spaced


def tum_text(trajectory: Trajectory) -> str:
    """The file's content; times keep every nanosecond, other values nine decimals."""
    values = np.round(np.hstack([trajectory.translations, trajectory.xyzw]), 9) + 0.0  # no "-0.000000000"
    times = [seconds_text(int(t)) for t in trajectory.times_ns]
    return "".join(f"{t} {' '.join(f'{v:.9f}' for v in row)}\n" for t, row in zip(times, values, strict=True))


def read_tum(path: Path, frame: FrameName = "rig", every: bool = False) -> Trajectory:
    """The trajectory of a file; `frame` says whose poses they are. InputError names the line that is wrong.

    Of several poses at one time the last counts: the published truth of TUM's fr2_desk has such a pair. With
    `every`, all of them stay. A header that names the columns in another order counts.
    """
    columns = header_columns(path)
    if columns is not None and not is_tum(columns):
        return read_pose_table(path, columns, frame, every)[0]
    rows = [row for row in read_rows(path, 8) if columns is None or row[0] != columns.line]
    times = times_ns(path, rows)
    values = np.array([numbers(path, line, words[1:]) for line, words in rows]).reshape(-1, 7)
    return latest(path, rows, times, values[:, :3], values[:, 3:], frame, every)


def seconds_text(time_ns: int) -> str:
    """Decimal seconds by integer arithmetic: a float has too few digits for nanoseconds since 1970."""
    whole, rest = divmod(abs(time_ns), 10**9)
    return f"{'-' if time_ns < 0 else ''}{whole}.{rest:09d}"
