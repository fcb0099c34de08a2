"""Simulated pictures of a target, for the tests."""

from __future__ import annotations

from ispom.calibration.targets.drawing import MARGIN_M, raster
from ispom.calibration.targets.target import Target
from ispom.simulation.filmed_board import Picture

LONGER_SIDE_PX = 1800


def picture_of(target: Target) -> Picture:
    pixels_per_m = LONGER_SIDE_PX / (max(target.size_m) + 2 * MARGIN_M)
    return Picture(raster(target, pixels_per_m), pixels_per_m, MARGIN_M)
