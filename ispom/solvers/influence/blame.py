"""Ranks all parts of a solved problem by their influence on its pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Pose
from ispom.numerics.places import places
from ispom.solvers.influence.groups import groups
from ispom.solvers.influence.problem import Part, PartKind, Problem, Shift
from ispom.types import Rig

REFINED_TRACKS = 20
"""Number of tracks with the largest influences that are left out by solving to convergence, not only to first order."""
MAX_GROUPS = 8
"""Largest number of groups of tracks."""


@dataclass(frozen=True, eq=False)
class Influence:
    """A part, and the shift of the pose by it."""

    part: Part
    shift: Shift


@dataclass(frozen=True, eq=False)
class Blame:
    """All influences on a pose."""

    problem: Problem
    influences: tuple[Influence, ...]
    """The largest first; those of unknown shift last."""

    def of(self, *kinds: PartKind) -> tuple[Influence, ...]:
        """Returns the influences of parts of these kinds."""
        return tuple(each for each in self.influences if each.part.kind in kinds)


def blame(problem: Problem) -> Blame:
    """Computes the influence of each part of a problem, and of each group of tracks that pull the pose the same way.

    The problem itself removes a part, see `WindowProblem` and `ResectionProblem`.
    """
    parts = problem.parts
    found = [Influence(*each) for each in zip(parts, problem.shifts(parts), strict=True)]
    tracks = [each for each in found if each.part.kind == "track"]
    top = [Part("group", tracks=each.part.tracks) for each in sorted(tracks, key=_size)[:REFINED_TRACKS]]
    better = {part.tracks: shift for part, shift in zip(top, problem.shifts(tuple(top)), strict=True)}
    found = [replace(each, shift=better.get(each.part.tracks, each.shift)) for each in found]
    ids, at = problem.seen()
    if tracks:
        tracks = [each for each in found if each.part.kind == "track"]
        pulls = np.full((len(ids), 3), np.nan)
        numbers = np.array([each.part.tracks[0] for each in tracks], np.int64)
        pulls[places(ids, numbers)] = [each.shift.position for each in tracks]
        together = [Part("group", tracks=tuple(int(i) for i in ids[rows])) for rows in groups(at, pulls)[:MAX_GROUPS]]
        shifts = problem.shifts(tuple(together))
        found += [Influence(part, shift) for part, shift in zip(together, shifts, strict=True)]
    return Blame(problem, tuple(sorted(found, key=_size)))


def problem_of(problems: Sequence[Problem], world_from_frame: Pose, frame: str, rig: Rig) -> Problem | None:
    """Returns the problem whose pose is nearest to this one, the last of equals; None if none was reported."""
    world_from_rig = world_from_frame @ rig.rig_from(frame).inverse()

    def distance(problem: Problem) -> float:
        there = problem.pose @ rig.rig_from(problem.frame).inverse()
        return float(np.linalg.norm(there.translation - world_from_rig.translation))

    return min(reversed(problems), key=distance, default=None)


def _size(each: Influence) -> float:
    return -each.shift.size if np.isfinite(each.shift.size) else np.inf
