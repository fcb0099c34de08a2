"""Options of `ispom undecided`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import SourceOptions

SECONDS, STEP_S = 3.0, 3.0
CREATOR = "ISPOM undecided"
"""Creator in the head of an image by which our own images are recognised."""


@dataclass(frozen=True, kw_only=True)
class Undecided(SourceOptions):
    """Says what images do not decide: for each stretch, the weakest combination of scale, focal length, principal
    point, distortion, clock and mounts, how far it may be off, and which motion would decide it. With --distance, the
    same before anything is recorded: SOURCE is then a file of poses, and --camera the calibration."""

    source: tyro.conf.Positional[str]
    """A recording with a calibration: any source that `ispom run` takes. With --distance, poses of any program."""
    distance: float | None = None
    """SOURCE is a motion before it is recorded: its poses, and points about so far away, in the unit of the poses."""
    seconds: Annotated[float, Range(0.2, 60)] = SECONDS
    """Length of a stretch."""
    step: Annotated[float, Range(0.1, 600)] = STEP_S
    """Time from the start of a stretch to that of the next [s]."""
    json: bool = False
    """Print the answer as JSON."""
    out: Path | None = None
    """Folder for undecided.json and undecided.csv, which has a row for each stretch."""
    plot: Path | None = None
    """SVG file for a picture on the time axis; needs the extra `plots`."""
