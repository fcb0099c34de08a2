"""The options of `ispom bench`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...engine.options import Name


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measures speed, memory and accuracy of every method, together with the figures of other programs."""

    data: Path = Path("data")
    """Folder that holds KITTI odometry (kitti/sequences/06 and 00), EuRoC (V1_01_easy) ...; missing ones are skipped.
    The simulations need none."""
    sources: tuple[str, ...] = ()
    """Sources to measure, such as sim-tiny or kitti-06; none given means all."""
    methods: tuple[Name, ...] = ()
    """Methods to measure; none given means all."""
    runs: int = 3
    """Runs of each; the medians of their times are reported."""
    blocks: bool = True
    """Measure the building blocks, too: bundle adjustment of a window, rendering, logging, opening."""
    json: Path | None = None
    """Write all numbers as JSON to this file."""
