"""The rig and the settings of the integrated method, in the units of the computation."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.estimators.modern.integrated.view import RigNoise
from ispom.types import Rig

MIN_POINTS = 8
"""Least number of known points for a resection: with fewer a frame is not localised by points."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Rig and settings; ModernIntegratedConfig describes the settings."""

    rig: Rig
    noise: RigNoise
    window_pairs: int
    max_views: int
    max_points: int
    knot_frames: float
    knot_misfit: float
    iterations: int
    follow_stereo: bool
