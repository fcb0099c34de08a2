"""Options of `ispom budget`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import MovedSource, Programs

REPEATS = 3
"""Repetitions with other noise, where a person says nothing else: with two an interval is a quarter wider."""
MOST_REPEATS = 20


@dataclass(frozen=True, kw_only=True)
class Budget(Programs, MovedSource):
    """Splits the absolute trajectory error of a run by its causes: calibration, clock, noise, outliers, scale and
    initial map. Each is removed in reruns, for which the ground truth says what was wrong; what the shares leave is the
    rest."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote, of a source with ground truth."""
    methods: tuple[str, ...] = ()
    """Only these methods of the run."""
    repeats: Annotated[int, Range(1, MOST_REPEATS)] = REPEATS
    """How often each rerun is repeated with other noise. The intervals come from these."""
    json: bool = False
    """Print the budget as JSON."""
    out: Path | None = None
    """Folder for budget.json."""
