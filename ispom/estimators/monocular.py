"""Monocular (section 6.1). Settings first; the estimator follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from ispom.settings import Range
from ispom.types import Rig


@dataclass(frozen=True)
class MonocularConfig:
    """Settings of the monocular estimator (section 6.1)."""

    scale_transfer: Literal["norm", "vector", "depth", "unit"] = "norm"
    """How a triple of key frames takes over the unit: norm as printed (shrinks on bends), vector |T13 - T12|,
    depth the ratio of shared points' depths, unit every step 1 long (line C)."""
    local_bundle: bool = False
    """Local bundle adjustment after each key frame (line D)."""
    interpolation: Literal["linear", "bspline"] = "bspline"
    """First guess of positions between key frames; rotations are interpolated spherically."""
    max_tracks: Annotated[int, Range(50, 2000)] = 400
    """Points tracked at a time."""
    min_parallax_px: Annotated[float, Range(1, 200)] = 12.0
    """Median displacement since the last key frame that makes the next one."""

    def build(self, rig: Rig):
        raise NotImplementedError
