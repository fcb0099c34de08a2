"""Images as they are tracked and searched: at a bounded size, of the same brightness, and only those with contrast."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types import Camera, Frame, Image, Step, Tracks

MAX_SIDE_PX = 1400
"""Of the longer side, however the camera is held. Larger images are halved: windows and distances in pixels are made
for 600-1400 px, and more cost time and no more."""
SEARCH_SIDE_PX = 700
"""Images whose longer side is longer are searched at half size."""
MIN_CONTRAST = 0.2
"""Deviation of the coarse image's grey values, over that of the last good one: with less it shows nothing."""
COARSE = 8
"""Pixels of the image per pixel of the coarse one: averages of 64 have an eighth of the noise."""
MIN_GAIN, MIN_OFFSET, MAX_GAIN = 0.08, 8.0, 3.0
"""Changes of contrast and brightness [grey levels] that tracking wants undone; more is another image, not exposure."""


@dataclass(frozen=True)
class TrackedSize:
    """A camera, and the one whose images are tracked: the same, or with its images halved once or more."""

    full: Camera
    tracked: Camera

    @staticmethod
    def of(camera: Camera, max_side_px: int = MAX_SIDE_PX) -> TrackedSize:
        """For the images of a camera."""
        halvings = 0
        while camera.longer_side_px / 2**halvings > max_side_px:
            halvings += 1
        return TrackedSize(camera, camera.scaled(0.5**halvings) if halvings else camera)

    @property
    def factors(self) -> NDArray[np.float32]:
        """(2,) pixels of the camera per pixel tracked, along x and y."""
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
        """A Step about the images as they were exposed: places, disparities and errors in their pixels."""
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
    """At half its size where it is large, else as it is."""
    return np.asarray(cv2.pyrDown(image), np.uint8) if max(image.shape) > SEARCH_SIDE_PX else image


def factor_of(image: Image) -> int:
    """Pixels of an image per pixel of the halved one, along each side."""
    return 2 if max(image.shape) > SEARCH_SIDE_PX else 1


def as_bright(grey: Image, other: Image) -> Image:
    """`grey` with the mean and contrast of `other`, where the exposure changed between them; else as it is."""
    (mean,), (spread,) = (np.ravel(v) for v in cv2.meanStdDev(grey))
    (wanted,), (wanted_spread,) = (np.ravel(v) for v in cv2.meanStdDev(other))
    gain = float(wanted_spread) / max(float(spread), 1.0)
    if (abs(gain - 1) < MIN_GAIN and abs(wanted - mean) < MIN_OFFSET) or not 1 / MAX_GAIN < gain < MAX_GAIN:
        return grey
    table = np.clip((np.arange(256) - float(mean)) * gain + float(wanted) + 0.5, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(grey, table), np.uint8)


def has_contrast(grey: Image, other: Image | None) -> bool:
    """Whether the image has contrast beyond its noise, compared with another one."""
    if other is None:
        return True
    now, before = (
        float(cv2.resize(g, None, fx=1 / COARSE, fy=1 / COARSE, interpolation=cv2.INTER_AREA).std())
        for g in (grey, other)
    )
    return now > MIN_CONTRAST * before
