"""Tracking at a bounded size: large images are halved until they are small enough; Steps speak of the large ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types import Camera, Frame, Image, Step, Tracks

MAX_SIDE_PX = 1400
"""Of the longer side, however the camera is held. Larger images are halved: windows and distances in pixels are made
for 600-1400 px, and more cost time and no more."""


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
