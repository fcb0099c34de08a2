"""Points of boards that carry tags: corners of the tags themselves, or of the squares between them (ChArUco)."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.calibration.detection.corners import refined, spreads_px
from ispom.calibration.detection.detection import Detection
from ispom.calibration.detection.tags import INSIDE_PX, WINDOW, decoded, found_tags
from ispom.calibration.targets import Target
from ispom.geometry import Array
from ispom.types import Image

CHARUCO_REACH = 1.6
"""A corner of squares follows from the tags within so many squares."""
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
    """Each corner from the plane through the tags around it; refined, and kept where it stays in place."""
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
    """A small tag's side."""
    sides = [np.linalg.norm(c - np.roll(c, 1, axis=0), axis=1).min() for c in tags.values()]
    return float(np.percentile(sides, 25))
