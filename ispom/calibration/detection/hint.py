"""What is in an image in which the target was not found: another board, or a mirrored one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

import cv2
import numpy as np

from ispom.calibration.detection.detect import detect
from ispom.calibration.detection.tags import decoded
from ispom.calibration.targets import Target, parse_target
from ispom.types import Image, as_grey

_OTHERS = ("aprilgrid:6x6:0.088:0.3", "apriltag:6x6:0.08:0.02", "aruco:10x5:0.04:0.01", "aruco:10x10:0.04:0.01:6X6_250")
_LEAST_TAGS = 3


def common_hint(target: Target, images: Iterable[Image]) -> str:
    """What most of the images in which something is known say, as `hint`: boards are cut in some. Of two that are said
    as often, the larger board."""
    said = Counter(text for image in images if (text := hint(target, image)))
    return max(said, key=lambda text: (said[text], _corners_in(text)), default="")


def hint(target: Target, image: Image) -> str:
    """One clause, such as "the images show a chessboard of 8x6 inner corners"; empty where nothing is known."""
    grey = as_grey(image)
    if target.tags and not detect(target, np.ascontiguousarray(grey[:, ::-1])).reason:
        return "the images are mirrored, give them as the camera saw them"
    if target.tags and (tags := decoded(target, grey)):
        own = {tag.number for tag in target.tags}
        if strange := sorted(set(tags) - own):
            return f"the board in the images has tags up to number {strange[-1]}, give its size as --target"
    size = _chessboard(grey)
    if size and target.kind != "charuco":
        return f"the images show a chessboard of {size[0]}x{size[1]} inner corners, give that as --target"
    for spec in _OTHERS:
        other = parse_target(spec)
        same = (other.dictionary, other.border_bits) == (target.dictionary, target.border_bits)
        if not same and len(decoded(other, grey)) >= _LEAST_TAGS:
            return f"the images show tags of {other.dictionary}, as of an {other.kind} target, give that as --target"
    return ""


def _corners_in(text: str) -> int:
    size = re.search(r"(\d+)x(\d+)", text)
    return int(size[1]) * int(size[2]) if size else 0


def _chessboard(grey: Image) -> tuple[int, int] | None:
    """Inner corners of the largest chessboard that OpenCV sees."""
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    for start in ((5, 4), (4, 3), (3, 3)):
        found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, start, flags)
        if found and meta is not None:
            rows, columns = meta.shape[:2]
            return max(columns, rows), min(columns, rows)
    return None
