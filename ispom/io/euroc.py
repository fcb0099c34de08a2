"""Trajectories as EuRoC's ground-truth CSV: `timestamp [ns], px, py, pz, qw, qx, qy, qz[, ...]`, world_from_FRAME."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.rows import MAX_TIME_S, Row, latest, numbers, read_text
from ispom.types import Frame, Trajectory

HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
COLUMNS = 8
"""Read of each line; what follows (velocity, biases of the gyroscope and accelerometer) is ignored."""


def euroc_text(trajectory: Trajectory) -> str:
    """The file's content: whole nanoseconds, other values with nine decimals."""
    values = np.round(np.hstack([trajectory.translations, trajectory.xyzw[:, [3, 0, 1, 2]]]), 9) + 0.0
    rows = zip(trajectory.times_ns.tolist(), values.tolist(), strict=True)
    return f"{HEADER}\n" + "".join(f"{t},{','.join(f'{v:.9f}' for v in row)}\n" for t, row in rows)


def read_euroc(path: Path, frame: Frame = "body", every: bool = False) -> Trajectory:
    """The trajectory of `state_groundtruth_estimate0/data.csv` and the like; InputError names the line that is wrong.

    Of several poses at one time the last counts; with `every`, all of them stay.
    """
    rows = _rows(path)
    times = np.array([_time_ns(path, line, words[0]) for line, words in rows], np.int64)
    values = np.array([numbers(path, line, words[1:COLUMNS]) for line, words in rows]).reshape(-1, COLUMNS - 1)
    return latest(path, rows, times, values[:, :3], values[:, [4, 5, 6, 3]], frame, every)


def _rows(path: Path) -> list[Row]:
    lines = [(n, line.strip().rstrip(",")) for n, line in enumerate(read_text(path).splitlines(), 1)]
    rows = [(n, [word.strip() for word in line.split(",")]) for n, line in lines if line and not line.startswith("#")]
    for line, words in rows:
        if len(words) < COLUMNS or len(words) != len(rows[0][1]):
            wanted = max(COLUMNS, len(rows[0][1]))
            raise InputError(f"{path} line {line} has {len(words)} columns, not {wanted}: correct that line")
    return rows


def _time_ns(path: Path, line: int, word: str) -> int:
    if not word.removeprefix("-").isdecimal() or len(word) > 20 or abs(int(word)) > MAX_TIME_S * 10**9:
        raise InputError(f"{path} line {line}: '{word[:40]}' is not a time in whole nanoseconds: correct that line")
    return int(word)
