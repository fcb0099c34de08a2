"""Boards of coded tags: OpenCV decodes what it can, and the others follow from where the board must have them.

A tag that the decoder missed (small, slanted, at the border) is looked for where its neighbours say, and counts where
its picture there agrees with its code.
"""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.detection.corners import refined
from ispom.calibration.detection.outline import outlined
from ispom.calibration.targets import Tag, Target
from ispom.calibration.targets.layouts import dictionary_of, marker_cells
from ispom.geometry import Array
from ispom.types import Image

AGREES = 0.6
"""Least correlation of a tag's picture with its code."""
NEIGHBOURS = 4
"""Tags that say where another one is."""
SUPPORT = 3.5
"""Neighbours are at most this far away, in tags."""
WINDOW = 0.16
"""Half side of the window for a corner, of a tag's side in the image."""
INSIDE_PX = 2.0
"""Corners are at least this far from the image's border."""
MOVED = 0.3
"""A corner is at most this far from where it is expected, of a tag's side."""


def decoded(target: Target, grey: Image) -> dict[int, Array]:
    """Corners (4, 2) [px] by tag number, as OpenCV's detector has them: also numbers that the target does not have."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = target.border_bits
    parameters.minMarkerPerimeterRate = 0.015
    parameters.adaptiveThreshWinSizeMax = 43
    detector = cv2.aruco.ArucoDetector(dictionary_of(target.dictionary), parameters)
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return {}
    numbers = [int(i) for i in np.ravel(ids)]
    return {
        n: np.asarray(c, float).reshape(4, 2) for n, c in zip(numbers, corners, strict=True) if numbers.count(n) == 1
    }


def single_tags(target: Target, grey: Image) -> dict[int, Array]:
    """Refined corners (4, 2) [px] by tag number, each found by itself: wherever the target has them, or not at all."""
    found = {}
    for number, corners in decoded(target, grey).items():
        cells = marker_cells(target.dictionary, number, target.border_bits)
        if (refined_corners := _verified(target, grey, cells, corners)) is not None:
            found[number] = refined_corners
    return found


def found_tags(target: Target, grey: Image, seeds: dict[int, Array]) -> dict[int, Array]:
    """Refined corners (4, 2) [px] by tag number: of the seeds that agree with each other, and of all that follow."""
    tags = {tag.number: tag for tag in target.tags}
    cells = {n: marker_cells(target.dictionary, n, target.border_bits) for n in tags}
    known: dict[int, Array] = {}
    for number in _consistent(tags, seeds):
        if (corners := _verified(target, grey, cells[number], seeds[number])) is not None:
            known[number] = corners
    tried: dict[int, int] = {}
    while True:
        added = {}
        for number in sorted(tags.keys() - known.keys()):
            support = _support(tags, known, tags[number])
            if not support or tried.get(number) == len(support):
                continue
            tried[number] = len(support)
            corners = _verified(target, grey, cells[number], _predicted(tags, known, tags[number], support))
            if corners is not None:
                added[number] = corners
        if not added:
            return known
        known |= added


def _consistent(tags: dict[int, Tag], seeds: dict[int, Array]) -> list[int]:
    """Numbers of those whose corners fit one plane seen by a camera whose lens bends lines by a tag's side at most."""
    numbers = sorted(tags.keys() & seeds.keys())
    if len(numbers) < 2:
        return numbers
    board = np.concatenate([tags[n].corners_m for n in numbers])
    image = np.concatenate([seeds[n] for n in numbers])
    sides = [float(np.linalg.norm(seeds[n] - np.roll(seeds[n], 1, axis=0), axis=1).mean()) for n in numbers]
    _, inliers = cv2.findHomography(board, image, cv2.RANSAC, float(np.median(sides)))
    if inliers is None:
        return []
    good = np.atleast_1d(inliers.reshape(-1, 4).all(axis=1))
    return [n for n, keep in zip(numbers, good.tolist(), strict=True) if keep]


def _support(tags: dict[int, Tag], known: dict[int, Array], tag: Tag) -> list[int]:
    """Numbers of the nearest known tags."""
    side = float(abs(tag.corners_m[0] - tag.corners_m[2]).max())
    centre = tag.corners_m.mean(0)
    away = sorted((float(np.linalg.norm(tags[n].corners_m.mean(0) - centre)) / side, n) for n in known)
    return [n for distance, n in away if distance < SUPPORT][:NEIGHBOURS]


def _predicted(tags: dict[int, Tag], known: dict[int, Array], tag: Tag, support: list[int]) -> Array:
    """(4, 2) [px] where the tag must be, by the plane through its neighbours."""
    board = np.concatenate([tags[n].corners_m for n in support])
    image = np.concatenate([known[n] for n in support])
    homography, _ = cv2.findHomography(board, image)
    if homography is None:
        return np.full((4, 2), -1.0)
    return cv2.perspectiveTransform(tag.corners_m[None], homography)[0]


def _verified(target: Target, grey: Image, cells: Array, corners: Array) -> Array | None:
    """The refined corners where the picture between them is the tag's, else None."""
    height, width = grey.shape
    side = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min())
    if side < len(cells) or not _inside(corners, width, height):  # a pixel for a bit
        return None
    found = refined(grey, corners, WINDOW * side) if target.kind == "aprilgrid" else outlined(grey, corners)
    if np.linalg.norm(found - corners, axis=1).max() > MOVED * side or not _inside(found, width, height):
        return None
    return found if _agreement(grey, cells, found) > AGREES else None


def _inside(corners: Array, width: int, height: int) -> bool:
    return bool((corners >= INSIDE_PX).all() and (corners <= (width - 1 - INSIDE_PX, height - 1 - INSIDE_PX)).all())


def _agreement(grey: Image, cells: Array, corners: Array) -> float:
    """Correlation of the image at the cells' centres with the code."""
    side = len(cells)
    homography = cv2.getPerspectiveTransform(
        np.array([(0, 0), (side, 0), (side, side), (0, side)], np.float32), corners.astype(np.float32)
    )
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    places = cv2.perspectiveTransform(np.stack([x, y], -1).reshape(1, -1, 2), homography)[0].astype(np.float32)
    seen = cv2.remap(grey, places[:, 0], places[:, 1], cv2.INTER_LINEAR).ravel().astype(float)
    if seen.std() < 2:
        return 0.0
    return float(np.corrcoef(seen, cells.ravel())[0, 1])
