"""Options of `ispom repair`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...engine.options import Programs


@dataclass(frozen=True, kw_only=True)
class Repair(Programs):
    """Repairs what a killed run left: completes recordings, writes trajectories and metrics up to where it ended."""

    folder: tyro.conf.Positional[Path]
    """Folder of an incomplete run, or a folder that holds recordings and such folders."""
