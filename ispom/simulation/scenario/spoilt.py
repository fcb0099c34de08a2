"""Faults of what a camera sees, and of how it is written: motion blur, fog, a smear, a moving object, noise, JPEG."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np

from ispom.settings import Range
from ispom.simulation.scenario.fault import Cameras, Spell, random_of, read_out, with_images
from ispom.types import FrameName, Image, Sequence

HAZE = 200.0
"""Grey level of fog."""
GREASE = 140.0
"""Grey level of what a smear adds."""
PANELS = 60
"""Rectangles of even grey, of which a moving object is made."""
NEARNESS = 0.05
"""Disparity of a moving object, relative to the image's width."""


@dataclass(frozen=True, kw_only=True)
class MotionBlur(Spell):
    """Images blurred along a line, as by a shaken camera."""

    length_px: Annotated[float, Range(2, 200)] = 12.0
    """Length of the line [px]; its direction differs from frame to frame."""
    camera: Cameras = "all"

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        size = 2 * int(np.ceil(self.length_px / 2)) + 1

        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            angle = random_of("motion-blur", seed, time_ns).uniform(0, np.pi)
            half = self.length_px / 2 * np.array([np.cos(angle), np.sin(angle)])
            kernel = np.zeros((size, size), np.float32)
            middle = (size - 1) / 2
            for share in np.linspace(-1, 1, 4 * size):
                x, y = middle + share * half
                kernel[round(y), round(x)] += 1
            blurred = cv2.filter2D(image.astype(np.float32), -1, kernel / kernel.sum())
            return read_out(blurred, float(np.sqrt(1 / self.length_px)), "motion-blur", seed, camera, time_ns)

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class Fog(Spell):
    """Less contrast: fog before all cameras, equally thick everywhere."""

    contrast: Annotated[float, Range(0.01, 1)] = 0.15
    """Share of the contrast that is left."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            light = np.float32(self.contrast) * image + np.float32((1 - self.contrast) * HAZE)
            return read_out(light, self.contrast, "fog", seed, camera, time_ns)

        return with_images(sequence, change, self)


@dataclass(frozen=True, kw_only=True)
class Smear(Spell):
    """Something soft and translucent on each lens, such as grease, which stays where it is."""

    radius_percent: Annotated[float, Range(1, 100)] = 25.0
    """Radius of the smear, relative to the image's width."""
    opacity: Annotated[float, Range(0.01, 1)] = 0.9
    """In its middle; it goes down to 0 at its border."""
    camera: Cameras = "all"

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            height, width = image.shape[:2]
            u, v = random_of("smear", seed, camera).uniform(0.3, 0.7, 2) * (width, height)
            y, x = np.ogrid[:height, :width]
            away = np.sqrt((x - u) ** 2 + (y - v) ** 2) / (self.radius_percent / 100 * width)
            share = (self.opacity * np.clip(1.5 * (1 - away), 0, 1)).astype(np.float32)
            share = share.reshape(*share.shape, *[1] * (image.ndim - 2))
            through = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.03 * width)
            seen = (1 - share) * image + share * (0.6 * through.reshape(image.shape) + 0.4 * GREASE)
            return np.clip(seen + 0.5, 0, 255).astype(np.uint8)

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class MovingPatch(Spell):
    """A textured rectangle that moves to and fro before the scene, as a vehicle would."""

    width_percent: Annotated[float, Range(1, 100)] = 30.0
    """Width relative to the image's."""
    height_percent: Annotated[float, Range(1, 100)] = 40.0
    """Height relative to the image's."""
    speed_percent: Annotated[float, Range(0, 1000)] = 30.0
    """Of the image's width, in a second."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        first_ns = int(sequence.times_ns[0])
        start, height_at = random_of("object", seed).uniform(0, 1, 2)

        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            height, width = image.shape[:2]
            size = (max(2, round(self.width_percent / 100 * width)), max(2, round(self.height_percent / 100 * height)))
            room = width - size[0]
            way = 2 * start * room + self.speed_percent / 100 * width * (time_ns - first_ns) * 1e-9
            u = room - abs(way % max(2 * room, 1) - room)  # to and fro between the image's sides
            u += {"left": 0.5, "right": -0.5}.get(camera, 0.0) * NEARNESS * width
            v = (0.2 + 0.6 * height_at) * (height - size[1])
            matrix = np.array([[1, 0, u], [0, 1, v]], np.float32)
            texture = self.drawn(size, seed)
            moved = cv2.warpAffine(texture, matrix, (width, height))
            inside = cv2.warpAffine(np.ones_like(texture), matrix, (width, height))
            shape = (height, width, *[1] * (image.ndim - 2))
            seen = np.where(inside.reshape(shape) > 0.99, moved.reshape(shape), image.astype(np.float32))
            return np.clip(seen + 0.5, 0, 255).astype(np.uint8)

        return with_images(sequence, change, self)

    def drawn(self, size: tuple[int, int], seed: int) -> np.ndarray:
        """Returns the texture (H, W) of a rectangle (width, height) [px], the same at every size."""
        rng, texture = random_of("texture", seed), np.full((size[1], size[0]), 120, np.float32)
        for u, v, width, height, grey in rng.uniform(0, 1, (PANELS, 5)):
            left, top = int((1.2 * u - 0.2) * size[0]), int((1.2 * v - 0.2) * size[1])
            right, bottom = left + int((0.05 + 0.2 * width) * size[0]), top + int((0.05 + 0.2 * height) * size[1])
            texture[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = 20 + 215 * grey
        return texture


@dataclass(frozen=True, kw_only=True)
class Noise(Spell):
    """A noisy sensor."""

    sigma: Annotated[float, Range(0, 200)] = 20.0
    """Standard deviation of the noise that is added [grey levels]."""
    camera: Cameras = "all"

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            added = random_of("noise", seed, camera, time_ns).standard_normal(image.shape, np.float32)
            return np.clip(image + np.float32(self.sigma) * added + 0.5, 0, 255).astype(np.uint8)

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class Jpeg(Spell):
    """Images that were written as JPEG."""

    quality: Annotated[int, Range(1, 100)] = 10

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            colour = image.ndim == 3
            given = image[..., ::-1] if colour else image
            _, content = cv2.imencode(".jpg", given, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
            seen = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE))
            return np.ascontiguousarray(seen[..., ::-1] if colour else seen)

        return with_images(sequence, change, self)
