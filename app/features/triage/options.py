"""Options of `ispom triage`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import FirstFrames, Name
from ..doctor.options import SECONDS
from ..experiments.options import Sharded


@dataclass(frozen=True, kw_only=True)
class Triage(Sharded, FirstFrames):
    """Runs and diagnoses every clip of a folder, and writes one page: which are fine, lost, without a map or
    suspicious, why, and what to do. The same command continues where an earlier one was stopped.

    The exit code is 0 where all clips are fine, 1 where one is not."""

    folder: tyro.conf.Positional[Path]
    """Folder of films, bags, folders of images or drives, and folders that `ispom run` wrote, nested as you like."""
    out: Path = Path("triage")
    """Folder to write to: new, empty, or that of an earlier triage to go on with."""
    methods: tuple[Name, ...] = ()
    """Methods to run. Default: all default ones that a clip has the cameras for."""
    doctor: bool = True
    """Look for the cause where something went wrong, and for wrong calibrations where nothing did."""
    seconds: Annotated[float, Range(1, 3600)] = SECONDS
    """Seconds for each clip after which no new suspect is examined."""
