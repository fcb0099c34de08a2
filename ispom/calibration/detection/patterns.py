"""Chessboards and grids of circles, detected by OpenCV and oriented here.

Of the rotations of a chessboard onto itself those are valid in which the first inner square is black. Of several, the
one whose x axis points most to the right is used: the same one for cameras that stand upright next to each other.
"""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.detection.detection import Detection, refined, spreads_px
from ispom.calibration.targets.target import Target
from ispom.geometry import Array
from ispom.types import Image

SEARCHED_PX = 1300
"""Boards are searched in images of at most this width."""
CHEQUERED = 0.7
"""Least correlation of the squares' brightness with a chessboard."""
WINDOW = 0.35
"""Half side of the window for a corner, of the distance to the next."""


def detect_chessboard(target: Target, grey: Image) -> Detection:
    """Detects all corners of the board, or none: a part of a board is ambiguous."""
    size = (target.columns, target.rows)
    grid = found_grid(grey, size)
    if grid is None or not chequered(grey, grid):
        return Detection(reason="no board found")
    if larger_than(grey, grid):
        return Detection(reason=f"the board continues beyond {size[0]}x{size[1]} corners")
    grid = oriented(grey, grid)
    steps = np.concatenate([np.linalg.norm(np.diff(grid, axis=a), axis=2).ravel() for a in (0, 1)])
    radius_px = WINDOW * float(np.percentile(steps, 10))
    uv = refined(grey, grid.reshape(-1, 2), radius_px)
    return Detection.of(np.arange(len(uv)), uv, spreads_px(grey, uv, radius_px))


def found_grid(grey: Image, size: tuple[int, int]) -> Array | None:
    """(rows, columns, 2) corners to about a pixel, in one of the orders that fit the size; None where there is none."""
    factor = min(1.0, SEARCHED_PX / max(grey.shape))
    small = grey if factor == 1 else cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
        found, corners = cv2.findChessboardCorners(small, size, flags=flags)
    if not found:
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
        found, corners = cv2.findChessboardCornersSB(small, size, flags=flags)
    if not found:
        return None
    return (np.asarray(corners, float).reshape(size[1], size[0], 2) + 0.5) / factor - 0.5


def oriented(grey: Image, grid: Array) -> Array:
    """Returns the grid (R, C, 2) in the order of the target's points."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid = grid[:, ::-1]
    turns = [grid, grid[::-1, ::-1]]
    if grid.shape[0] == grid.shape[1]:
        quarter = grid.transpose(1, 0, 2)[:, ::-1]
        turns += [quarter, quarter[::-1, ::-1]]
    dark = [turn for turn in turns if first_square_is_black(grey, turn)]
    return max(dark or turns, key=lambda turn: _cosine(turn[0, -1] - turn[0, 0]))


def first_square_is_black(grey: Image, grid: Array) -> bool:
    """Returns whether the square between the corners (0, 0) and (1, 1) is darker than its neighbours within the
    grid."""
    return _chequer(grey, grid) < 0


def chequered(grey: Image, grid: Array) -> bool:
    """Returns whether the squares between the corners alternate between light and dark."""
    return abs(_chequer(grey, grid)) > CHEQUERED


def _chequer(grey: Image, grid: Array) -> float:
    """Correlation of the squares' brightness with a chessboard whose first square is white."""
    squares = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.round(squares).astype(int).reshape(-1, 2).T
    brightness = grey[y.clip(0, grey.shape[0] - 1), x.clip(0, grey.shape[1] - 1)].astype(float)
    first = (np.add.outer(np.arange(squares.shape[0]), np.arange(squares.shape[1])) % 2 == 0).ravel()
    return float(np.corrcoef(brightness, first)[0, 1]) if brightness.std() > 0 else 0.0


def larger_than(grey: Image, grid: Array) -> bool:
    """Returns whether the pattern continues for another whole row or column on any side of the grid."""
    return any(
        _goes_on(grey, side) for side in (grid, grid[::-1], grid.transpose(1, 0, 2), grid.transpose(1, 0, 2)[::-1])
    )


def _goes_on(grey: Image, grid: Array) -> bool:
    """Returns whether there is a row of corners before the first one: then squares alternate two steps before it
    too."""
    inner = (grid[0, :-1] + grid[0, 1:]) / 2
    step = grid[0] - grid[1]
    outward = (step[:-1] + step[1:]) / 2
    rows = [_sampled(grey, inner + share * outward) for share in (0.5, 1.5)]
    if any(row is None for row in rows):
        return False
    sign = np.where(np.arange(len(inner)) % 2, -1.0, 1.0)
    contrasts = [float((sign * row).sum() / len(sign)) for row in rows if row is not None]
    spread = [float(np.std(row)) for row in rows if row is not None]
    alternates = len(sign) >= 3 and abs(contrasts[1]) > 0.6 * abs(contrasts[0]) and abs(contrasts[1]) > 0.6 * spread[1]
    return bool(alternates and contrasts[0] * contrasts[1] < 0)


def _sampled(grey: Image, uv: Array) -> Array | None:
    """Returns grey values (N,); None where one is outside of the image."""
    x, y = np.round(uv).astype(int).T
    if x.min() < 0 or y.min() < 0 or x.max() >= grey.shape[1] or y.max() >= grey.shape[0]:
        return None
    row = grey[y, x].astype(float)
    return row - row.mean()


def _cosine(direction: Array) -> float:
    return float(direction[0] / max(float(np.hypot(*direction)), 1e-9))


SIGMA_PX = 0.1
"""Standard deviation of the centre of a blob of some ten pixels."""


def detect_circles(target: Target, grey: Image) -> Detection:
    """Detects all centres of the grid, or none.

    The centre of a tilted circle's image differs from the image of its centre; that is not corrected (0.17 px at the
    median for large circles).
    """
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
    """Orients the grid, x to the right and y down for a viewer; of two ways, the one whose x points more to the
    right."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if target.kind == "circles":
        if across[0] * down[1] - across[1] * down[0] < 0:
            grid = grid[:, ::-1]
        return grid if (grid[0, -1] - grid[0, 0])[0] >= 0 else grid[::-1, ::-1]
    return grid
