"""Targets in images: which of their points are seen where, how precisely, and why others are rejected."""

from ispom.calibration.detection.detect import detect
from ispom.calibration.detection.detection import Detection

__all__ = ["Detection", "detect"]
