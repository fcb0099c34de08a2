"""Boards of coded tags, and the squares between them (ChArUco): OpenCV decodes tags, and predicts where others are.

A tag that the decoder missed (small, slanted, at the border) is searched where its neighbours predict it, and used
where the image there agrees with its code.
"""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.detection.detection import Detection, outlined, refined, spreads_px
from ispom.calibration.targets.layouts import dictionary_of, marker_cells
from ispom.calibration.targets.target import Tag, Target
from ispom.geometry import Array
from ispom.types import Image

AGREES = 0.6
"""Least correlation of a tag's image with its code."""
NEIGHBOURS = 4
"""Number of tags that predict another one."""
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
    """Returns the numbers of the tags whose corners fit one plane, up to a lens distortion of one tag's side."""
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
    """Returns the numbers of the nearest known tags."""
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
    """Returns the refined corners where the image between them is the tag's, else None."""
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


CHARUCO_REACH = 1.6
"""Largest distance, in squares, of the tags that predict a corner of squares."""
CHARUCO_WINDOW = 0.2
"""Half side of its window, of a square's side, where no marker is nearer,"""
CHARUCO_GAP = 0.85
"""or of the gap between the marker and its square."""


def detect_markers(target: Target, grey: Image) -> Detection:
    """Points of all tags that are there, or of the squares between them."""
    seeds = decoded(target, grey)
    own = {tag.number for tag in target.tags}
    if not seeds:
        return Detection(reason="no tag found")
    foreign = sorted(set(seeds) - own)
    if len(foreign) > len(own & seeds.keys()) // 2:
        shown = ", ".join(map(str, foreign[:4]))
        return Detection(reason=f"tags that the target does not have ({shown})")
    tags = found_tags(target, grey, {n: c for n, c in seeds.items() if n in own})
    if not tags:
        return Detection(reason="no tag of the target where the board would have it")
    return _of_squares(target, grey, tags) if target.kind == "charuco" else _of_tags(target, grey, tags)


def _of_tags(target: Target, grey: Image, tags: dict[int, Array]) -> Detection:
    points = {tag.number: tag.points for tag in target.tags}
    ids = np.concatenate([points[n] for n in tags])
    uv = np.concatenate(list(tags.values()))
    return Detection.of(ids, uv, spreads_px(grey, uv, WINDOW * _side_px(tags)))


def _of_squares(target: Target, grey: Image, tags: dict[int, Array]) -> Detection:
    """Predicts each corner by the plane through the tags around it, refines it, and keeps it where it stays in
    place."""
    layout = {tag.number: tag.corners_m for tag in target.tags}
    px_per_m = _side_px(tags) / target.tag_side_m
    gap_m = (target.pitch_m - target.tag_side_m) / 2
    radius_px = px_per_m * min(CHARUCO_WINDOW * target.pitch_m, CHARUCO_GAP * gap_m)
    ids, start = [], []
    for i, point in enumerate(target.xyz_in_board[:, :2]):
        near = [n for n in tags if np.linalg.norm(layout[n].mean(0) - point) < CHARUCO_REACH * target.pitch_m]
        if len(near) < 2:
            continue
        board, image = np.concatenate([layout[n] for n in near]), np.concatenate([tags[n] for n in near])
        homography, _ = cv2.findHomography(board, image)
        if homography is not None:
            ids.append(i)
            start.append(cv2.perspectiveTransform(point.reshape(1, 1, 2), homography)[0, 0])
    if not ids:
        return Detection(reason="no corner between two tags")
    expected = np.array(start)
    uv = refined(grey, expected, radius_px)
    limit = np.array(grey.shape[::-1]) - 1 - INSIDE_PX
    good = (uv >= INSIDE_PX).all(1) & (uv <= limit).all(1)
    good &= np.linalg.norm(uv - expected, axis=1) < radius_px
    return Detection.of(np.array(ids), uv, spreads_px(grey, uv, radius_px)).only(good, "not at a corner")


def _side_px(tags: dict[int, Array]) -> float:
    """Returns a small tag's side."""
    sides = [np.linalg.norm(c - np.roll(c, 1, axis=0), axis=1).min() for c in tags.values()]
    return float(np.percentile(sides, 25))
