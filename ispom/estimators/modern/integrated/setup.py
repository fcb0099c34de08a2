"""The rig and the settings of the integrated method, in the units that are computed with."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.estimators.modern.integrated.view import RigNoise
from ispom.types import Rig

MIN_POINTS = 8
"""Fewer known points than this, and an exposure is placed by the motion before it."""


@dataclass(frozen=True, eq=False)
class Setup:
    """See ModernIntegratedConfig for what the settings mean."""

    rig: Rig
    noise: RigNoise
    window_pairs: int
    max_views: int
    max_points: int
    knot_frames: float
    knot_misfit: float
    iterations: int
    follow_stereo: bool
