"""The speed unit U, which makes times of different machines and days comparable.

U is the time of a forward-backward pyramidal KLT of 500 points (21x21 window, 4 levels, 30 iterations) on a 1226x370
pair with OpenCV on one thread. Times that are compared with it are measured in the same process.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.stopwatch import cpu_clock
from ispom.types import Image

SIZE = (1226, 370)
"""Width and height [px]."""
POINTS = 500
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01)


class Unit:
    """Measures U on a pair of images, or on a made pair where none is given."""

    def __init__(self, pair: tuple[Path, ...] = ()) -> None:
        read = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in pair)
        images = [np.asarray(i, np.uint8) for i in read if i is not None and i.shape[1::-1] == SIZE]
        if len(images) == 2:
            self.pair_name = "a KITTI pair"
            self._a, self._b = images
        else:
            self.pair_name = "a made pair, which takes some 20 % less than KITTI's"
            self._a, self._b = made_pair()
        self._points = cv2.goodFeaturesToTrack(self._a, POINTS, 0.01, 8)
        self.samples_ms: list[float] = []

    def measure(self, times: int = 7) -> None:
        """Adds samples; spread over a measurement they follow the machine's moods as it does."""
        for _ in range(times):
            start = cpu_clock()
            self._track()
            self.samples_ms.append(1e3 * (cpu_clock() - start))

    @property
    def ms(self) -> float:
        """The median."""
        return float(np.median(self.samples_ms))

    def _track(self) -> None:
        def flow(a: Image, b: Image, points: NDArray, guess: NDArray | None, flags: int) -> NDArray:
            return cv2.calcOpticalFlowPyrLK(a, b, points, guess, None, None, (21, 21), 3, _CRITERIA, flags)[0]  # type: ignore[call-overload]

        found = flow(self._a, self._b, self._points, None, 0)
        flow(self._b, self._a, found, self._points.copy(), cv2.OPTFLOW_USE_INITIAL_FLOW)


def made_pair() -> tuple[Image, Image]:
    """Noise of all scales, seen again after a step forward and a slight turn, with sensor noise."""
    width, height = SIZE
    rng, texture = np.random.default_rng(0), np.zeros((height, width), np.float32)
    for cell in (2, 4, 8, 16, 32, 64, 128):
        grid = rng.normal(size=(height // cell + 2, width // cell + 2)).astype(np.float32)
        texture += cell**0.5 * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
    first = 255 * (texture - texture.min()) / np.ptp(texture)
    zoom = cv2.getRotationMatrix2D((width / 2, height / 2), 0.2, 1.05)
    zoom[:, 2] += (10.0, 0.7)
    second = cv2.warpAffine(first, zoom, SIZE, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    second = np.clip(second + rng.normal(0, 3, second.shape), 0, 255)
    return first.astype(np.uint8), second.astype(np.uint8)
