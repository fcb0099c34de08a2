"""Calibration targets: their points, and how they are printed."""

from ispom.calibration.targets.spec import parse_target
from ispom.calibration.targets.target import Disc, Rectangle, Tag, Target

__all__ = ["Disc", "Rectangle", "Tag", "Target", "parse_target"]
