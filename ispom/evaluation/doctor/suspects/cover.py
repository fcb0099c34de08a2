"""A cover on the lens: a part of the image that is always dark and uniform, although the scene is not.

The sky of the moon, a night and a dark room are dark and uniform, too, and in a drive their border does not move. So
darkness alone proves nothing. If another camera of the rig sees light in the same directions, there is a cover; if it
sees darkness, too, there is none. In a single camera two things show a cover. Corners move into the dark part and end
at its border, and the border stays an edge while the scene passes across it. The border of a sky or a wall moves along
with the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image

from ..examination import Examination
from ..finding import Finding, Suspect
from ..stretch import Shot
from .lens import fixed_edges

BLOCK_PX = 20
COVERED_LEVELS, COVERED_STD = 45.0, 4.0
"""Grey level and its standard deviation in a block of an image, of something dark before the lens."""
COVERED_SHARE = 0.12
"""Least share of the image's area that is covered, in half of the frames or more."""
ALWAYS = 0.9
"""Share of the frames in which a block is dark, so that it is so all the time."""
LEAST_BLOCKS = 4
"""Least number of blocks of the dark part that another camera sees."""
INTO_PX = 0.3
"""Least motion from frame to frame of a corner that moves into the dark part: more than the noise of three steps."""
STEPS = 3
ENDS = 5
"""Corners that end in this way; none at the sky of a simulated moon (seeds 0 to 3), 25 and more at a cover where the
scene passes it."""
BORDER_PASSED, BORDER_STAYS = 0.5, 0.4
"""Least share of the border of the dark part across which the scene must move for a test, and least share of it that
stays an edge: 0.49 and more at covers on simulations and recordings, 0 at the sky of a simulated moon."""


@dataclass(frozen=True, eq=False)
class Dark:
    """The part of a camera's images that is dark and uniform."""

    camera: str
    share: float
    """Share of the image that is always dark; or nearly the whole image, if it is dark in half of the frames."""
    always: NDArray[np.bool_]
    """(R, C) blocks."""
    shot: Shot
    """The darkest."""


