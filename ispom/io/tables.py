"""Trajectories and landmarks as CSV with a header, for spreadsheets and data frames."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.types import Landmarks, Trajectory


def trajectory_csv(trajectory: Trajectory) -> str:
    """One pose per line, world_from_FRAME."""
    header = "time_ns,x,y,z,qx,qy,qz,qw\n"
    return header + _lines(trajectory.times_ns, np.hstack([trajectory.translations, trajectory.xyzw]))


def landmarks_csv(landmarks: Landmarks) -> str:
    """One point per line, in the trajectory's world and unit."""
    colours = (",".join(map(str, rgb)) for rgb in landmarks.rgb.tolist())
    points = _lines(landmarks.ids, landmarks.xyz_in_world).splitlines()
    return "id,x,y,z,red,green,blue\n" + "".join(f"{p},{c}\n" for p, c in zip(points, colours, strict=True))


def _lines(keys: np.ndarray, values: Array) -> str:
    rows = (np.round(values, 9) + 0.0).tolist()  # no "-0.0"
    return "".join(f"{k},{','.join(f'{v:.9f}' for v in r)}\n" for k, r in zip(keys.tolist(), rows, strict=True))
