"""What a viewer has drawn: the image of a view is looked up on a screenshot, and compared with the frames' own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ispom.types import Measurement, is_stereo

SAME = 0.4
"""Correlation from which on an image is the frame's, where no other fits better: tracks lie on it, and its pixels are
on no grid. Of other noise it is 0.05."""


def image_of(exposure: Measurement) -> np.ndarray:
    image = exposure.left if is_stereo(exposure) else exposure.image
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def screen_of(tab) -> np.ndarray:
    """A screenshot, grey; what is not the viewer's is black."""
    screen = cv2.imdecode(np.frombuffer(tab.screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert screen is not None
    box = tab.locator("#canvas").bounding_box()
    screen[:, : round(box["x"])] = 0
    return screen


@dataclass(frozen=True)
class View:
    """Where a camera's image is drawn on the screen."""

    x: int
    y: int
    width: int
    height: int

    @staticmethod
    def find(screen: np.ndarray, image: np.ndarray, width_px: float) -> View:
        """Where this image is, at about this width; AssertionError where it is not."""
        best, found = -1.0, None
        for width in range(round(width_px) - 12, round(width_px) + 3):
            size = (width, round(width * image.shape[0] / image.shape[1]))
            if size[1] >= screen.shape[0]:
                break
            score = cv2.matchTemplate(screen, _resized(image, size), cv2.TM_CCOEFF_NORMED)
            _, most, _, (x, y) = cv2.minMaxLoc(score)
            if most > best:
                best, found = most, View(x, y, *size)
        assert found is not None and best > SAME, f"the image is nowhere on the screen: {best:.2f} at most"
        return found

    def score(self, screen: np.ndarray, image: np.ndarray) -> float:
        """Correlation of what is drawn with an image, within two pixels."""
        around = screen[max(self.y - 2, 0) : self.y + self.height + 2, max(self.x - 2, 0) : self.x + self.width + 2]
        if around.std() < 1:
            return 0.0
        return float(cv2.matchTemplate(around, _resized(image, (self.width, self.height)), cv2.TM_CCOEFF_NORMED).max())

    def frame(
        self, screen: np.ndarray, images: Callable[[int], np.ndarray], frames: Iterable[int]
    ) -> tuple[int, float]:
        """Which of these frames is drawn, and how well that fits."""
        scores = {frame: self.score(screen, images(frame)) for frame in frames}
        best = max(scores, key=scores.__getitem__)
        return best, scores[best]


def _resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    enlarged = size[0] > image.shape[1]
    return cv2.resize(image, size, interpolation=cv2.INTER_NEAREST if enlarged else cv2.INTER_AREA)
