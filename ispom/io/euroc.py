"""Trajectories as EuRoC's ground-truth CSV: `timestamp [ns], px, py, pz, qw, qx, qy, qz[, ...]`, world_from_FRAME."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.io.pose_table import Columns, header_columns, read_pose_table
from ispom.types import FrameName, Trajectory

HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
OWN = Columns((0,), (1, 2, 3), (5, 6, 7, 4), "ns", 8)
"""Read of each line; what follows (velocity, biases of the gyroscope and accelerometer) is ignored."""


def euroc_text(trajectory: Trajectory) -> str:
    """The file's content: whole nanoseconds, other values with nine decimals."""
    values = np.round(np.hstack([trajectory.translations, trajectory.xyzw[:, [3, 0, 1, 2]]]), 9) + 0.0
    rows = zip(trajectory.times_ns.tolist(), values.tolist(), strict=True)
    return f"{HEADER}\n" + "".join(f"{t},{','.join(f'{v:.9f}' for v in row)}\n" for t, row in rows)


def read_euroc(path: Path, frame: FrameName = "body", every: bool = False) -> Trajectory:
    """The trajectory of `state_groundtruth_estimate0/data.csv` and the like; InputError names the line that is wrong.

    The header tells the order of the columns; without one they are EuRoC's. Of several poses at one time the last
    counts; with `every`, all of them stay.
    """
    return read_pose_table(path, header_columns(path) or OWN, frame, every)[0]