def blocks(image: Image) -> tuple[Array, Array]:
    """Returns mean and standard deviation (H, W) of blocks of the image."""
    rows, columns = image.shape[0] // BLOCK_PX, image.shape[1] // BLOCK_PX
    cut = image[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    apart = cut.reshape(rows, BLOCK_PX, columns, BLOCK_PX)
    return apart.mean(axis=(1, 3)), apart.std(axis=(1, 3))


def covered(seen: Examination) -> Finding | None:
    """Measures the area of a camera's images that is always dark and uniform while others are bright, and tests by the
    other cameras and the tracks whether the scene is dark there. None where they cannot decide it."""
    bright = max((float(np.percentile(i, 90)) for s in seen.shots for i in s.images.values()), default=0.0)
    parts = [] if bright < 2 * COVERED_LEVELS else [dark for name in seen.rig.cameras if (dark := _dark(seen, name))]
    if not parts:
        return Finding(0.0, "No part of an image is dark and uniform all the time.", {"covered_share": 0.0})
    worst = max(parts, key=lambda dark: dark.share)
    text = f"{100 * worst.share:.0f} % of the {worst.camera} image is dark and uniform in all frames"
    values, frames = {"covered_share": worst.share}, (worst.shot.index,)
    if worst.share < COVERED_SHARE:
        return Finding(worst.share / COVERED_SHARE, f"{text}.", values, frames)
    judged = [(dark, _in_the_way(seen, dark)) for dark in parts if dark.share >= COVERED_SHARE]
    for dark, found in sorted(judged, key=lambda each: -each[0].share):
        if found:
            text = f"{100 * dark.share:.0f} % of the {dark.camera} image is dark and uniform in all frames"
            return Finding(dark.share / COVERED_SHARE, f"{text}. {found}", {"covered_share": dark.share}, frames)
    if any(found is None for _, found in judged):
        return None
    return Finding(0.0, f"{text}. It is dark to another camera, too, so nothing is in the way.", values, frames)


def _dark(seen: Examination, camera: str) -> Dark | None:
    own = [shot for shot in seen.shots if camera in shot.images]
    masks = []
    for shot in own:
        mean, std = blocks(shot.images[camera])
        masks.append((mean < COVERED_LEVELS) & (std < COVERED_STD))
    if not masks or not masks[0].size:
        return None
    always = _without_bars(np.mean(masks, axis=0) >= ALWAYS)
    shares = np.array([mask.mean() for mask in masks])
    half = float(np.median(shares))
    share = max(float(always.mean()), half if half > 0.9 else 0.0)
    return Dark(camera, share, always, own[int(np.argmax(shares))])


def _without_bars(dark: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns the dark blocks (R, C) without the bars of a film of another shape: whole rows, or columns, at both sides
    of the image."""
    result = dark.copy()
    for mask in (result, result.T):
        whole = np.asarray(mask.all(axis=1))
        if whole[0] and whole[-1] and not whole.all():
            first, last = int(np.argmin(whole)), int(np.argmin(whole[::-1]))
            mask[:first], mask[len(mask) - last :] = False, False
    return result


def _in_the_way(seen: Examination, dark: Dark) -> str | None:
    """A sentence where something is in the way, an empty one where nothing is; None where that is not known."""
    others = [_lit(seen, dark, name) for name in seen.rig.cameras if name != dark.camera]
    lit = [share for share in others if share is not None]
    if lit and max(lit) > 0.5:
        return f"Another camera sees light in {100 * max(lit):.0f} % of these directions."
    if dark.camera == seen.main and (ends := _ends(seen, dark)) >= ENDS:
        return f"{ends} corners that move into it end at its border."
    if dark.camera == seen.main and (stays := _staying(seen, dark)) >= BORDER_STAYS:
        return f"Its edge stays in place along {100 * stays:.0f} % of the border that the scene passes."
    return "" if lit else None


def _staying(seen: Examination, dark: Dark) -> float:
    """Returns the share of the border of the dark part, where the scene passes, at which an edge stays in place; 0
    where the scene passes too little of it."""
    fixed, passed = fixed_edges(seen)
    part = np.zeros(fixed.shape, np.uint8)
    for row, column in np.argwhere(dark.always) * BLOCK_PX:
        part[row : row + BLOCK_PX, column : column + BLOCK_PX] = 1
    side = np.ones((2 * BLOCK_PX + 1, 2 * BLOCK_PX + 1), np.uint8)
    border = (cv2.dilate(part, side) > 0) & (part == 0)
    inner = np.zeros_like(border)
    inner[BLOCK_PX:-BLOCK_PX, BLOCK_PX:-BLOCK_PX] = True
    border &= inner  # that of the image is no border of the scene
    if not border.any() or passed[border].mean() < BORDER_PASSED:
        return 0.0
    near = cv2.dilate(fixed.astype(np.uint8), np.ones((BLOCK_PX + 1, BLOCK_PX + 1), np.uint8)) > 0
    return float(near[border & passed].mean())


def _lit(seen: Examination, dark: Dark, other: str) -> float | None:
    """Share of the directions of the dark part that another camera does not see dark all the time; None where it sees
    few of them. The scene is taken as far away."""
    there = _dark(seen, other)
    if there is None:
        return None
    place = np.argwhere(dark.always if dark.always.any() else np.ones_like(dark.always))[:, ::-1]
    own, camera = seen.rig.camera(dark.camera), seen.rig.camera(other)
    rays, valid = own.unproject((place + 0.5) * BLOCK_PX)
    turn = (seen.rig.rig_from(other).inverse() @ seen.rig.rig_from(dark.camera)).rotation
    column, row = (np.nan_to_num(camera.project(rays @ turn.T), nan=-1.0) // BLOCK_PX).astype(int).T
    rows, columns = there.always.shape
    inside = valid & ((rays @ turn.T)[:, 2] > 0) & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    if inside.sum() < LEAST_BLOCKS:
        return None
    return 1 - float(there.always[row[inside], column[inside]].mean())


def _ends(seen: Examination, dark: Dark) -> int:
    """Counts corners that move into the dark part and end near its border, less those that move out of it."""
    uv, camera = seen.tracked.uv, seen.rig.camera(seen.main)
    outside = np.ones((camera.height, camera.width), np.uint8)
    for row, column in np.argwhere(dark.always) * BLOCK_PX:
        outside[row : row + BLOCK_PX, column : column + BLOCK_PX] = 0
    far = cv2.distanceTransform(outside, cv2.DIST_L2, 5)
    out_y, out_x = np.gradient(cv2.GaussianBlur(far, (0, 0), 3))
    count, known = 0, np.isfinite(uv[..., 0])
    size = np.array([camera.width, camera.height])
    for track, frames in zip(uv, (np.flatnonzero(row) for row in known), strict=True):
        if len(frames) <= STEPS or frames[-1] == uv.shape[1] - 1:
            continue
        end, step = track[frames[-1]], (track[frames[-1]] - track[frames[-1 - STEPS]]) / STEPS
        column, row = np.clip(np.round(end).astype(int), 0, size - 1)
        if far[row, column] > BLOCK_PX or (np.minimum(end, size - end) < BLOCK_PX / 2).any():
            continue
        into = -float(step @ (out_x[row, column], out_y[row, column]))
        count += int(into > INTO_PX) - int(into < -INTO_PX)
    return count


COVERED_LENS = Suspect(
    "covered-lens",
    "something covers a part of the lens",
    "images",
    "Clear the lens, or mask this part of the image.",
    covered,
)
