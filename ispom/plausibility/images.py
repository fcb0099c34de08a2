"""Whether images show anything, and show it at one time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ispom.plausibility.doubt import Doubt
from ispom.types import Image, as_grey

BLACK = 8
"""Grey value that noise does not lift the darkest images above: 3 per cent of white."""
FROZEN = 4
"""Number of images from which on equal ones are worth a sentence: noise differs from image to image."""
COMBED, COMBED_SHARE, CONTRAST = 1.25, 0.1, 8.0
"""In images of two fields the next row differs more than the one after it, by so much, in so many blocks of those with
a contrast of so many grey values. In a whole image the next row is at least as alike."""
BLOCK = 16


def image_doubts(where: str, images: Sequence[Image], whole: bool = True) -> tuple[Doubt, ...]:
    """Returns doubts about some images of one camera; `whole`: they lie along the whole recording."""
    if not images:
        return ()
    count = len(images)
    black = sum(float(np.percentile(image, 99)) < BLACK for image in images)
    if black == count:
        brightest = max(int(image.max()) for image in images)
        text = f"{where}: all {count} images that were looked at are black (brightest value {brightest} of 255)"
        return (Doubt("images_black", f"{text}: take off the lens cap, or give the images of another camera."),)
    if count >= FROZEN and whole and all(np.array_equal(images[0], other) for other in images[1:]):
        text = f"{where}: all {count} images that were looked at, from first to last, are the same"
        return (Doubt("images_frozen", f"{text}: this looks like a frozen camera; record again."),)
    combed = [combed_share(as_grey(image)) for image in images]
    if sorted(combed)[(count - 1) // 2] > COMBED_SHARE:
        text = (
            f"{where}: neighbouring rows differ more than those after them, in {np.median(combed):.0%} of the places "
        )
        return (
            Doubt("images_interlaced", f"{text}with contrast: this looks like interlaced images; deinterlace them."),
        )
    return ()


def combed_share(grey: Image) -> float:
    """Returns the share of blocks with contrast in which a row differs more from the next one than from the one after
    it."""
    rows = grey[: grey.shape[0] // BLOCK * BLOCK, : grey.shape[1] // BLOCK * BLOCK].astype(np.int16)
    if rows.shape[0] < 2 * BLOCK or not rows.size:
        return 0.0
    near, far = np.abs(rows[1:-1] - rows[:-2]), np.abs(rows[2:] - rows[:-2])

    def blocks(values: np.ndarray) -> np.ndarray:
        values = values[: values.shape[0] // BLOCK * BLOCK]
        return values.reshape(-1, BLOCK, values.shape[1] // BLOCK, BLOCK).mean(axis=(1, 3))

    next_row, one_after = blocks(near), blocks(far)
    busy = np.maximum(next_row, one_after) > CONTRAST
    if busy.sum() < 8:
        return 0.0
    return float((next_row[busy] > COMBED * one_after[busy]).mean())
