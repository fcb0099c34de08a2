"""Options of `ispom publish`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from ...engine.options import Programs, ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Publish(Programs, ReadsRuns):
    """Writes finished runs, the lessons or ways to fail as a folder that any web server shows without Python."""

    READS: ClassVar[tuple[str, ...]] = ("runs",)
    runs: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Folders that `ispom run` wrote. The first is shown; further ones on the same source are compared with it.
    With --lessons: names of lessons, or Markdown files of your own; none means all that come with ISPOM."""
    out: Path
    """A new or empty folder, or one that this command wrote before."""
    lessons: bool = False
    """Publish lessons: their runs are computed now, and the page has their answers."""
    failures: bool = False
    """Publish eight ways to fail, each a simulated run with the doctor's answer."""
    max_mb: float | None = None
    """Limit on the size of the folder [MB]; default: 23, with --lessons 80, with --failures 50. Images are stored in a
    lower quality, or left out, where it takes that."""
