"""What cameras saw at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types.camera import Image


@dataclass(frozen=True, eq=False)
class VideoFrame:
    time_ns: int
    image: Image


@dataclass(frozen=True, eq=False)
class StereoPair:
    time_ns: int
    left: Image
    right: Image


Exposure = VideoFrame | StereoPair


Kind = Literal["video", "stereo"]


def as_grey(image: Image) -> Image:
    """(H, W) of an RGB or grey image."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def colours_at(image: Image, uv: NDArray[np.float32]) -> NDArray[np.uint8]:
    """RGB (N, 3) of the pixels nearest to (N, 2); places outside give the nearest inside."""
    column = np.clip(np.rint(uv[:, 0]).astype(int), 0, image.shape[1] - 1)
    row = np.clip(np.rint(uv[:, 1]).astype(int), 0, image.shape[0] - 1)
    found = image[row, column]
    return np.repeat(found[:, None], 3, axis=1) if image.ndim == 2 else found
