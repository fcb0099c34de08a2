"""Options of `ispom blame`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...engine.options import MovedSource, Programs


@dataclass(frozen=True, kw_only=True)
class Blame(Programs, MovedSource):
    """Says what moved the pose of one frame of a run, and by how much: tracks, groups of them, keyframes, priors and
    sensors, each left out of what the method solved there."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    at: int
    """The frame, counted from 0 as in the page and in steps.csv."""
    method: Annotated[str, tyro.conf.arg(metavar="METHOD", help_behavior_hint="")] = ""
    """Whose pose; default: the first method of the run that has one at this frame."""
    check: bool = False
    """Also run the frame again without the tracks of each row, from the state before, and show that beside it."""
    out: Path | None = None
    """Folder for blame.csv, which has every part."""
