"""A smear on the lens: corners lose contrast where they pass it, and have it again behind it.

The contrast around a corner is that of the corner, of the frame (exposure) and of the place in the image. Corners that
cross several places tell the three apart. A clean lens gives all places nearly the same; sky and walls have no corners,
so they do not count.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding

CELL = 0.05
"""Side of a place, relative to the image's width."""
AROUND_PX = 11
"""Side of the surroundings of a corner whose contrast is compared."""
LEAST_FRAMES = 6
"""In which a corner is seen, so that it counts."""
LEAST_TRACKS = 4
"""Corners that cross a place, so that it is known."""
LEAST_CELLS = 20
"""Known places, so that anything is said."""
LOST = 0.33
"""Share of the contrast that is lost at a place that is smeared."""
SMEARED_SHARE = 0.025
"""Of the known places. Simulated smears: 0.035 to 0.11 (seeds 0 to 2); clean lenses in streets, rooms and on the moon:
0."""
LEAST_SMEARED = 3
BORDER = 0.08
"""Of the image's size: lenses are less sharp there."""
ROUNDS = 30


def smear(seen: Examination) -> Finding | None:
    """Measures the share of the image where corners lose contrast as they pass. None where too few pass."""
    gain, known = gains(seen)
    if known.sum() < LEAST_CELLS:
        return None
    low = known & (gain < np.log(1 - LOST))
    share = float(low.sum() / known.sum())
    strength = share / SMEARED_SHARE
    return Finding(
        strength if low.sum() >= LEAST_SMEARED else min(strength, 0.9),
        f"At {100 * share:.0f} % of the places where corners pass ({int(low.sum())} of {int(known.sum())}), "
        "they lose a third of their contrast or more, and have it again behind them.",
        {"smeared_share": share},
        (seen.main_shots[-1].index,),
    )


def gains(seen: Examination) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the logarithm of the contrast (R, C) that places of the main camera's image have, relative to the median
    one, and which of them are known."""
    camera, uv = seen.rig.camera(seen.main), seen.tracked.uv
    side = CELL * camera.width
    rows, columns = int(np.ceil(camera.height / side)), int(np.ceil(camera.width / side))
    track, frame = np.nonzero(np.isfinite(uv[..., 0]))
    column, row = np.clip(np.round(uv[track, frame]).astype(int), 0, [camera.width - 1, camera.height - 1]).T
    contrast = np.zeros(len(track))
    for f, shot in enumerate(seen.main_shots):
        here = frame == f
        image = shot.images[seen.main].astype(np.float32)
        mean, squares = (cv2.blur(values, (AROUND_PX, AROUND_PX)) for values in (image, image**2))
        contrast[here] = 0.5 * np.log(np.maximum(squares - mean**2, 1.0))[row[here], column[here]]
    cell = (row / side).astype(int) * columns + (column / side).astype(int)
    pairs = np.unique(np.column_stack([track, cell]), axis=0)
    crossed = np.bincount(pairs[:, 0], minlength=len(uv)) >= 2
    used = crossed[track] & (np.bincount(track, minlength=len(uv))[track] >= LEAST_FRAMES)
    track, frame, cell, contrast = track[used], frame[used], cell[used], contrast[used]
    of_cell, of_frame = np.zeros(rows * columns), np.zeros(uv.shape[1])
    for _ in range(ROUNDS):
        of_track = _means(track, contrast - of_cell[cell] - of_frame[frame], len(uv))
        of_frame = _means(frame, contrast - of_cell[cell] - of_track[track], len(of_frame))
        of_cell = _means(cell, contrast - of_track[track] - of_frame[frame], len(of_cell))
    pairs = pairs[crossed[pairs[:, 0]]]
    known = (np.bincount(pairs[:, 1], minlength=len(of_cell)) >= LEAST_TRACKS).reshape(rows, columns)
    known[: int(BORDER * rows)], known[rows - int(BORDER * rows) :] = False, False
    known[:, : int(BORDER * columns)], known[:, columns - int(BORDER * columns) :] = False, False
    gain = of_cell.reshape(rows, columns)
    return gain - (np.median(gain[known]) if known.any() else 0.0), known


def _means(group: NDArray[np.int64], values: Array, count: int) -> Array:
    return np.bincount(group, values, count) / np.maximum(np.bincount(group, minlength=count), 1)
