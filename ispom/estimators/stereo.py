"""Stereo (section 6.2). Settings first; the estimator follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from ispom.settings import Range
from ispom.types import Rig


@dataclass(frozen=True)
class StereoConfig:
    """Settings of the stereo estimator (section 6.2)."""

    matching: Literal["sift", "klt"] = "sift"
    """How consecutive left images correspond: descriptors survive metres between pairs, tracking is faster."""
    max_points: Annotated[int, Range(50, 5000)] = 1200
    """Points looked for in each left image."""

    def build(self, rig: Rig):
        raise NotImplementedError
