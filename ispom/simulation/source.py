"""The simulated experiment's images: which camera sees what when, with motion blur and sensor noise."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ispom.simulation.cameras import NOISE_SIGMA, simulated_rig
from ispom.simulation.city import build_city
from ispom.simulation.motions import motion_of
from ispom.simulation.renderer import Renderer, exposed
from ispom.simulation.scene import Scene
from ispom.simulation.town import build_town
from ispom.simulation.walls import build_wall
from ispom.types import Frame, Image, Kind

BLUR_EXPOSURE_S = 0.008
"""How long the shutter is open where motion blur is asked for; times are those of its middle."""
BLUR_SAMPLES = 5
PLACES: Mapping[str, Callable[[int], Scene]] = {
    "city": build_city,
    "town": build_town,
    "wall": lambda seed: build_wall(seed, "wall"),
    "blank": lambda seed: build_wall(seed, "blank"),
    "tiles": lambda seed: build_wall(seed, "tiles"),
}
"""By name, made of a seed."""


@dataclass(frozen=True)
class Source:
    """Renders exposures of a place of a seed; `scale` of the images as in `simulated_rig`."""

    seed: int
    motion_blur: bool
    scale: float
    place: str = "city"
    motion: str = "flight"
    right_late_ns: int = 0
    """How long after the left camera the right one exposes [ns]."""

    def render(self, time_ns: int, kind: Kind, threads: int) -> Image:
        """The video image, or the left image above the right one. The same bytes for any number of threads."""
        names: tuple[Frame, ...] = {"video": ("video",), "stereo": ("left", "right")}[kind]
        return np.concatenate([self._camera(name, time_ns, threads) for name in names])

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(PLACES[self.place](self.seed))

    def _camera(self, name: Frame, time_ns: int, threads: int) -> Image:
        rig, path = simulated_rig(self.scale), motion_of(self.motion, self.seed)
        late_ns = self.right_late_ns if name == "right" else 0
        count = BLUR_SAMPLES if self.motion_blur else 1
        offsets_s = BLUR_EXPOSURE_S * ((np.arange(count) + 0.5) / count - 0.5)
        poses = [path.pose_at(time_ns + late_ns + round(s * 1e9)) @ rig.rig_from(name) for s in offsets_s]
        images = [self._renderer.image(rig.camera(name), pose, threads) for pose in poses]
        noise_seed = zlib.crc32(f"{self.seed} {time_ns} {name}".encode())
        return exposed(np.mean(images, axis=0), noise_seed, NOISE_SIGMA)
