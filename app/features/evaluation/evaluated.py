"""What was compared with the reference, and the names that tell several apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import counted
from ispom.evaluation.ate import Alignment
from ispom.evaluation.comparison import Comparison, measures
from ispom.io.trajectories import TrajectoryFile


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One estimate, by the name that tells it from the others."""

    name: str
    file: TrajectoryFile
    found: Comparison

    @property
    def measures(self) -> dict[str, float | None]:
        """Without a gap in seconds where only rows are known."""
        values = measures(self.found)
        return values if self.file.timed else values | {"longest_gap_s": None}

    def notes(self, kind: Alignment) -> list[str]:
        """What keeps the numbers from meaning what they seem to."""
        found = repeated_note(self.name, self.file)
        if kind in ("se3", "sim3") and self.found.straight:
            found.append(
                f"{self.name}: the compared path is nearly straight: the alignment hardly fixes the turn about it, "
                "on which the rotation of ATE depends; --alignment first fixes it by the first pose"
            )
        return found


def repeated_note(name: str, file: TrajectoryFile) -> list[str]:
    """How many poses of a file have the time of another one; nothing where none has."""
    count = len(file.trajectory)
    repeated = count - len(np.unique(file.trajectory.times_ns))
    what = counted(repeated, "pose has", "poses have")
    return [f"{name}: {what} the time of another one, of {count}; each is compared by itself"] if repeated else []


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """The file names, with as many of their folders as it takes to tell all apart."""
    for depth in range(1, max(len(p.parts) for p in paths) + 1):
        names = ["/".join(p.parts[-depth:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{i}: {p}" for i, p in enumerate(paths, 1)]
