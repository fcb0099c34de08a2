"""What moved one pose, and by how much: all parts of the problem that gave it, the largest influence first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Pose
from ispom.numerics.places import places
from ispom.solvers.influence.groups import groups
from ispom.solvers.influence.problem import Part, PartKind, Problem, Shift
from ispom.types import Rig

AGAIN = 20
"""Tracks with the largest influences that are left out once more, until nothing changes any more."""
GROUPS = 8
"""Most groups."""


@dataclass(frozen=True, eq=False)
class Influence:
    """How a part moved the pose."""

    part: Part
    shift: Shift


@dataclass(frozen=True, eq=False)
class Blame:
    """All influences on a pose."""

    problem: Problem
    influences: tuple[Influence, ...]
    """The largest first; those whose shift is unknown last."""

    def of(self, *kinds: PartKind) -> tuple[Influence, ...]:
        """Returns those of some kinds."""
        return tuple(each for each in self.influences if each.part.kind in kinds)


def blame(problem: Problem) -> Blame:
    """Leaves out each part of a problem, and each group of tracks that belong together, see the problems for how."""
    parts = problem.parts
    found = [Influence(*each) for each in zip(parts, problem.shifts(parts), strict=True)]
    tracks = [each for each in found if each.part.kind == "track"]
    top = [Part("group", tracks=each.part.tracks) for each in sorted(tracks, key=_size)[:AGAIN]]
    better = {part.tracks: shift for part, shift in zip(top, problem.shifts(tuple(top)), strict=True)}
    found = [replace(each, shift=better.get(each.part.tracks, each.shift)) for each in found]
    ids, at = problem.seen()
    if tracks:
        tracks = [each for each in found if each.part.kind == "track"]
        pulls = np.full((len(ids), 3), np.nan)
        numbers = np.array([each.part.tracks[0] for each in tracks], np.int64)
        pulls[places(ids, numbers)] = [each.shift.position for each in tracks]
        together = [Part("group", tracks=tuple(int(i) for i in ids[rows])) for rows in groups(at, pulls)[:GROUPS]]
        shifts = problem.shifts(tuple(together))
        found += [Influence(part, shift) for part, shift in zip(together, shifts, strict=True)]
    return Blame(problem, tuple(sorted(found, key=_size)))


def problem_of(problems: Sequence[Problem], world_from_frame: Pose, frame: str, rig: Rig) -> Problem | None:
    """Returns the last of the problems that gave this pose; None if none was reported."""
    world_from_rig = world_from_frame @ rig.rig_from(frame).inverse()

    def apart(problem: Problem) -> float:
        there = problem.pose @ rig.rig_from(problem.frame).inverse()
        return float(np.linalg.norm(there.translation - world_from_rig.translation))

    return min(reversed(problems), key=apart, default=None)


def _size(each: Influence) -> float:
    return -each.shift.size if np.isfinite(each.shift.size) else np.inf
