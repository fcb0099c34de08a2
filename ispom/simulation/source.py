"""The simulated experiment's images: which camera sees what when, with motion blur and sensor noise."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ispom.simulation.cameras import simulated_rig
from ispom.simulation.city import build_city
from ispom.simulation.path import Path
from ispom.simulation.renderer import Renderer, exposed
from ispom.types import Frame, Image, Kind

NOISE_SIGMA = 1.6
"""Sensor noise [grey levels]."""
BLUR_EXPOSURE_S = 0.008
"""How long the shutter is open where motion blur is asked for; times are those of its middle."""
BLUR_SAMPLES = 5


@dataclass(frozen=True)
class Source:
    """Renders exposures of the city of a seed; `scale` of the images as in `simulated_rig`."""

    seed: int
    motion_blur: bool
    scale: float

    def render(self, time_ns: int, kind: Kind, threads: int) -> Image:
        """The video image, or the left image above the right one. The same bytes for any number of threads."""
        names: tuple[Frame, ...] = {"video": ("video",), "stereo": ("left", "right")}[kind]
        return np.concatenate([self._camera(name, time_ns, threads) for name in names])

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(build_city(self.seed))

    def _camera(self, name: Frame, time_ns: int, threads: int) -> Image:
        rig, path = simulated_rig(self.scale), Path.seeded(self.seed)
        count = BLUR_SAMPLES if self.motion_blur else 1
        offsets_s = BLUR_EXPOSURE_S * ((np.arange(count) + 0.5) / count - 0.5)
        poses = [path.pose_at(time_ns + round(s * 1e9)) @ rig.rig_from(name) for s in offsets_s]
        images = [self._renderer.image(rig.camera(name), pose, threads) for pose in poses]
        noise_seed = zlib.crc32(f"{self.seed} {time_ns} {name}".encode())
        return exposed(np.mean(images, axis=0), noise_seed, NOISE_SIGMA)
