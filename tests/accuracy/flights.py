"""Simulated ways that a bench films itself: exposures where and when it wants them, and the truth of them."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Literal

from ispom.geometry import Pose
from ispom.simulation.motions import Motion
from ispom.simulation.rendering.renderer import Renderer, exposed
from ispom.simulation.source import NOISE_SIGMA
from ispom.types import Exposure, Frame, Rig, StereoPair, Trajectory, VideoFrame

FilmedMethod = Literal["monocular", "stereo"]
FILMED_METHODS: tuple[FilmedMethod, ...] = ("monocular", "stereo")


@dataclass(frozen=True, eq=False)
class Flight:
    """A rig on its way; the sensors' noise is that of a seed, as in the simulations."""

    seed: int
    rig: Rig
    motion: Motion

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig."""
        return self.motion.pose_at(time_ns)

    def truth(self, times_ns: list[int], frame: Frame) -> Trajectory:
        """Of one of the rig's frames at these times."""
        mount = self.rig.rig_from(frame)
        return Trajectory.of([(t, self.pose_at(t) @ mount) for t in times_ns], frame)

    def exposure(self, renderer: Renderer, time_ns: int, stereo: bool) -> Exposure:
        names: tuple[Frame, ...] = ("left", "right") if stereo else ("video",)
        images = []
        for name in names:
            camera = self.rig.camera(name)
            sharp = renderer.image(camera, self.pose_at(time_ns) @ self.rig.rig_from(name), 1)
            images.append(exposed(sharp, zlib.crc32(f"{self.seed} {time_ns} {name}".encode()), NOISE_SIGMA))
        return StereoPair(time_ns, *images) if stereo else VideoFrame(time_ns, images[0])
