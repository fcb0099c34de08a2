"""The door by which a method says what it solved, so that parts of it can be left out.

A method opts in by `report_problem(...)` where it has solved for a pose. In a normal run nothing collects the problems,
and a step gives the same result whether they are collected or not.
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
    """Something that a pose was made of, and that can be left out."""

    kind: PartKind
    name: str = ""
    """Of a prior or a sensor; empty for the others."""
    tracks: tuple[int, ...] = ()
    """Ids of a track, or of a group of them."""
    time_ns: int | None = None
    """Of a frame."""


@dataclass(frozen=True, eq=False)
class Shift:
    """How a part moved a pose: from where it would be without the part to where it is."""

    position: Array
    """(3,) in the method's world, in its unit; NaN where the rest does not determine a pose."""
    rotation: Array
    """(3,) rotation vector in the camera [rad]."""

    @property
    def size(self) -> float:
        """Length of the way."""
        return float(np.linalg.norm(self.position))

    @staticmethod
    def of_twist(pose: Pose, twist: Array) -> Shift:
        """Of a pose `world_from_camera` whose inverse was moved by a left `twist` (6,), to first order."""
        return Shift(-pose.rotation @ twist[:3], np.asarray(twist[3:]))

    @staticmethod
    def unknown() -> Shift:
        return Shift(np.full(3, np.nan), np.full(3, np.nan))


class Problem(Protocol):
    """A solved problem that gave a pose."""

    @property
    def frame(self) -> FrameName:
        """Whose pose it gave: a camera, or the rig."""
        ...

    @property
    def pose(self) -> Pose:
        """world_from_frame that it gave."""
        ...

    @property
    def parts(self) -> tuple[Part, ...]:
        """All that can be left out, without groups."""
        ...

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        """What each of these parts did to the pose, from the solution on: a track to first order, a group together."""
        ...

    def really(self, part: Part) -> Shift:
        """The same by solving again without the part, from the same start, until nothing changes any more."""
        ...

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        """Ids (M,) of the tracks, ascending, and where they are in the newest image (M, 2), normalised; NaN where they
        are not."""
        ...


_collected: ContextVar[list[Problem] | None] = ContextVar("ispom_problems", default=None)


def report_problem(problem: Callable[[], Problem]) -> None:
    """Reports what was just solved, if problems are collected; `problem` is not called otherwise."""
    problems = _collected.get()
    if problems is not None:
        problems.append(problem())


@contextmanager
def collecting_problems() -> Iterator[list[Problem]]:
    """Collects the problems that are reported meanwhile, in this thread."""
    problems = list[Problem]()
    token = _collected.set(problems)
    try:
        yield problems
    finally:
        _collected.reset(token)
