"""What the figures draw of a run: its path where the ground truth is, and its step scale along that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.evaluation.ate import alignment, placed
from ispom.evaluation.step_scale import StepScale, step_scale
from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.types import Trajectory

from .associated import compared, paths_of
from .plan import Run
from .row import Row


@dataclass(frozen=True, eq=False)
class Drawn:
    """One run."""

    run: Run
    truth: Trajectory
    path: Trajectory
    """In the truth's world: from the common first pose on; the unit of one that is not metric is that of the first
    tenth of the path, or of all of a path that is too short for that."""
    scale: StepScale | None
    metric: bool
    """Whether the method's unit is the metre."""


def drawn(rows: Sequence[Row], out: Path) -> list[Drawn]:
    """Those runs that have a truth and a path."""
    every = [_placed(row.run, out / row.run.folder) for row in rows if row.failure is None]
    return [found for found in every if found is not None]


def _placed(run: Run, folder: Path) -> Drawn | None:
    paths, both = paths_of(run, folder), compared(run, folder)
    if paths is None or both is None:
        return None
    (own, truth), (pairs, partners) = paths, both
    scale, unit, metric = step_scale(pairs, partners), 1.0, registered(run.line.method).unit == "metric"
    if not metric:
        unit = 1 / scale.first if scale is not None else alignment(pairs, partners, "sim3").scale
    first = partners.pose(0) @ pairs.pose(0).scaled(unit).inverse()
    last_ns = int(own.times_ns[-1])
    return Drawn(run, truth.select(truth.times_ns <= last_ns), placed(own, Similarity(unit, first)), scale, metric)


def windows_percent(scale: StepScale) -> np.ndarray:
    """The middles of the step scale's windows [% of the path]."""
    count = len(scale.windows)
    return 100 * (np.arange(count) + 0.5) / count
