"""The journal of a run's poses. If the run is killed, its trajectories are read from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.geometry import Pose
from ispom.io.values import LARGEST, MAX_TIME_S
from ispom.types import Trajectory

from ..events import Stepped
from .run_folder import JOURNAL, RunFolder
from .table import GrowingTable, read_table

MOST_EXPOSURES = 10**9
_VALUES = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS = ("exposure", "method", "frame", "unit_m", "time_ns", *_VALUES)
"""Each row is a new or revised pose; the last row of a method and time counts. `unit_m` is empty while unknown."""


@dataclass(frozen=True, eq=False)
class Journal:
    """The results that were known when the run ended."""

    exposures: int
    """Number of frames that were processed."""
    trajectories: Mapping[str, Trajectory]
    """By method: world_from_frame, in the method's own unit."""
    units_m: Mapping[str, float | None]
    """By method: the length of its unit [m]; None where unknown."""


class PoseJournal:
    """Writes the journal during a run. It is removed when the trajectories are written."""

    def __init__(self, folder: RunFolder, unit_m: Callable[[str], float | None]) -> None:
        """`unit_m` gives a method's unit [m] as known now."""
        self._table, self._unit_m = GrowingTable(folder, JOURNAL, COLUMNS), unit_m

    def add(self, event: Stepped) -> None:
        for step in event.steps:
            unit_m = self._unit_m(step.method)
            known = (event.index, step.method, step.frame, "" if unit_m is None else repr(float(unit_m)))
            poses = step.revised.items()
            if step.world_from_frame is not None:
                poses.append((step.time_ns, step.world_from_frame))
            self._table.add(
                (*known, time_ns, *(repr(float(v)) for v in (*pose.translation, *pose.xyzw))) for time_ns, pose in poses
            )

    def close(self, keep: bool) -> None:
        """Closes the journal, and with `keep` gives it its final name, because the trajectories could not be
        written."""
        self._table.close(keep)


def read_journal(path: Path) -> Journal:
    """Returns the journal of a run, without damaged rows. InputError as `read_table`."""
    poses: dict[str, dict[int, Pose]] = {}
    frames, units, exposures = {}, {}, 0
    for row in read_table(path):
        try:
            values = np.array([float(row[name]) for name in _VALUES])
            time_ns, index = int(row["time_ns"]), int(row["exposure"])
            unit_m = float(row["unit_m"]) if row["unit_m"] else None
            method, frame = row["method"], row["frame"]
        except (KeyError, ValueError):
            continue
        if not (abs(values) <= LARGEST).all() or abs(time_ns) > MAX_TIME_S * 10**9 or not 0 <= index < MOST_EXPOSURES:
            continue
        if unit_m is not None and not 1 / LARGEST <= unit_m <= LARGEST:
            continue
        if not math.isclose(float(np.linalg.norm(values[3:])), 1.0, abs_tol=0.01):
            continue
        if frame not in ("rig", "left", "right", "video"):
            continue
        poses.setdefault(method, {})[time_ns] = Pose.from_xyzw(values[3:], values[:3])
        frames[method], units[method] = frame, unit_m
        exposures = max(exposures, index + 1)
    found = {method: Trajectory.of(list(known.items()), frames[method]) for method, known in poses.items()}
    return Journal(exposures, found, units)
