"""Prepares images for tracking: limits their size, equalises their brightness, and checks their contrast."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types import Camera, Frame, Image, Step, Tracks

MAX_SIDE_PX = 1400
"""Largest longer side of tracked images; larger images are halved. Windows and distances in pixels suit 600-1400 px;
more pixels only cost time."""
SEARCH_SIDE_PX = 700
"""Longer side above which an image is searched at half size."""
MIN_CONTRAST = 0.2
"""Least standard deviation of the coarse image's grey values, relative to the last good image."""
COARSE_FACTOR = 8
"""Number of pixels, along each side, per pixel of the coarse image: averages of 64 have an eighth of the noise."""
MIN_GAIN, MIN_OFFSET, MAX_GAIN = 0.08, 8.0, 3.0
"""Least relative change of contrast and least change of brightness [grey levels] that are compensated for tracking, and
the largest gain; beyond it the scene changed, not the exposure."""


@dataclass(frozen=True)
class TrackedSize:
    """A camera, and the one of the tracked images: the same, or with the image size halved once or more."""

    full: Camera
    tracked: Camera

    @staticmethod
    def of(camera: Camera, max_side_px: int = MAX_SIDE_PX) -> TrackedSize:
        """Returns the size for a camera: halved until the longer side is at most `max_side_px`."""
        halvings = 0
        while camera.longer_side_px / 2**halvings > max_side_px:
            halvings += 1
        return TrackedSize(camera, camera.scaled(0.5**halvings) if halvings else camera)

    @property
    def factors(self) -> NDArray[np.float32]:
        """Returns pixels of the camera per tracked pixel (2,), along x and y."""
        full, tracked = self.full, self.tracked
        return np.array([full.width / tracked.width, full.height / tracked.height], np.float32)

    def reduced(self, frame: Frame) -> Frame:
        """Returns the frame in the size in which it is tracked."""
        if self.tracked is self.full:
            return frame
        return frame.with_images(**{name: self._image(image) for name, image in frame.images.items()})

    def _image(self, image: Image) -> Image:
        size = (self.tracked.width, self.tracked.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)

    def enlarged(self, step: Step) -> Step:
        """Returns the Step in pixels of the full images: positions, disparities and residuals."""
        if self.tracked is self.full:
            return step
        tracks = {name: self._enlarged(some) for name, some in step.tracks.items()}
        other = {name: self._enlarged(some) for name, some in step.other_motion.items()}
        return replace(step, tracks=tracks, other_motion=other, residuals_px=step.residuals_px * float(self.factors[0]))

    def _enlarged(self, tracks: Tracks) -> Tracks:
        along = self.factors[0]
        return replace(
            tracks,
            uv=(tracks.uv + np.float32(0.5)) * self.factors - np.float32(0.5),
            uv_prev=(tracks.uv_prev + np.float32(0.5)) * self.factors - np.float32(0.5),
            residual_px=tracks.residual_px * along,
            disparity_px=tracks.disparity_px * along,
        )


def halved(image: Image) -> Image:
    """Returns the image at half size if its longer side exceeds SEARCH_SIDE_PX, else unchanged."""
    return np.asarray(cv2.pyrDown(image), np.uint8) if max(image.shape) > SEARCH_SIDE_PX else image


def factor_of(image: Image) -> int:
    """Returns pixels of an image per pixel of `halved`, along each side."""
    return 2 if max(image.shape) > SEARCH_SIDE_PX else 1


def as_bright(grey: Image, other: Image) -> Image:
    """Returns `grey` with the mean and contrast of `other` if the exposure changed between them, else unchanged."""
    (mean,), (spread,) = (np.ravel(v) for v in cv2.meanStdDev(grey))
    (wanted,), (wanted_spread,) = (np.ravel(v) for v in cv2.meanStdDev(other))
    gain = float(wanted_spread) / max(float(spread), 1.0)
    if (abs(gain - 1) < MIN_GAIN and abs(wanted - mean) < MIN_OFFSET) or not 1 / MAX_GAIN < gain < MAX_GAIN:
        return grey
    table = np.clip((np.arange(256) - float(mean)) * gain + float(wanted) + 0.5, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(grey, table), np.uint8)


def has_contrast(grey: Image, other: Image | None) -> bool:
    """Returns whether the image has contrast beyond its noise, relative to another one."""
    if other is None:
        return True
    now, before = (
        float(cv2.resize(g, None, fx=1 / COARSE_FACTOR, fy=1 / COARSE_FACTOR, interpolation=cv2.INTER_AREA).std())
        for g in (grey, other)
    )
    return now > MIN_CONTRAST * before
