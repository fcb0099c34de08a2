"""Options of `ispom doctor`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import MovedSource, Programs

FRAMES, SECONDS = 45, 60.0
"""Default number of frames of an examination, and default seconds for it."""


@dataclass(frozen=True, kw_only=True)
class Doctor(Programs, MovedSource):
    """Says which cause best explains a bad stretch of a run, and what to do about it."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    at: int | None = None
    """Frame in the bad stretch, counted from 0. Default: that of the worst event of the run."""
    frames: Annotated[int, Range(8, 400)] = FRAMES
    """Frames of the main camera (video, else stereo) that are examined, most of them before that one."""
    seconds: Annotated[float, Range(1, 3600)] = SECONDS
    """Seconds after which no new suspect is examined."""
    out: Path | None = None
    """Folder for doctor.json, with all figures."""
