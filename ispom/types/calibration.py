"""How sure a calibration is of what it says: standard deviations, which the methods start from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LensSigma:
    """Of a camera by itself; 0 where it is exact."""

    focal: float
    """Of its focal length, as a share."""
    radial: float
    """Of its radial distortion k1."""


@dataclass(frozen=True)
class PairSigma:
    """Of a rectified pair; 0 where it is exact."""

    offset_px: float
    """Of how far off disparities and rows are in the middle of the image."""
    turn_deg: float
    """Of how the right camera is turned about each of its axes."""
    focal: float
    """Of its focal length against the left one's, as a share."""
    radial: float
    """Of the radial distortion k1 and k2 of both, and of the right one's beside."""
    decentring: float
    """Of the right one's decentring distortion p1 and p2."""
    lag_s: float
    """Of how late its shutter is."""


EXACT_LENS = LensSigma(0.0, 0.0)
EXACT_PAIR = PairSigma(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
