"""The noise of images, as the images show it."""

from __future__ import annotations

import numpy as np

from ispom.types import Image

BLOCK = 16
"""Side of the blocks [px] in each of which the noise is measured: 256 values give it within 7 %."""
PLAIN = 0.1
"""Share of the blocks that are taken to be without texture, in which noise is all there is."""
KERNEL_NORM = 6.0
"""Root of the squared sum of the weights 1, -2, 1; -2, 4, -2; 1, -2, 1, which no even slope passes (Immerkaer 1996)."""


def noise_sigma(image: Image) -> float:
    """Returns the standard deviation of an image's noise [grey levels, of each channel], from its plainest blocks; 0
    for an image that has none, or is smaller than a block."""
    if image.ndim == 3:
        return float(np.mean([noise_sigma(channel) for channel in np.moveaxis(image, 2, 0)]))
    levels = image.astype(np.float32)
    across = levels[:, 2:] - 2 * levels[:, 1:-1] + levels[:, :-2]
    response = across[2:] - 2 * across[1:-1] + across[:-2]
    rows, columns = (size // BLOCK for size in response.shape)
    if not rows * columns:
        return 0.0
    blocks = response[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    sigmas = np.sqrt((blocks**2).mean(axis=(1, 3))).ravel() / KERNEL_NORM
    return float(np.quantile(sigmas[sigmas > 0], PLAIN)) if (sigmas > 0).any() else 0.0
