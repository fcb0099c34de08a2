"""A smear on the lens: places of the scene that pass it lose contrast there, and have it again after it.

The contrast around a place of the scene depends on the place, on the frame (exposure) and on the position in the image.
Places that cross the image separate the three. A clean lens has nearly the same contrast everywhere; sky and bare walls
do not count.

Corners are such places, but in the middle of a smear none is found, and those that come near end. So there are also
places that are carried along with the median motion of the corners around them. That is a rough motion, and in a street
it shows contrast that is lost towards a side. A smear is an island: around it, contrast is back in all directions.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image

from ..examination import Examination
from ..finding import Finding

CELL = 0.05
"""Side of a place, relative to the image's width."""
AROUND_PX = 11
"""Side of the surroundings of a corner whose contrast is compared."""
LEAST_FRAMES = 6
"""Least number of frames in which a corner must be observed to count."""
LEAST_TRACKS = 4
"""Corners that cross a place, so that it is known."""
LEAST_CELLS = 20
"""Least number of known cells for a finding."""
LOST = 0.33
"""Share of the contrast that is lost at a place that is smeared."""
SMEARED_SHARE = 0.025
"""Least share of the known cells that is smeared. Simulated smears: 0.035 to 0.11 (seeds 0 to 2); clean lenses in
streets, rooms and on the moon: 0."""
LEAST_SMEARED = 3
LEAST_SLOPE = 1.0
"""Grey levels per pixel: the noise of a sensor."""
TEXTURE_SLOPE = 2.0
"""Grey levels per pixel that a place has somewhere, so that it can lose them."""
HALVED = 0.5
"""Share of the contrast that is lost on an island: carried places are less exact than corners."""
BACK = 0.25
"""Share of the contrast that is lost at most around an island."""
DIRECTIONS = 8
"""Number of directions from the middle of an island in which the contrast around it is measured."""
ROUND = 7
"""Directions in which it is back: smears have 7 or 8, if the scene passes all around; clean lenses up to 5."""
NEAREST = 8
"""Corners whose median motion carries a place."""
FOLLOWED = 0.5
"""Least share of corners that must be followed for a motion; fewer are followed by chance only."""
NEW_EVERY = 6
"""Frames after which cells without a place get one."""
BORDER = 0.08
"""Width of the border, relative to the image's size, that is not examined, because lenses are less sharp there."""
ROUNDS = 60


def smear(seen: Examination) -> Finding | None:
    """Measures the share of the image where corners lose contrast as they pass. None where too few pass."""
    gain, known = gains(seen, seen.tracked.uv)
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


def island(seen: Examination) -> Finding | None:
    """Measures the largest part of the image in which the passing scene has half its contrast, and in how many
    directions it is back around it. None where too little passes."""
    gain, known = gains(seen, carried(seen))
    if known.sum() < LEAST_CELLS:
        return None
    low = known & (gain < np.log(1 - HALVED))
    count, labels = cv2.connectedComponents(low.astype(np.uint8), connectivity=8)
    found = [(int((labels == k).sum()), _directions(labels == k, gain, known)) for k in range(1, count)]
    size, back = max(found, key=lambda each: (min(each[1], ROUND), each[0]), default=(0, 0))
    share = size / float(known.sum())
    strength = min(share / SMEARED_SHARE, back / ROUND)
    return Finding(
        strength if size >= LEAST_SMEARED else min(strength, 0.9),
        f"At {100 * share:.0f} % of the places ({size} of {int(known.sum())}), what passes loses half of its contrast "
        f"or more, and has it back in {back} of {DIRECTIONS} directions around them.",
        {"smeared_share": share, "directions": float(back)},
        (seen.main_shots[-1].index,),
    )


def _directions(part: NDArray[np.bool_], gain: Array, known: NDArray[np.bool_]) -> int:
    """Counts the directions in which the median contrast in the cells around a part (R, C) is that of the image."""
    near, far = (cv2.dilate(part.astype(np.uint8), np.ones((side, side), np.uint8)) > 0 for side in (3, 7))
    at = np.argwhere(far & ~near & known)
    row, column = (at - np.argwhere(part).mean(axis=0)).T
    sector = np.floor((np.arctan2(row, column) + np.pi) / (2 * np.pi) * DIRECTIONS).astype(int) % DIRECTIONS
    values = gain[at[:, 0], at[:, 1]]
    return sum(bool(np.median(values[sector == k]) > np.log(1 - BACK)) for k in np.unique(sector))


