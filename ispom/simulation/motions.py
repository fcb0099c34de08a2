"""Ways to move, as analytic functions of time: the flight of `path.py`, and what images alone cannot measure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from ispom.geometry import Pose, so3_exp
from ispom.simulation.building import Walk
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.path import Path
from ispom.simulation.route import WORD, Route
from ispom.simulation.town import Loop

SLOWER = 0.02
"""Of the flight: 3 cm/s along the street, 1 mm from a video frame to the next."""
TURN_DEG, TURN_HZ = np.array([6.0, 35.0, 3.0]), np.array([0.23, 0.11, 0.17])
"""Of pure rotation, about x, y, z."""


class Motion(Protocol):
    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        ...


@dataclass(frozen=True)
class Still:
    """The flight's first pose, for ever."""

    path: Path

    def pose_at(self, time_ns: int) -> Pose:
        return self.path.pose_at(0)


@dataclass(frozen=True)
class TinySteps:
    """The flight, fifty times slower."""

    path: Path

    def pose_at(self, time_ns: int) -> Pose:
        return self.path.pose_at(round(SLOWER * time_ns))


@dataclass(frozen=True)
class PureRotation:
    """About the centre of the video camera, which stays where the flight begins."""

    path: Path

    def pose_at(self, time_ns: int) -> Pose:
        video = simulated_rig().rig_from_video
        start = self.path.pose_at(0) @ video
        turn = np.radians(TURN_DEG) * np.sin(2 * np.pi * TURN_HZ * time_ns * 1e-9)
        return Pose(start.rotation @ so3_exp(turn), start.translation) @ video.inverse()


@dataclass(frozen=True)
class Sideways:
    """The flight along x instead of z, with the view ahead: what is done before a wall."""

    path: Path

    def pose_at(self, time_ns: int) -> Pose:
        pose, start = self.path.pose_at(time_ns), self.path.pose_at(0)
        moved = pose.translation - start.translation
        place = np.array([moved[2], -1.75 + moved[1], 0.3 * moved[0]])
        turn = 0.3 * (start.inverse() @ pose).rotvec
        return Pose(so3_exp(turn), place)


MOTIONS: Mapping[str, Callable[[Path], Motion]] = {
    "flight": lambda path: path,
    "still": Still,
    "tiny-steps": TinySteps,
    "rotation": PureRotation,
    "sideways": Sideways,
    "loop": Loop,
    "walk": Walk,
}
"""By name, made of the seed's flight."""


@lru_cache(maxsize=8)
def motion_of(name: str, seed: int) -> Motion:
    """KeyError for a name that is none; InputError for a route whose file is gone."""
    if name.startswith(WORD):
        return Route(name)
    return MOTIONS[name](Path.seeded(seed))
