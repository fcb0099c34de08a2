"""Whether images show anything, and show it at one time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from ispom.plausibility.doubt import Doubt
from ispom.types import Image, as_grey

BLACK, LIT = 8, 1e-4
"""Grey value that noise does not lift black images above (3 per cent of white), and the share of pixels above it that
may be defective."""
FROZEN = 4
"""Number of images from which on equal ones are worth a sentence: noise differs from image to image."""
COMBED, COMBED_SHARE, CONTRAST = 1.25, 0.1, 8.0
"""In images of two fields a row differs more from the next row than from the one after it. Least ratio of the two
differences; share of blocks above which the image has two fields; contrast [grey levels] above which a block counts.
In a whole image the next row is at least as similar."""
BLOCK, LEAST_BLOCKS = 16, 8
"""Side of a block [px], and the least number of those with contrast for a judgement."""
OPAQUE, CLEAR = 128, 0.5
"""Opacity below which a pixel is transparent, and the share of such pixels up to which it is the mask of a lens."""


def image_doubts(where: str, images: Sequence[Image], whole: bool = True) -> tuple[Doubt, ...]:
    """Returns doubts about some images of one camera; `whole`: they lie along the whole recording."""
    if not images:
        return ()
    count = len(images)
    if all(np.count_nonzero(image > BLACK) <= LIT * image.size for image in images):
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


def transparency_doubts(where: str, alphas: Iterable[np.ndarray]) -> tuple[Doubt, ...]:
    """Returns a doubt about some images' opacities (H, W), 0 to 255: of those without any there is nothing to see."""
    clear = [float((alpha < OPAQUE).mean()) for alpha in alphas]
    if not clear or min(clear) <= CLEAR:
        return ()
    text = f"{where}: {np.median(clear):.0%} of the pixels are transparent, and their hidden colours are used"
    return (Doubt("images_transparent", f"{text}: give images without an alpha channel."),)


def combed_share(grey: Image) -> float:
    """Returns the share of blocks with contrast in which a row differs more from the next one than from the one after
    it."""
    size = grey.shape[1] // BLOCK, grey.shape[0] // BLOCK
    if min(size) < 2:
        return 0.0
    near, far = cv2.absdiff(grey[1:-1], grey[:-2]), cv2.absdiff(grey[2:], grey[:-2])
    next_row, one_after = (cv2.resize(each, size, interpolation=cv2.INTER_AREA).astype(float) for each in (near, far))
    busy = np.maximum(next_row, one_after) > CONTRAST
    if busy.sum() < LEAST_BLOCKS:
        return 0.0
    return float((next_row[busy] > COMBED * one_after[busy]).mean())
