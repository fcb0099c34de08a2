"""What was compared with the reference, and the names that tell several apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

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
        if kind in ("se3", "sim3") and self.found.straight:
            return [
                f"{self.name}: the compared path is nearly straight: the alignment hardly fixes the turn about it, "
                "on which the rotation of ATE depends; --alignment first fixes it by the first pose"
            ]
        return []


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """The file names, with as many of their folders as it takes to tell all apart."""
    for depth in range(1, max(len(p.parts) for p in paths) + 1):
        names = ["/".join(p.parts[-depth:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{i}: {p}" for i, p in enumerate(paths, 1)]
