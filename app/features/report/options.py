"""Options of `ispom report`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from ...engine.options import Programs, ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Report(Programs, ReadsRuns):
    """Writes an HTML report of one or several runs, a single file that needs no network."""

    READS: ClassVar[tuple[str, ...]] = ("runs",)
    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `ispom run` wrote; several are shown side by side."""
    out: Path = Path("report.html")
    """The file to write."""
