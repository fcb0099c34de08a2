"""Options of `ispom publish`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from ...engine.options import Programs, ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Publish(Programs, ReadsRuns):
    """Writes a finished run as a folder that any web server shows without Python: stage, verdicts, time dock."""

    READS: ClassVar[tuple[str, ...]] = ("runs",)
    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `ispom run` wrote. The first is shown; further ones on the same source are compared with it."""
    out: Path
    """A new or empty folder, or one that this command wrote before."""
    max_mb: float = 23.0
    """Limit on the size of the folder [MB]. Images are stored in a lower quality, or left out, where it takes that."""
