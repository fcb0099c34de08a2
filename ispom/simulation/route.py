"""A user's own way through a simulated place: the poses of a TUM file, joined by a spline."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.files import expanded, read_bytes
from ispom.io.tum import read_tum
from ispom.solvers.trajectory.continuous import Curve
from ispom.types import Trajectory

WORD = "route:"
"""Begins the name of a motion that is a file's."""
FEWEST = 4


def route_name(path: str) -> str:
    """A name that tells files of other content apart. InputError where the file is no route."""
    found = expanded(path).absolute()
    _poses(found)
    return f"{WORD}{hashlib.blake2b(read_bytes(found), digest_size=8).hexdigest()}:{found}"


@dataclass(frozen=True)
class Route:
    """From the first pose on, whose time is 0."""

    name: str
    """As `route_name` gives it."""

    @cached_property
    def _curve(self) -> Curve:
        return Curve(_poses(Path(self.name.split(":", 2)[2])))

    @property
    def duration_s(self) -> float:
        times_ns = self._curve.through.times_ns
        return float(times_ns[-1] - times_ns[0]) * 1e-9

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]; the ends stay where they are."""
        return self._curve.at(np.array([self._curve.through.times_ns[0] + time_ns])).pose(0)


def _poses(path: Path) -> Trajectory:
    """InputError where there are too few for a spline."""
    found = read_tum(path, "rig")
    if len(found) < FEWEST:
        raise InputError(f"{path} has {len(found)} poses: a route needs at least {FEWEST}")
    return found
