"""`sim:NAME`: the simulated experiment (paper, section 6.4), rendered when asked for and kept on disk."""

from __future__ import annotations

import threading
import zlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ispom.errors import InputError
from ispom.simulation.ahead import AheadRenderer
from ispom.simulation.cache import ImageCache, default_folder, source_key
from ispom.simulation.cameras import Timing, simulated_rig
from ispom.simulation.path import Path as FlightPath
from ispom.types import Exposure, Frame, Image, Kind, Sequence, StereoPair, Trajectory, VideoFrame

if TYPE_CHECKING:
    from ispom.simulation.renderer import Renderer

NOISE_SIGMA = 1.6
"""Sensor noise [grey levels]."""
BLUR_EXPOSURE_S = 0.008
"""How long the shutter is open where motion blur is asked for; times are those of its middle."""
BLUR_SAMPLES = 5


@dataclass(frozen=True)
class Preset:
    """What a name stands for."""

    scale: float
    """Of the images: 1 is 640x480 video and 1280x960 stereo."""
    duration_s: float


PRESETS = {"city": Preset(1.0, 20.0), "tiny": Preset(0.5, 3.0)}


def open_simulated(
    name: str,
    seed: int = 0,
    cache_dir: Path | None = None,
    motion_blur: bool = False,
    duration_s: float | None = None,
) -> Sequence:
    """The simulated sequence `name`: "city", or "tiny" (the same place, small images, 3 s: for tests).

    World: x right, y down, z along the street, ground at y = 0. `cache_dir` replaces the user's cache folder,
    `duration_s` [s] the preset's. InputError for an unknown name, and for a duration outside 0.1-20 s.
    """
    if name not in PRESETS:
        raise InputError(
            f"there is no simulated sequence sim:{name}, choose one of {', '.join(f'sim:{n}' for n in PRESETS)}"
        )
    preset = PRESETS[name]
    duration_s = preset.duration_s if duration_s is None else duration_s
    if not 0.1 <= duration_s <= 20.0:
        raise InputError(f"sim:{name} cannot last {duration_s:g} s, give a duration from 0.1 to 20 s")
    rig, path, stamps = simulated_rig(preset.scale), FlightPath.seeded(seed), Timing(duration_s).exposures()
    source = _Source(seed, motion_blur, preset.scale)
    key = source_key(
        seed, motion_blur, preset.scale, NOISE_SIGMA, BLUR_EXPOSURE_S, BLUR_SAMPLES, version("open3d"), version("numba")
    )
    ahead = AheadRenderer(
        [f"{time_ns:012d}_{kind}" for time_ns, kind in stamps],
        lambda i, threads: source.render(*stamps[i], threads),
        ImageCache.open(cache_dir or default_folder(), key),
    )

    def load(i: int) -> Exposure:
        (time_ns, kind), image = stamps[i], ahead.get(i)
        if kind == "video":
            return VideoFrame(time_ns, image)
        left, right = np.split(image, 2)
        return StereoPair(time_ns, left, right)

    return Sequence(
        f"sim:{name} seed {seed}" + (", motion blur" if motion_blur else ""),
        rig,
        np.array([t for t, _ in stamps], np.int64),
        tuple(kind for _, kind in stamps),
        load,
        Trajectory.of([(t, path.pose_at(t)) for t, _ in stamps]),
        ("simulated: rendered images with sensor noise, exact truth",),
        ahead.prepare,
    )


def compile_renderer() -> None:
    """Renders one small image, so that numba has compiled the renderer and kept it for other processes."""
    _Source(0, False, 0.1).render(0, "video", 1)


class _Source:
    """Renders exposures; builds the city when the first one is asked for that is not on disk."""

    def __init__(self, seed: int, motion_blur: bool, scale: float) -> None:
        self._seed, self._motion_blur = seed, motion_blur
        self._rig, self._path = simulated_rig(scale), FlightPath.seeded(seed)
        self._lock = threading.Lock()
        self._renderer: Renderer | None = None

    def render(self, time_ns: int, kind: Kind, threads: int) -> Image:
        """The video image, or the left image above the right one."""
        names: tuple[Frame, ...] = ("video",) if kind == "video" else ("left", "right")
        from ispom.simulation.city import (
            build_city,
        )  # not before: Open3D takes seconds to import, cached images need none
        from ispom.simulation.renderer import Renderer

        with self._lock:
            self._renderer = self._renderer or Renderer(build_city(self._seed))
            renderer = self._renderer
        return np.concatenate([self._camera(renderer, name, time_ns, threads) for name in names])

    def _camera(self, renderer: Renderer, name: Frame, time_ns: int, threads: int) -> Image:
        from ispom.simulation.renderer import exposed

        camera, rig_from_camera = self._rig.camera(name), self._rig.rig_from(name)
        count = BLUR_SAMPLES if self._motion_blur else 1
        offsets_s = BLUR_EXPOSURE_S * ((np.arange(count) + 0.5) / count - 0.5)
        poses = [self._path.pose_at(time_ns + round(s * 1e9)) @ rig_from_camera for s in offsets_s]
        image = np.stack([renderer.image(camera, pose, threads) for pose in poses]).mean(axis=0)
        noise_seed = zlib.crc32(f"{self._seed} {time_ns} {name}".encode())
        return exposed(image, noise_seed, NOISE_SIGMA)
