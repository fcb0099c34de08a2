"""One image: its target, the reason why it is not used, or a hint at what it shows instead."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ispom.calibration.detection.detection import Detection
from ispom.calibration.detection.patterns import detect_chessboard, detect_circles
from ispom.calibration.detection.tags import decoded, detect_markers, single_tags
from ispom.calibration.targets.layouts import parse_target
from ispom.calibration.targets.target import Target
from ispom.geometry import Array
from ispom.types import Image, as_grey

LEAST_POINTS = 8
"""A pose and two more numbers: fewer points do not constrain the camera."""
BLURRED_PX = 0.15
"""Images whose corners are this uncertain at the median are rejected,"""
VAGUE_PX = 1.0
"""and single corners beyond this."""


def detect(target: Target, image: Image) -> Detection:
    """Returns the target's points in an image (H, W) or (H, W, 3) RGB. Deterministic."""
    grey = as_grey(image)
    if target.kind == "chessboard":
        found = detect_chessboard(target, grey)
    elif target.tags:
        found = detect_markers(target, grey)
    else:
        found = detect_circles(target, grey)
    return found if found.reason else checked(found)


def checked(found: Detection) -> Detection:
    """Without corners that are vague; the whole image rejected where it is blurred, or shows too little."""
    if len(found) >= LEAST_POINTS and sorted(found.sigma_px)[len(found) // 2] > BLURRED_PX:
        blurred = sorted(found.sigma_px)[len(found) // 2]
        return Detection(reason=f"blurred: corners uncertain by {blurred:.1f} px")
    found = found.only(found.sigma_px <= VAGUE_PX, "vague")
    if len(found) < LEAST_POINTS:
        return Detection(reason=f"only {len(found)} points of the target, {LEAST_POINTS} are needed")
    return found


# A check of the tags' arrangement: with a gap in metres instead of a share, or other columns, a few tags per image
# would fit, and the calibration would fail for no visible reason.

REACH = 4.0
"""The next tag is at most this far away, in sides of a tag,"""
ALIGNED = 0.25
"""and at most this share of its distance aside."""
LEAST = 6
"""Least number of pairs of neighbours for a result,"""
AGREE = 0.6
"""and the share of them that must have the same numbers."""
TOLERANCE = 0.06
"""Tolerance of the distance of two tags: a wide lens and a single tag's corners measure it to some per cent."""


@dataclass(frozen=True)
class Layout:
    """The arrangement of a board's tags."""

    pitch: float
    """Distance of tags in a row, in sides of a tag."""
    across: int
    """Increase of the number from a tag to the next in its row, and to the one below."""
    down: int
    rows: int
    """Number of rows by the largest detected number."""


def layout_fault(target: Target, images: Iterable[Image]) -> str:
    """Returns one clause that describes how the board in the images differs, with the target to use instead.

    Empty where it does not, where too few tags are detected, and for boards without tags or with squares between them.
    """
    if target.kind not in ("aprilgrid", "tags"):
        return ""
    seen = _layout(target, images)
    if seen is None:
        return ""
    kind, _, tag_m, gap, *rest = target.spec.split(":")
    wrong = []
    if abs(seen.across) == 1 and abs(seen.down) != target.columns:
        wrong.append(f"the board in the images has {abs(seen.down)} tags in a row, not {target.columns}")
    pitch = target.pitch_m / target.tag_side_m
    share = max(seen.pitch - 1, 0.0)
    if abs(seen.pitch / pitch - 1) > TOLERANCE:
        wrong.append(f"gaps between the tags are {share:.2f} of a tag's side wide in the images, not {pitch - 1:.2g}")
        if kind == "aprilgrid" and abs((1 + float(gap) / target.tag_side_m) / seen.pitch - 1) < TOLERANCE:
            wrong[-1] += " (the gap of an aprilgrid is a share of the side, not metres)"
            gap = f"{float(gap) / target.tag_side_m:.3g}"
        elif kind != "aprilgrid" and abs((1 + float(gap)) / seen.pitch - 1) < TOLERANCE:
            wrong[-1] += " (the gap of this board is in metres, not a share of the side)"
            gap = f"{float(gap) * target.tag_side_m:.3g}"
        else:
            gap = f"{share:.2g}" if kind == "aprilgrid" else f"{share * target.tag_side_m:.2g}"
    if not wrong:
        return ""
    columns = abs(seen.down) if abs(seen.across) == 1 else target.columns
    rows = max(target.rows, seen.rows) if columns == target.columns else seen.rows
    better = ":".join((kind, f"{columns}x{rows}", tag_m, gap, *rest))
    return f"{' and '.join(wrong)}: give a --target such as {better}"


def _layout(target: Target, images: Iterable[Image]) -> Layout | None:
    own = target.tags[0].corners_m
    square = ((own - own.mean(0)) / target.tag_side_m).astype(np.float32)
    across: list[tuple[int, float]] = []
    down: list[tuple[int, float]] = []
    highest = 0
    for image in images:
        tags = single_tags(target, as_grey(image))
        highest = max([highest, *tags])
        for number, corners in tags.items():
            others = {n: _seen_from(square, corners, c) for n, c in tags.items() if n != number}
            for found, axis in ((across, 0), (down, 1)):
                ahead = {n: xy for n, xy in others.items() if _is_ahead(xy, axis)}
                if ahead:
                    nearest = min(ahead, key=lambda n: ahead[n][axis])
                    found.append((nearest - number, float(ahead[nearest][axis])))
    steps = [Counter(step for step, _ in found).most_common(1) for found in (across, down)]
    for found, most in zip((across, down), steps, strict=True):
        if len(found) < LEAST or most[0][1] < AGREE * len(found):
            return None
    (sideways, _), (below, _) = steps[0][0], steps[1][0]
    pitch = float(np.median([away for step, away in across if step == sideways]))
    columns = max(abs(below), 1)
    return Layout(pitch, sideways, below, -(-(highest + 1) // columns))


def _seen_from(square: Array, corners: Array, other: Array) -> Array:
    """(2,) the centre of another tag, in sides of this one along the board's axes from its centre."""
    board_from_image = cv2.getPerspectiveTransform(corners.astype(np.float32), square.astype(np.float32))
    return cv2.perspectiveTransform(other.reshape(-1, 1, 2), board_from_image).reshape(-1, 2).mean(0)


def _is_ahead(xy: Array, axis: int) -> bool:
    return bool(np.isfinite(xy).all() and 0.5 < xy[axis] < REACH and abs(xy[1 - axis]) < ALIGNED * xy[axis])


_OTHERS = ("aprilgrid:6x6:0.088:0.3", "apriltag:6x6:0.08:0.02", "aruco:10x5:0.04:0.01", "aruco:10x10:0.04:0.01:6X6_250")
_LEAST_TAGS = 3


def common_hint(target: Target, images: Iterable[Image]) -> str:
    """Returns the most frequent hint of the images: boards are cut in some. The larger board wins a tie."""
    said = Counter(text for image in images if (text := hint(target, image)))
    return max(said, key=lambda text: (said[text], _corners_in(text)), default="")


def hint(target: Target, image: Image) -> str:
    """Returns one clause, such as "the images show a chessboard of 8x6 inner corners"; empty where nothing is
    recognised."""
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
    """Returns the inner corners of the largest chessboard that OpenCV detects."""
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    for start in ((5, 4), (4, 3), (3, 3)):
        found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, start, flags)
        if found and meta is not None:
            rows, columns = meta.shape[:2]
            return max(columns, rows), min(columns, rows)
    return None
