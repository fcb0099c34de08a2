"""The interface by which a method reports the problem that it solved, so that parts of it can be left out.

A method opts in by calling `report_problem(...)` after it has solved for a pose. In a normal run nobody collects the
problems; the result of a step is the same with and without collection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import FrameName

PartKind = Literal["track", "group", "frame", "prior", "sensor"]


@dataclass(frozen=True)
class Part:
    """A part of the problem's input that can be left out."""

    kind: PartKind
    name: str = ""
    """Name of a prior or a sensor; empty for the others."""
    tracks: tuple[int, ...] = ()
    """Ids of the track, or of the tracks of a group."""
    time_ns: int | None = None
    """Time of a frame."""


@dataclass(frozen=True, eq=False)
class Shift:
    """The difference between a pose and the pose without a part."""

    position: Array
    """(3,) in the method's world and unit; NaN where the other parts do not determine a pose."""
    rotation: Array
    """(3,) rotation vector in the camera [rad]."""

    @property
    def size(self) -> float:
        """Length of the change of position."""
        return float(np.linalg.norm(self.position))

    @staticmethod
    def of_twist(pose: Pose, twist: Array) -> Shift:
        """Returns the shift of `world_from_camera` if its inverse is moved by a left `twist` (6,), to first order."""
        return Shift(-pose.rotation @ twist[:3], np.asarray(twist[3:]))

    @staticmethod
    def unknown() -> Shift:
        return Shift(np.full(3, np.nan), np.full(3, np.nan))


class Problem(Protocol):
    """A solved problem, whose result was a pose."""

    @property
    def frame(self) -> FrameName:
        """The coordinate frame whose pose was estimated: a camera, or the rig."""
        ...

    @property
    def pose(self) -> Pose:
        """The estimated world_from_frame."""
        ...

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts that can be left out, without groups."""
        ...

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        """Returns the shift of the pose by each part, from the solution on: of tracks to first order, of groups at
        once."""
        ...

    def really(self, part: Part) -> Shift:
        """Returns the same by solving without the part, from the original start to convergence."""
        ...

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        """Returns the ids (M,) of the tracks, ascending, and their normalised positions (M, 2) in the newest image; NaN
        where it does not observe them."""
        ...


_collected: ContextVar[list[Problem] | None] = ContextVar("ispom_problems", default=None)


def report_problem(problem: Callable[[], Problem]) -> None:
    """Reports the problem that was just solved, if problems are collected; `problem` is not called otherwise."""
    problems = _collected.get()
    if problems is not None:
        problems.append(problem())


@contextmanager
def collecting_problems() -> Iterator[list[Problem]]:
    """Collects the problems that are reported in this context, in this thread."""
    problems = list[Problem]()
    token = _collected.set(problems)
    try:
        yield problems
    finally:
        _collected.reset(token)
