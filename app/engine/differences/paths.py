"""Where the paths of two runs part: the distance between their positions, as each was estimated at its frame.

Settings that differ change numbers from the first frame on, and two equally good paths walk away from each other by
noise: after n frames they are about sqrt(n) times the usual difference of one frame's motion apart. Paths *part* where
their distance exceeds what such noise, as usual up to that frame, explains.
"""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose

USUAL = 3.0
"""Paths are apart where their distance exceeds this multiple of the usual random walk of noise."""
LASTING = 5
"""Least number of frames for which paths must stay apart: one wrong pose is no other path."""
LASTING_SHARE = 0.05
"""Least share of the common frames for which paths must stay apart."""
FIRST_STEPS = 10
"""Steps at the beginning whose length defines the scale of a method without a metric unit."""
ROUNDING = 1e-9
"""Smaller differences are rounding [m]."""


@dataclass(frozen=True, eq=False)
class Path:
    """Poses of one method, as each was known at its frame."""

    frames: NDArray[np.int64]
    """(N,) increasing numbers of the frames that have a pose."""
    xyz: Array
    """(N, 3) in the method's own world and unit."""
    xyzw: Array
    """(N, 4) unit quaternions, world from camera or rig."""

    def at(self, frames: NDArray[np.int64]) -> Path:
        """The poses at these frames, all of which it has."""
        places = np.searchsorted(self.frames, frames)
        return Path(frames, self.xyz[places], self.xyzw[places])

    def scaled(self, factor: float) -> Path:
        return Path(self.frames, self.xyz * factor, self.xyzw)


@dataclass(frozen=True, eq=False)
class Parting:
    """Where two paths part."""

    frame: int
    distance: float
    """Between the two positions there, in the unit of the paths."""
    at_once: bool
    """Whether they part by a jump at this frame; else by drift, of which no single frame is the cause."""


def distances(a: Path, b: Path) -> tuple[NDArray[np.int64], Array]:
    """Returns the frames (N,) at which both have a pose, and the distances (N,) of their positions."""
    common = np.intersect1d(a.frames, b.frames)
    return common, np.linalg.norm(a.at(common).xyz - b.at(common).xyz, axis=1)


def parting(a: Path, b: Path) -> Parting | None:
    """Returns where two paths in one world and unit part; None where they stay together."""
    common, apart = distances(a, b)
    motions = np.linalg.norm(np.diff(a.at(common).xyz - b.at(common).xyz, axis=0), axis=1)
    differing = np.flatnonzero(motions > ROUNDING)
    if not len(differing):
        return None
    first = int(differing[0])  # up to this place they are the same
    motions, apart = motions[first:], apart[first + 1 :]
    usual = np.array(_medians(motions))
    limits = USUAL * usual * np.sqrt(np.arange(1, len(motions) + 1))
    lasting = max(LASTING, round(LASTING_SHARE * len(common)))
    beyond = np.concatenate([[0], np.cumsum(apart > limits)])
    stays = np.flatnonzero(beyond[lasting:] - beyond[:-lasting] == lasting)
    if not len(stays):
        return None
    at = int(stays[0])
    while at and limits[at - 1] / 2 < apart[at - 1] < apart[at]:  # the rise began there
        at -= 1
    jump = motions[at] > USUAL * usual[at] and motions[at] > apart[at] / 2
    return Parting(int(common[first + 1 + at]), float(apart[at]), bool(jump))


def _medians(values: Array) -> list[float]:
    """Returns for each value the median of all values up to it, and at least of the first LASTING ones."""
    rising = sorted(values[: LASTING - 1].tolist())
    found = []
    for value in values[LASTING - 1 :].tolist():
        insort(rising, value)
        found.append(rising[len(rising) // 2])
    return [rising[len(rising) // 2]] * len(values) if not found else [found[0]] * (LASTING - 1) + found


def in_one_world(a: Path, b: Path) -> tuple[Path, Path] | None:
    """Returns two paths of a method without a metric unit, in the world and unit of `a`: their first common poses
    coincide, and so does the length of their first FIRST_STEPS common steps. None where they share too few poses, or
    one of them does not move there."""
    common = np.intersect1d(a.frames, b.frames)[: FIRST_STEPS + 1]
    if len(common) < 2:
        return None
    lengths = [path_length(path.at(common).xyz) for path in (a, b)]
    if min(lengths) <= ROUNDING:
        return None
    b = b.scaled(lengths[0] / lengths[1])
    first_a, first_b = (_pose(path.at(common[:1])) for path in (a, b))
    a_from_b = first_a @ first_b.inverse()
    return a, Path(b.frames, a_from_b.apply(b.xyz), b.xyzw)


def path_length(xyz: Array) -> float:
    """Returns the length of the way through positions (N, 3)."""
    return float(np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum())


def _pose(path: Path) -> Pose:
    return Pose.from_xyzw(path.xyzw[0], path.xyz[0])
