"""Grids of circles, by OpenCV. A tilted circle's picture has its centre beside the picture of its centre; that is not
corrected (0.17 px at the median where circles are large)."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.detection.detection import Detection
from ispom.calibration.targets import Target
from ispom.geometry import Array
from ispom.types import Image

SIGMA_PX = 0.1
"""Of a blob's centre of some ten pixels' diameter."""


def detect_circles(target: Target, grey: Image) -> Detection:
    """All centres of the grid, or none."""
    size = (target.columns, target.rows)
    flag = cv2.CALIB_CB_ASYMMETRIC_GRID if target.kind == "acircles" else cv2.CALIB_CB_SYMMETRIC_GRID
    for blobs in _blob_detectors(grey):
        for flags in (flag, flag | cv2.CALIB_CB_CLUSTERING):
            found, centres = cv2.findCirclesGrid(grey, size, flags=flags, blobDetector=blobs)
            if found:
                grid = _oriented(target, np.asarray(centres, float).reshape(target.rows, target.columns, 2))
                return Detection.of(np.arange(len(target)), grid.reshape(-1, 2), np.full(len(target), SIGMA_PX))
    return Detection(reason="no board found")


def _blob_detectors(grey: Image) -> list[cv2.SimpleBlobDetector]:
    """OpenCV's own takes blobs of up to 5000 px only."""
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.maxArea = grey.size / 50
    parameters.minArea = 12
    parameters.minDistBetweenBlobs = 4
    return [cv2.SimpleBlobDetector.create(parameters)]


def _oriented(target: Target, grid: Array) -> Array:
    """x to the right and y down as one looks at the board; of two ways, the one whose x points more to the right."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if target.kind == "circles":
        if across[0] * down[1] - across[1] * down[0] < 0:
            grid = grid[:, ::-1]
        return grid if (grid[0, -1] - grid[0, 0])[0] >= 0 else grid[::-1, ::-1]
    return grid
