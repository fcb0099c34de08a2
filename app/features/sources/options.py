"""Options of `ispom sources`."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from ...engine.options import Options


@dataclass(frozen=True, kw_only=True)
class Sources(Options):
    """Describes a source without running anything: cameras, calibration, rates, gaps, ground truth."""

    source: tyro.conf.Positional[str]
    """sim:NAME, a path (a data set's folder, images, a video file ...), or a live camera (camera:0, http://...)."""
