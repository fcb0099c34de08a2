"""The simulated rigs, a video camera and a rectified stereo pair, or a ring of cameras, and the times of frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ispom.geometry import Pose, so3_exp
from ispom.types import EXACT_LENS, EXACT_PAIR, Camera, Kind, Rig

BASELINE_M = 0.4
NOISE_SIGMA = 1.6
"""Sensor noise [grey levels]."""
STEREO_DELAY_S = 0.0113
"""Stereo frames are this much later than a video frame: never at the same time."""

FISHEYE = (-0.013, 0.004, -0.002, 0.0005)
"""k1 .. k4 of the fisheye lens."""
WIDER = 1.5
"""Factor by which its field of view is wider."""
RING_RADIUS_M, RING_VIEW_DEG = 0.4, 80.0
"""Of a ring of cameras: distance from its middle to each of them, and the horizontal field of view of each."""


@dataclass(frozen=True)
class Timing:
    """When the cameras expose."""

    duration_s: float = 20.0
    video_hz: float = 30.0
    stereo_hz: float = 3.0
    ring_hz: float = 10.0

    def exposures(self, ring: bool = False) -> list[tuple[int, Kind]]:
        """Returns (time_ns, kind) of every frame before the end, in the order of time."""
        if ring:
            return [(round(i * 1e9 / self.ring_hz), "cameras") for i in range(_count(self.duration_s, self.ring_hz, 0))]
        video = [(round(i * 1e9 / self.video_hz), "video") for i in range(_count(self.duration_s, self.video_hz, 0))]
        stereo = [
            (round((i / self.stereo_hz + STEREO_DELAY_S) * 1e9), "stereo")
            for i in range(_count(self.duration_s, self.stereo_hz, STEREO_DELAY_S))
        ]
        return sorted(video + stereo)  # type: ignore[return-value]


@dataclass(frozen=True)
class Optics:
    """Changes of the cameras of the rig."""

    width_px: int = 0
    """Width of all images, at the same fields of view; 0: given by the scale."""
    portrait: bool = False
    """Images are higher than wide: sides are exchanged, and with them the fields of view."""
    fisheye: bool = False
    """All cameras have a fisheye lens, with a 1.5 times wider angle from the image's centre to its sides."""
    rolling_ns: int = 0
    """Delay of the last row after the first one [ns]; times are those of the middle row."""

    def of(self, camera: Camera) -> Camera:
        """Returns a camera of the rig with these changes."""
        if self.fisheye:
            seen = (camera.fx / WIDER, camera.fy / WIDER)
            camera = Camera(camera.width, camera.height, *seen, camera.cx, camera.cy, FISHEYE, "fisheye")
        if self.portrait:
            camera = _upright(camera)
        if self.width_px:
            camera = camera.scaled(self.width_px / camera.width)
        return replace(camera, line_delay_s=self.rolling_ns * 1e-9 / (camera.height - 1))


def _upright(camera: Camera) -> Camera:
    """Exchanges x and y."""
    k1, k2, *tangential = camera.distortion or (0.0, 0.0)
    lens = (k1, k2, *(tangential if camera.lens == "fisheye" else tangential[::-1])) if camera.distortion else ()
    return Camera(
        camera.height, camera.width, camera.fy, camera.fx, camera.cy, camera.cx, lens, camera.lens
    )  # fmt: skip


AS_BUILT = Optics()


@lru_cache(maxsize=32)
def simulated_rig(scale: float = 1.0, optics: Optics = AS_BUILT) -> Rig:
    """Returns video 640x480 and stereo 1280x960 at scale 1; the fields of view stay the same at every scale.

    The calibration is marked as exact. A pair of fisheye lenses is not rectified.
    """
    stereo = Rig.stereo(optics.of(Camera(1280, 960, 920.0, 920.0, 639.5, 479.5).scaled(scale)), BASELINE_M)
    video = Camera(640, 480, 452.0, 455.0, 322.3, 237.1, (-0.22, 0.06, 0.0006, -0.0004))
    return Rig.of(
        video=optics.of(video.scaled(scale)),
        left=stereo.left,
        right=stereo.right,
        rig_from_video=Pose.from_rotvec(np.radians([1.2, -1.7, 0.9]), np.array([0.025, -0.045, 0.03])),
        rig_from_left=stereo.rig_from_left,
        rig_from_right=stereo.rig_from_right,
        video_sigma=EXACT_LENS,
        pair_sigma=EXACT_PAIR,
    )


@lru_cache(maxsize=32)
def ring_rig(count: int, scale: float = 1.0, optics: Optics = AS_BUILT) -> Rig:
    """Returns `count` cameras of 320x240 at scale 1 that look outwards from a circle: `camera0` forward, each other one
    further to the right. The rig frame is its middle, with the axes of the first."""
    focal_px = 160 / np.tan(np.radians(RING_VIEW_DEG / 2))
    camera = optics.of(Camera(320, 240, focal_px, focal_px, 159.5, 119.5).scaled(scale))
    values: dict[str, Camera | Pose] = {f"camera{k}": camera for k in range(count)}
    for k in range(count):
        turned = so3_exp(np.array([0.0, 2 * np.pi * k / count, 0.0]))
        values[f"rig_from_camera{k}"] = Pose(turned, turned @ np.array([0.0, 0.0, RING_RADIUS_M]))
    return Rig.of(**values)


def _count(duration_s: float, rate_hz: float, start_s: float) -> int:
    """Returns the number of frames at start_s + i / rate_hz within 0..duration_s, the end included."""
    return int(np.floor((duration_s - start_s) * rate_hz + 1e-9)) + 1
