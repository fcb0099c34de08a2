"""Options of `ispom diff`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from ...engine.options import ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Diff(ReadsRuns):
    """Finds the first frame at which two runs differ, and in what: tracks, checks, poses, landmarks. Measured
    times are not compared. The exit code is 0 where the runs are the same, 1 where they differ."""

    READS: ClassVar[tuple[str, ...]] = ("run_a", "run_b")
    run_a: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    run_b: tyro.conf.Positional[Path]
    """Another one; the methods that both ran are compared."""
    tolerance: float = 0.0
    """Ignore differences of numbers up to this: relative above 1, absolute below. Above 0, arrays are not compared bit
    by bit."""
    count: int = 3
    """How many frames to show: the first, and the next ones at which something else differs for the first time."""
    json: bool = False
    """Print JSON."""
