"""Faults of light and lens. Each keeps the sensor's noise as it is: a dark image is noisier, not only darker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np

from ispom.settings import Range
from ispom.simulation.scenario.fault import Cameras, Spell, random_of, read_out, with_images
from ispom.types import FrameName, Image, Sequence

COVERED = 10.0
"""Grey level of what covers a lens."""
TURNED = -2.5
"""A drop shows its surroundings upside down, smaller by this factor."""


@dataclass(frozen=True, kw_only=True)
class Darkness(Spell):
    """Less light on all cameras."""

    factor: Annotated[float, Range(0.001, 1)] = 0.1
    """Share of the light that is left."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            return read_out(np.float32(self.factor) * image, self.factor, "darkness", seed, camera, time_ns)

        return with_images(sequence, change, self)


@dataclass(frozen=True, kw_only=True)
class ExposureJumps(Spell):
    """Gain that jumps up and back again."""

    gain: Annotated[float, Range(0.01, 100)] = 1.6
    """Gain of the images in every second period, the first one excluded; too bright values are clipped to white."""
    every_s: Annotated[float, Range(0.01, 60)] = 1.0
    """Length of a period [s]."""
    camera: Cameras = "all"

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        first_ns = int(sequence.times_ns[0])

        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            period = int((time_ns - first_ns) * 1e-9 / self.every_s)
            if period % 2 == 0:
                return image
            return np.clip(np.float32(self.gain) * image + 0.5, 0, 255).astype(np.uint8)

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class Defocus(Spell):
    """A lens out of focus."""

    sigma_px: Annotated[float, Range(0.3, 50)] = 2.0
    """Standard deviation of the blur [px]."""
    camera: Cameras = "all"

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        noise_share = 1 / (2 * np.sqrt(np.pi) * self.sigma_px)  # of white noise, after the blur

        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), self.sigma_px)
            return read_out(np.asarray(blurred), min(1.0, float(noise_share)), "defocus", seed, camera, time_ns)

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class Blocked(Spell):
    """Something before a lens."""

    camera: Cameras = "video"
    share: Annotated[float, Range(0, 1)] = 1.0
    """Share of the image's columns, from the left."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            covered, width = image.copy(), round(self.share * image.shape[1])
            dark = np.full((len(image), width, *image.shape[2:]), COVERED, np.float32)
            covered[:, :width] = read_out(dark, 0.0, "blocked", seed, camera, time_ns)
            return covered

        return with_images(sequence, change, self, self.camera)


@dataclass(frozen=True, kw_only=True)
class Rain(Spell):
    """Drops on the lenses, which stay where they are."""

    drops: Annotated[int, Range(1, 1000)] = 40
    """Number on each lens."""
    radius_percent: Annotated[float, Range(0.1, 30)] = 2.0
    """Radius of a drop, relative to the image's width."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        masks: dict[tuple[FrameName, int, int], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

        def change(image: Image, camera: FrameName, time_ns: int) -> Image:
            key = (camera, *image.shape[:2])
            if key not in masks:
                masks[key] = self.drawn(key, seed)
            inside, x, y = masks[key]
            through = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            blurred = cv2.GaussianBlur(through, (0, 0), max(0.5, 0.1 * self.radius_percent / 100 * image.shape[1]))
            return np.where(inside.reshape(*inside.shape, *[1] * (image.ndim - 2)), blurred, image).astype(np.uint8)

        return with_images(sequence, change, self)

    def drawn(self, key: tuple[FrameName, int, int], seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns, for a camera's image (H, W), where its drops are, and the pixels that they show."""
        camera, height, width = key
        y, x = np.mgrid[:height, :width].astype(np.float32)
        inside, from_x, from_y = np.zeros((height, width), bool), x.copy(), y.copy()
        radius = self.radius_percent / 100 * width
        for u, v in random_of("rain", seed, camera).uniform(0, 1, (self.drops, 2)) * (width, height):
            drop = (x - u) ** 2 + (y - v) ** 2 <= radius**2
            inside |= drop
            from_x[drop], from_y[drop] = u + TURNED * (x[drop] - u), v + TURNED * (y[drop] - v)
        return inside, from_x, from_y
