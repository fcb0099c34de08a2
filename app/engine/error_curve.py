"""The position error at each frame, after the alignment of the ATE: see `frame_record.ERROR`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.trajectory_error import Alignment, TrajectoryError
from ispom.geometry import Array
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Trajectory

from ..presentation.texts import ALIGNED


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """The position errors of one method in one branch."""

    times_ns: NDArray[np.int64]
    """(N,), increasing."""
    metres: Array
    """(N,) the position errors."""
    alignment: Alignment
    branches: int = 1
    """Number of forks of one run that were aligned together, this one included. If it is 1, the root mean square of the
    errors is the ATE."""

    @staticmethod
    def of(error: TrajectoryError) -> ErrorCurve:
        return ErrorCurve(error.estimate.times_ns, error.position_errors_m, error.alignment)

    @property
    def aligned(self) -> str:
        """Returns the name of the alignment, such as "SE(3)"."""
        how = ALIGNED[self.alignment]
        return how if self.branches == 1 else f"{how} of {self.branches} branches together"

    def at(self, time_ns: int) -> float | None:
        """The error of the latest pose up to a time; None before the first."""
        place = int(np.searchsorted(self.times_ns, time_ns, side="right")) - 1
        return float(self.metres[place]) if place >= 0 else None


@dataclass(frozen=True, eq=False)
class Part:
    """What a branch adds to its family."""

    error: TrajectoryError
    parent: int | None
    """The number of the branch that has the frames before `from_ns`; None: it has all of them itself."""
    from_ns: int = 0
    """The time of the first frame that it computed itself."""


def family_curves(parts: Mapping[int, Part]) -> dict[int, ErrorCurve]:
    """Returns the curves of one method in all branches of one run, by number of the branch.

    All branches are in one world, so all their poses are aligned with the truth together. A frame that a branch shares
    with its parent has one error, that of the parent. Where a method has a unit of its own, and the parent had not
    moved at the fork, the unit was chosen later: such a branch is in another world than its parent.
    """
    parts = {n: part if _shares_a_world(parts, part) else replace(part, parent=None) for n, part in parts.items()}
    roots = {number: _root(parts, number) for number in parts}
    found: dict[int, ErrorCurve] = {}
    for root in dict.fromkeys(roots.values()):
        members = [number for number in parts if roots[number] == root]
        if len(members) == 1:
            found[root] = ErrorCurve.of(parts[root].error)
            continue
        kind = parts[root].error.alignment
        own = {number: _own(parts, number) for number in members}
        known = [pair for pair in own.values() if len(pair[0])]
        estimated, true = (np.concatenate([pair[i].translations for pair in known]) for i in (0, 1))
        common = umeyama(estimated, true, with_scale=kind != "se3")
        for number in members:
            line = [own[at] for at in _line(parts, number)]
            until = [*(parts[at].from_ns for at in _line(parts, number)[1:]), None]
            cut = [_before(pair, end) for pair, end in zip(line, until, strict=True)]
            times = np.concatenate([estimate.times_ns for estimate, _ in cut])
            away = [
                np.linalg.norm(common.apply(estimate.translations) - truth.translations, axis=1)
                for estimate, truth in cut
            ]
            found[number] = ErrorCurve(times, np.concatenate(away), kind, len(members))
    return found


def _shares_a_world(parts: Mapping[int, Part], part: Part) -> bool:
    parent = None if part.parent is None else parts.get(part.parent)
    if parent is None or part.error.alignment == "se3":
        return True
    before = parent.error.estimate.translations[parent.error.estimate.times_ns < part.from_ns]
    return bool(len(before) and np.ptp(before, axis=0).any())


Pair = tuple[Trajectory, Trajectory]
"""Estimated poses, and the true poses at the same times."""


def _line(parts: Mapping[int, Part], number: int) -> Sequence[int]:
    """The branch and its ancestors that have the method, the oldest first."""
    found = [number]
    while (parent := parts[found[0]].parent) is not None and parent in parts and parent not in found:
        found.insert(0, parent)
    return found


def _root(parts: Mapping[int, Part], number: int) -> int:
    return _line(parts, number)[0]


def _own(parts: Mapping[int, Part], number: int) -> Pair:
    """The poses that a branch does not share with its parent."""
    part = parts[number]
    own = part.error.estimate.times_ns >= (part.from_ns if part.parent in parts else np.iinfo(np.int64).min)
    return part.error.estimate.select(own), part.error.reference.select(own)


def _before(pair: Pair, end_ns: int | None) -> Pair:
    if end_ns is None:
        return pair
    earlier = pair[0].times_ns < end_ns
    return pair[0].select(earlier), pair[1].select(earlier)
