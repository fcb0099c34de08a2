"""Whether the tags in images sit as the target says: a gap in metres where a share is meant, or other columns, would
leave a few tags per image that fit, and a calibration that fails for no reason that can be seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ispom.calibration.detection.tags import single_tags
from ispom.calibration.targets import Target
from ispom.geometry import Array
from ispom.types import Image, as_grey

REACH = 4.0
"""The next tag is at most this far away, in sides of a tag,"""
ALIGNED = 0.25
"""and at most this share of its distance aside."""
LEAST = 6
"""Pairs of neighbours that are needed to say anything,"""
AGREE = 0.6
"""and the share of them that must have the same numbers."""
TOLERANCE = 0.06
"""Of the distance of two tags: a wide lens and a single tag's corners measure it to some per cent."""


@dataclass(frozen=True)
class Layout:
    """How the tags of a board follow each other."""

    pitch: float
    """From tag to tag in a row, in sides of a tag."""
    across: int
    """By how much the number grows from a tag to the next in its row, and to the one below."""
    down: int
    rows: int
    """By the largest number that was seen."""


def layout_fault(target: Target, images: Iterable[Image]) -> str:
    """One clause that says how the board in the images differs, with the target to give instead; empty where it does
    not, where too few tags are seen, and for boards without tags or with squares between them."""
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
