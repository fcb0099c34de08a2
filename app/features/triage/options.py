"""Options of `ispom triage`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import Name
from ..doctor.options import SECONDS
from ..experiments.options import Parallel


@dataclass(frozen=True, kw_only=True)
class Triage(Parallel):
    """Runs and diagnoses every clip of a folder, and writes one page: which are fine, lost, without a map or
    suspicious, why, and what to do. The same command continues where an earlier one was stopped.

    The exit code is 0 where all clips are fine, 1 where one is not."""

    folder: tyro.conf.Positional[Path]
    """Folder of films, bags, folders of images or drives, and folders that `ispom run` wrote, nested as you like."""
    out: Path = Path("triage")
    """Folder to write to: new, empty, or that of an earlier triage to go on with."""
    methods: tuple[Name, ...] = ()
    """Methods to run. Default: all default ones that a clip has the cameras for."""
    max_exposures: int | None = None
    """Use only the first N frames of each clip."""
    doctor: bool = True
    """Look for the cause where something went wrong, and for wrong calibrations where nothing did."""
    seconds: Annotated[float, Range(1, 3600)] = SECONDS
    """Of a clip no new suspect is examined after so many seconds."""
    shard: str | None = None
    """K/N computes only every N-th clip, from the K-th on, such as 3/40 in an array job, and writes no page. The
    command without it computes what is missing, and writes the page."""
