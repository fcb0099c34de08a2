"""Options of `ispom shrink`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...engine.options import MovedSource, Options

TRIALS = 200
"""Each of 30 frames that are all needed takes two trials, and what comes before that takes some 30."""
NEAR = 5
"""A map that begins later has other points, and its checks fail a few frames sooner or later. How many is not measured:
a few are less than a person would call another failure."""


@dataclass(frozen=True, kw_only=True)
class Shrink(Options, MovedSource):
    """Finds the smallest clip in which a failure remains, and writes it as a folder for an issue of any program:
    recording, command and expected event. Drops methods and cameras, and bisects end, begin, frame rate and size.

    The exit code is 0 where a clip was written (with --verify: the event is there), 1 where the failure does not
    happen again, and 2 for a mistake in what you gave."""

    run: tyro.conf.Positional[str]
    """Folder that `ispom run` wrote, whose methods and settings are taken; or a source as for `ispom run`. With
    --verify: a folder that this command wrote."""
    event: int | None = None
    """Row of the event in events.csv, from 0. Default: the first warning or loss."""
    kind: str | None = None
    """Instead of --event: the first event of this kind, such as lost, scale, pair or segment."""
    out: Path = Path("shrunk")
    """Folder to write to: new or empty."""
    zip: bool = False
    """Write a zip file of the folder beside it, too."""
    private: bool = False
    """Draw the tracked points in place of the images, if the event remains with them."""
    verify: bool = False
    """Only say whether the expected event happens in a folder that this command wrote."""
    trials: int = TRIALS
    """Most clips that are run."""
    near: int = NEAR
    """The event is the same where kind, method and failed check are, it begins within this number of frames of the
    recording, and the method saw the recording's frame before it, or none."""
