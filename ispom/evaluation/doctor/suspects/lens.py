"""Something on the lens: edges that stay where they are while the scene passes, and corners that are lost there.

A corner that is lost says little: in traffic, corners end at the same places of the image, too. An edge of the scene
moves along with it; its component along the motion averages out over the images. What is on the lens stays. Edges along
the motion, such as those of a lane, stay as well, so only the component along it counts.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding, Suspect
from ..tracking import evened
from .smear import smear

BORDER = 0.08
"""Of the image's size: corners leave the image there."""
CELL = 0.05
"""Side of a cell in which the motion of the scene is one, relative to the image's width."""
LEAST_STEPS = 8
"""Motions of corners that tell the motion of a cell."""
LEAST_PASSAGE = 0.06
"""The scene passes where it moves by so much of the image's width, further than the size of a drop."""
FIXED = 0.6
"""Mean of an edge's slope over its root mean square, from which on the edge stays. Of a scene of which n edges pass,
it is about 1 / sqrt(n), such as 0.4 for six."""
LEAST_SLOPE = 3.0
"""Grey levels per pixel, of images of even contrast, that a fixed edge has: above a sensor's noise."""
REACH = 0.012
"""Corners are lost at an edge within this, relative to the image's width: half of their window at
640 px."""
AT_EDGES = 0.2
"""Of the lost corners, lost at fixed edges. Simulated drops: 0.23 to 0.56 on seeds 0 to 9."""
LOST_AT_EDGES = 0.0025
"""Of the corners of a frame, lost at fixed edges. Simulated drops: 0.005 and more; clean lenses: below 0.0003."""
STRONGEST = 3.0
"""A lens that is covered has fixed edges, too, and is found by its own rule with more."""


def on_lens(seen: Examination) -> Finding | None:
    """Returns the stronger finding of edges that stay in place, and of a smear; None where neither can be known."""
    found = [each for each in (drops(seen), smear(seen)) if each is not None]
    return max(found, key=lambda finding: finding.strength, default=None)


def drops(seen: Examination) -> Finding | None:
    """Counts corners that are lost where edges stay in place, away from the image's border."""
    camera, uv = seen.rig.camera(seen.main), seen.tracked.uv
    fixed, passed = fixed_edges(seen)
    if not passed.any():
        return None
    reach = max(2, round(REACH * camera.width))
    near = cv2.dilate(fixed.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    known = np.isfinite(uv[..., 0])
    size = np.array([camera.width, camera.height])
    at = uv[:, :-1][known[:, :-1] & ~known[:, 1:]]
    at = at[((at > BORDER * size) & (at < (1 - BORDER) * size)).all(axis=1)]
    column, row = np.clip(np.round(at), 0, size - 1).astype(int).T
    there = near[row, column]
    share = float(there.mean()) if len(at) else 0.0
    lost = float(there.sum()) / max(int(known[:, :-1].sum()), 1)
    return Finding(
        min(lost / LOST_AT_EDGES, share / AT_EDGES, STRONGEST),
        f"{100 * share:.0f} % of the corners that are lost away from the border are lost where edges stay in place "
        f"while the scene passes, {100 * lost:.1f} % of all corners per frame.",
        {"lost_share": lost, "at_edges_share": share, "edges_share": float(fixed[passed].mean())},
        (seen.main_shots[-1].index,),
    )


def fixed_edges(seen: Examination) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns where (H, W) edges stay in place, and where the scene passes, so that staying and moving edges differ."""
    camera = seen.rig.camera(seen.main)
    axes, passage, side = passing(seen.tracked.uv, camera.width, camera.height)
    row = np.minimum((np.arange(camera.height) / side).astype(int), len(axes) - 1)
    column = np.minimum((np.arange(camera.width) / side).astype(int), axes.shape[1] - 1)
    axis, passed = axes[row][:, column].astype(np.float32), passage[row][:, column] >= LEAST_PASSAGE * camera.width
    total, squares = np.zeros((2, camera.height, camera.width))
    for shot in seen.main_shots:
        smooth = cv2.GaussianBlur(evened(shot.images[seen.main]), (0, 0), 1.0).astype(np.float32)
        slope = axis[..., 0] * cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        slope += axis[..., 1] * cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        total += slope
        squares += slope**2
    count = max(len(seen.main_shots), 1)
    mean, usual = np.abs(total) / count, np.sqrt(squares / count)
    return passed & (mean > LEAST_SLOPE) & (mean > FIXED * usual), passed


def passing(uv: Array, width: int, height: int) -> tuple[Array, Array, float]:
    """Returns, for cells of the image, the direction (R, C, 2) in which the scene moves there, how far (R, C) it gets
    [px], zero where that is unknown, and the side of a cell [px]. `uv` (P, F, 2) are the tracks.

    In each frame the slower of the corners count, so that an object before a scene at rest does not pass.
    """
    side = CELL * width
    axes = np.zeros((int(np.ceil(height / side)), int(np.ceil(width / side)), 2))
    passage = np.zeros(axes.shape[:2])
    steps = np.diff(uv, axis=1)
    track, frame = np.nonzero(np.isfinite(steps[..., 0]))
    at, step = uv[track, frame], steps[track, frame]
    for row, column in np.ndindex(*passage.shape):
        centre = (np.array([column, row]) + 0.5) * side
        near = (np.abs(at - centre) < 1.5 * side).all(axis=1)
        if near.sum() < LEAST_STEPS:
            continue
        axis = np.linalg.eigh(step[near].T @ step[near])[1][:, -1]
        along, when = step[near] @ axis, frame[near]
        way = [0.0]
        for k in np.unique(when):
            own = along[when == k]
            way.append(way[-1] + float(np.sign(np.median(own)) * np.percentile(np.abs(own), 25)))
        axes[row, column], passage[row, column] = axis, max(way) - min(way)
    return axes, passage, side


ON_LENS = Suspect(
    "on-lens", "something is on the lens", "images", "Clean and dry the lens, or mask what stays in place.", on_lens
)
