"""Drops or dirt on the lens: edges that do not move with the scene, and corners that are lost there.

An edge of the scene moves along with it: over the images, all places nearby have about as many of them. At the border
of a drop there is always one, of changing sign, as the drop shows other parts of the scene. Edges along the motion,
such as those of a lane, stay as well, so only the slope along the motion counts. Staying edges alone prove little, as
some belong to objects that move along with the camera. At a drop, corners are lost more often than next to it, and than
elsewhere.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding, Suspect
from ..tracking import evened
from .smear import island, smear

BORDER = 0.08
"""Width of the border, relative to the image's size, that is not examined, because corners leave the image there."""
CELL = 0.05
"""Side of a cell in which the motion of the scene is one, relative to the image's width."""
LEAST_STEPS = 8
"""Least number of motions of corners from which the motion of a cell is known."""
LEAST_PASSAGE = 0.06
"""Least motion of the scene, relative to the image's width, with which it passes a cell: more than the size of a
drop."""
STAYS = 0.6
"""Mean logarithm of the slope along the motion, more than around it, from which on an edge stays: a factor of 1.8. Of a
scene that passes, this mean scatters less: at most 0.1 % of the image is above it in simulations and in KITTI 06."""
AROUND = 0.02
"""Standard deviation of the surroundings of an edge, relative to the image's width: the size of a drop."""
REACH = 0.012
"""Corners are lost at an edge within this, relative to the image's width: half of their window at
640 px."""
BESIDE = 3
"""Multiple of REACH within which corners are next to an edge."""
MORE_OFTEN = 1.5
"""Least ratio of the rate of lost corners at staying edges to that next to them, and elsewhere: 1.8 to 3.9 at drops; up
to 0.8 without."""
LOST_AT_EDGES = 0.0025
"""Least share of the corners of a frame that is lost at fixed edges. Simulated drops: 0.005 and more; clean lenses: up
to 0.0027, with fewer lost than elsewhere."""
STRONGEST = 3.0
"""A lens that is covered has fixed edges, too, and is found by its own rule with more."""


def on_lens(seen: Examination) -> Finding | None:
    """Returns the stronger finding of edges that stay in place, and of a smear; None where neither can be known."""
    found = [each for each in (drops(seen), smear(seen), island(seen)) if each is not None]
    return max(found, key=lambda finding: finding.strength, default=None)


def drops(seen: Examination) -> Finding | None:
    """Compares the rate of lost corners at edges that stay in place with the rates next to them and elsewhere, away
    from the image's border."""
    camera, uv = seen.rig.camera(seen.main), seen.tracked.uv
    fixed, passed = fixed_edges(seen)
    if not passed.any():
        return None
    reach = max(2, round(REACH * camera.width))
    near, beside = (_grown(fixed, times * reach) for times in (1, BESIDE))
    known = np.isfinite(uv[..., 0])
    size = np.array([camera.width, camera.height])
    steps = np.diff(uv, axis=1, prepend=np.nan)[:, :-1]
    following = uv[:, :-1] + np.where(np.isfinite(steps), steps, 0.0)  # a corner is lost where it would be next
    at, lost = following[known[:, :-1]], ~known[:, 1:][known[:, :-1]]
    inner = ((at > BORDER * size) & (at < (1 - BORDER) * size)).all(axis=1)
    column, row = np.clip(np.round(at[inner]), 0, size - 1).astype(int).T
    there, lost = near[row, column], lost[inner]
    others = ~there, beside[row, column] & ~there
    share = float((there & lost).sum()) / max(len(at), 1)
    often = float(lost[there].mean()) if there.any() else 0.0
    # one more that is lost there: of few corners, a factor is no chance
    usual = max(float(lost[those].sum() + 1) / max(int(those.sum()), 1) for those in others)
    factor = often / usual
    return Finding(
        min(share / LOST_AT_EDGES, factor / MORE_OFTEN, STRONGEST),
        f"Where edges stay in place while the scene passes, {100 * often:.1f} % of the corners are lost per frame, "
        f"and {100 * usual:.1f} % beside them or elsewhere.",
        {"lost_share": share, "more_often": factor, "edges_share": float(fixed[passed].mean())},
        (seen.main_shots[-1].index,),
    )


def fixed_edges(seen: Examination) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns where (H, W) edges stay in place, and where the scene passes, so that staying and moving edges differ."""
    camera = seen.rig.camera(seen.main)
    axes, passage, side = passing(seen.tracked.uv, camera.width, camera.height)
    row = np.minimum((np.arange(camera.height) / side).astype(int), len(axes) - 1)
    column = np.minimum((np.arange(camera.width) / side).astype(int), axes.shape[1] - 1)
    axis, passed = axes[row][:, column].astype(np.float32), passage[row][:, column] >= LEAST_PASSAGE * camera.width
    total = np.zeros((camera.height, camera.width), np.float32)
    for shot in seen.main_shots:
        smooth = cv2.GaussianBlur(evened(shot.images[seen.main]), (0, 0), 1.0).astype(np.float32)
        slope = axis[..., 0] * cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        slope += axis[..., 1] * cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        total += np.log1p(np.abs(slope))
    mean, weight = total / max(len(seen.main_shots), 1), passed.astype(np.float32)
    around, weights = (cv2.GaussianBlur(v, (0, 0), AROUND * camera.width) for v in (mean * weight, weight))
    return passed & (mean - around / np.maximum(weights, 1e-3) > STAYS), passed


def _grown(mask: NDArray[np.bool_], by_px: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * by_px + 1, 2 * by_px + 1), np.uint8)) > 0


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
