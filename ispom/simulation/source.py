"""The images of a simulation: every camera at every time, with motion blur, rolling shutter and sensor noise."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.simulation.cameras import NOISE_SIGMA, Optics, ring_rig, simulated_rig
from ispom.simulation.motions import motion_of
from ispom.simulation.places.building import build_building
from ispom.simulation.places.city import build_city
from ispom.simulation.places.meshes import WORD, MeshPlace, mesh_place
from ispom.simulation.places.moon import build_moon
from ispom.simulation.places.town import build_town
from ispom.simulation.places.traffic import Traffic, city_with_traffic
from ispom.simulation.places.walls import build_wall
from ispom.simulation.rendering.renderer import Renderer, exposed
from ispom.simulation.rendering.scene import Scene
from ispom.types import Camera, FrameName, Image, Kind, Rig

BLUR_EXPOSURE_S = 0.008
"""Time for which the shutter is open with motion blur; times are those of its middle."""
BLUR_SAMPLES = 5
PLACES: Mapping[str, Callable[[int], Scene | MeshPlace]] = {
    "city": build_city,
    "town": build_town,
    "indoor": build_building,
    "moon": build_moon,
    "wall": lambda seed: build_wall(seed, "wall"),
    "blank": lambda seed: build_wall(seed, "blank"),
    "tiles": lambda seed: build_wall(seed, "tiles"),
    "tags": lambda seed: build_wall(seed, "tags"),
}
"""Places by name, made of a seed."""


@dataclass(frozen=True)
class Source:
    """Renders frames of a place of a seed; `scale` of the images as in `simulated_rig`."""

    seed: int
    motion_blur: bool
    scale: float
    place: str = "city"
    motion: str = "flight"
    right_late_ns: int = 0
    """Delay of the right camera after the left one [ns]."""
    rolling_ns: int = 0
    """Delay of the last row after the first one [ns]; times are those of the middle row."""
    vehicles: int = 0
    """Number that drive in the street, of the city only."""
    people: int = 0
    width_px: int = 0
    portrait: bool = False
    fisheye: bool = False
    """The last three as in `cameras.Optics`."""
    ring: int = 0
    """Number of cameras in a ring, instead of the video camera and the pair."""

    @property
    def rig(self) -> Rig:
        """The rig as it is built: a pair of fisheye lenses is not rectified."""
        optics = Optics(self.width_px, self.portrait, self.fisheye, self.rolling_ns)
        return ring_rig(self.ring, self.scale, optics) if self.ring else simulated_rig(self.scale, optics)

    def render(self, time_ns: int, kind: Kind, threads: int) -> Image:
        """Renders the video image, or those of the pair or of the ring below each other. The same bytes for any number
        of threads."""
        ring = tuple(f"camera{k}" for k in range(self.ring))
        names: tuple[FrameName, ...] = {"video": ("video",), "stereo": ("left", "right"), "cameras": ring}[kind]
        return np.concatenate([self._camera(name, time_ns, threads) for name in names])

    def light(self, name: FrameName, time_ns: int, threads: int) -> NDArray[np.float32]:
        """Returns the light (H, W, 3) on a camera's sensor for a frame, 0-255."""
        exposed_ns = time_ns + (self.right_late_ns if name == "right" else 0)
        renderer, camera = self._renderer(exposed_ns), self.rig.camera(name)
        count = BLUR_SAMPLES if self.motion_blur else 1
        offsets_s = BLUR_EXPOSURE_S * ((np.arange(count) + 0.5) / count - 0.5)
        times_ns = [exposed_ns + round(s * 1e9) for s in offsets_s]
        seen = [renderer.image(camera, self._pose(name, ns), threads, self._rows(name, ns)) for ns in times_ns]
        return np.mean(seen, axis=0)

    @cached_property
    def scene(self) -> Scene | MeshPlace:
        """The place, without moving things."""
        return mesh_place(self.place) if self.place.startswith(WORD) else PLACES[self.place](self.seed)

    @cached_property
    def traffic(self) -> Traffic | None:
        """The moving things in the place; None where there are none."""
        some = self.vehicles or self.people
        return city_with_traffic(self.seed, self.vehicles, self.people) if some else None

    @cached_property
    def _still(self) -> Renderer | MeshPlace:
        """Renderer of the place at rest."""
        scene = self.scene if self.traffic is None else self.traffic.scene
        return scene if isinstance(scene, MeshPlace) else Renderer(scene)

    def _renderer(self, time_ns: int) -> Renderer | MeshPlace:
        """Returns the renderer of the place at a time."""
        if self.traffic is None or isinstance(self._still, MeshPlace):
            return self._still
        return replace(self._still, scene=self.traffic.at(time_ns))  # with the views of the place at rest

    def _camera(self, name: FrameName, time_ns: int, threads: int) -> Image:
        noise_seed = zlib.crc32(f"{self.seed} {time_ns} {name}".encode())
        return exposed(self.light(name, time_ns, threads), noise_seed, NOISE_SIGMA)

    def late_ns(self, camera: Camera) -> NDArray[np.int64]:
        """Returns the delay (H,) of each row after the middle one."""
        share = np.arange(camera.height) / (camera.height - 1) - 0.5
        return np.rint(share * self.rolling_ns).astype(np.int64)

    def _rows(self, name: FrameName, time_ns: int) -> list[Pose] | None:
        """Returns camera_from_row (H,) of each row's pose while an image is read out; None with a global shutter."""
        if not self.rolling_ns:
            return None
        late_ns, camera_from_world = self.late_ns(self.rig.camera(name)), self._pose(name, time_ns).inverse()
        return [camera_from_world @ self._pose(name, time_ns + int(ns)) for ns in late_ns]

    def _pose(self, name: FrameName, time_ns: int) -> Pose:
        """world_from_CAMERA."""
        return motion_of(self.motion, self.seed).pose_at(time_ns) @ self.rig.rig_from(name)