def carried(seen: Examination) -> Array:
    """Returns the paths (P, F, 2) of places from everywhere in the main camera's image, carried along with the median
    motion of the nearest corners; NaN where a place is not in the image, or too few corners move."""
    camera, uv = seen.rig.camera(seen.main), seen.tracked.uv
    side, size = CELL * camera.width, np.array([camera.width, camera.height])
    columns, rows = np.ceil(size / side).astype(int)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    grid = grid[((grid + 0.5) * side < size - 1).all(axis=1)]
    paths: list[Array] = []
    own, at = np.zeros(0, int), np.zeros((0, 2))
    for f in range(uv.shape[1]):
        if f and len(at):
            both = np.isfinite(uv[:, f - 1, 0]) & np.isfinite(uv[:, f, 0])
            if both.sum() < max(NEAREST, FOLLOWED * np.isfinite(uv[:, f - 1, 0]).sum()):
                own, at = own[:0], at[:0]
            else:
                far = np.linalg.norm(at[:, None] - uv[both, f - 1], axis=2)
                nearest = np.argpartition(far, NEAREST - 1, axis=1)[:, :NEAREST]
                at = at + np.median((uv[both, f] - uv[both, f - 1])[nearest], axis=1)
            inside = ((at > 0) & (at < size - 1)).all(axis=1)
            own, at = own[inside], at[inside]
        if f % NEW_EVERY == 0:
            taken = {tuple(cell) for cell in (at / side).astype(int).tolist()}
            new = np.array([cell for cell in grid.tolist() if tuple(cell) not in taken]).reshape(-1, 2)
            own = np.append(own, np.arange(len(paths), len(paths) + len(new)))
            at = np.vstack([at, (new + 0.5) * side])
            paths.extend(np.full((uv.shape[1], 2), np.nan) for _ in new)
        for path, place in zip(own.tolist(), at, strict=True):
            paths[path][f] = place
    return np.array(paths).reshape(-1, uv.shape[1], 2)


def gains(seen: Examination, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the logarithm of the contrast (R, C) that cells of the main camera's image have, relative to the median
    one, and which of them are known, by paths (P, F, 2) of places of the scene."""
    camera = seen.rig.camera(seen.main)
    side = CELL * camera.width
    rows, columns = int(np.ceil(camera.height / side)), int(np.ceil(camera.width / side))
    track, frame = np.nonzero(np.isfinite(uv[..., 0]))
    column, row = np.clip(np.round(uv[track, frame]).astype(int), 0, [camera.width - 1, camera.height - 1]).T
    contrast = np.zeros(len(track))
    for f, shot in enumerate(seen.main_shots):
        here = frame == f
        contrast[here] = _contrast(shot.images[seen.main])[row[here], column[here]]
    cell = (row / side).astype(int) * columns + (column / side).astype(int)
    pairs = np.unique(np.column_stack([track, cell]), axis=0)
    most = np.zeros(len(uv))
    np.maximum.at(most, track, contrast)
    crossed = (np.bincount(pairs[:, 0], minlength=len(uv)) >= 2) & (most > np.log(TEXTURE_SLOPE))
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


def _contrast(image: Image) -> Array:
    """Returns the logarithm of the root mean square slope (H, W) around each pixel: blur and a veil both lessen it, and
    light that changes slowly has none."""
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)
    squares = sum(cv2.Sobel(smooth, cv2.CV_32F, x, 1 - x, ksize=3, scale=1 / 8) ** 2 for x in (0, 1))
    return 0.5 * np.log(np.maximum(cv2.blur(np.asarray(squares), (AROUND_PX, AROUND_PX)), LEAST_SLOPE**2))


def _means(group: NDArray[np.int64], values: Array, count: int) -> Array:
    return np.bincount(group, values, count) / np.maximum(np.bincount(group, minlength=count), 1)
