"""Motions of the simulated platform, as analytic functions of time, and routes from files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose, so3_exp
from ispom.io.files import expanded, read_bytes
from ispom.io.trajectories import read_tum
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.places.building import HALL_FROM_M, RISE_M, STAIRS_FROM_M, TREAD_M
from ispom.simulation.places.town import SPEED_M_S, on_route
from ispom.solvers.trajectory.continuous import Curve
from ispom.types import Trajectory

SHAKE_M = np.array([0.013, 0.015, 0.008])
"""Amplitude of each of the shake's sinusoids in x, y, z: about 3 cm peak in all."""
SHAKE_DEG = np.array([0.55, 0.65, 0.5])
"""Amplitude about x, y, z: 1-2 degrees in all."""


@dataclass(frozen=True, eq=False)
class Flight:
    """world_from_rig as an analytic function of time. World: x right, y down, z along the street, ground at y = 0."""

    speed_m_s: float
    """Mean speed along the street."""
    sway: Array
    """(4, 3) amplitude [m], frequency [Hz], phase [rad] of the slow motion: x, y, z, and extra yaw [rad]."""
    shake_hz: Array
    """(6, 3) frequencies of the shake, 1-4 Hz: x, y, z, rotation about x, y, z."""
    shake_phase: Array
    """(6, 3) [rad]."""

    @staticmethod
    def seeded(seed: int) -> Flight:
        """Makes a path whose bends and shake depend on the seed, within the free part of the street."""
        rng = np.random.default_rng([seed, 1])
        frequency = np.array([1 / 11.5, 1 / 8.5, 1 / 7.0, 1 / 6.0]) * rng.uniform(0.92, 1.08, 4)
        sway = np.stack([[2.0, 0.55, 0.25, np.radians(5)], frequency, rng.uniform(0, 2 * np.pi, 4)], axis=1)
        hz = np.sort(rng.uniform((1.0, 1.8, 2.8), (1.8, 2.8, 4.0), (6, 3)), axis=1)
        return Flight(1.45, sway, hz, rng.uniform(0, 2 * np.pi, (6, 3)))

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        t = time_ns * 1e-9
        amplitude, omega = self.sway[:, 0], 2 * np.pi * self.sway[:, 1]
        wave = amplitude * np.sin(omega * t + self.sway[:, 2])
        slope = amplitude * omega * np.cos(omega * t + self.sway[:, 2])
        position = np.array([wave[0], -1.75 + wave[1], self.speed_m_s * t + wave[2]])
        forward = self.speed_m_s + slope[2]
        yaw = 0.8 * np.arctan2(slope[0], forward) + wave[3]
        pitch = -0.7 * np.arctan2(slope[1], forward)
        roll = -0.12 * wave[0] * omega[0] ** 2 * 2  # leans into bends
        shake = np.sin(2 * np.pi * self.shake_hz * t + self.shake_phase).sum(axis=1)
        smooth = so3_exp(np.array([0, yaw, 0])) @ so3_exp(np.array([pitch, 0, 0])) @ so3_exp(np.array([0, 0, roll]))
        return Pose(smooth @ so3_exp(np.radians(SHAKE_DEG) * shake[3:]), position + smooth @ (SHAKE_M * shake[:3]))


WORD = "route:"
"""Begins the name of a motion that is a file's."""
FEWEST = 4


def route_name(path: str) -> str:
    """Returns a name that differs for files of other content. Raises InputError where the file is no route."""
    route = expanded(path).absolute()
    _poses(route)
    return f"{WORD}{hashlib.blake2b(read_bytes(route), digest_size=8).hexdigest()}:{route}"


@dataclass(frozen=True)
class Route:
    """A user's route through a place: the poses of a TUM file, joined by a spline; time 0 is the first pose."""

    name: str
    """A name of `route_name`."""

    @cached_property
    def _curve(self) -> Curve:
        return Curve(_poses(Path(self.name.split(":", 2)[2])))

    @property
    def duration_s(self) -> float:
        times_ns = self._curve.through.times_ns
        return float(times_ns[-1] - times_ns[0]) * 1e-9

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]; the ends stay where they are."""
        return self._curve.at(np.array([self._curve.through.times_ns[0] + time_ns])).pose(0)


def _poses(path: Path) -> Trajectory:
    """Reads the poses. Raises InputError for too few for a spline."""
    route = read_tum(path, "rig")
    if len(route) < FEWEST:
        raise InputError(f"{path} has {len(route)} poses: a route needs at least {FEWEST}")
    return route


WALK_M_S, EYES_M = 0.9, 1.6
"""Speed of the walk, and height of the rig above the floor."""
SLOWER = 0.02
"""Speed relative to the flight: 3 cm/s along the street, 1 mm from a video frame to the next."""
TURN_DEG, TURN_HZ = np.array([6.0, 35.0, 3.0]), np.array([0.23, 0.11, 0.17])
"""Amplitude and frequency of the pure rotation, about x, y, z."""

PAN_S = 20.0
"""Time of the pan: a full turn and back."""
NOD_DEG, NOD_HZ = np.array([6.0, 3.0]), np.array([0.21, 0.13])
"""Amplitude and frequency of the nodding and the rolling meanwhile."""


class Motion(Protocol):
    """A motion of the platform."""

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        ...


@dataclass(frozen=True)
class Still:
    """The flight's first pose, for ever."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        return self.path.pose_at(0)


@dataclass(frozen=True)
class TinySteps:
    """The flight, fifty times slower."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        return self.path.pose_at(round(SLOWER * time_ns))


@dataclass(frozen=True)
class PureRotation:
    """About the centre of the video camera, which stays where the flight begins."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        video = simulated_rig().rig_from_video
        start = self.path.pose_at(0) @ video
        turn = np.radians(TURN_DEG) * np.sin(2 * np.pi * TURN_HZ * time_ns * 1e-9)
        return Pose(start.rotation @ so3_exp(turn), start.translation) @ video.inverse()


@dataclass(frozen=True)
class Pan:
    """A full turn to the right and back again, about the centre of the video camera, as of a surveyor's panorama."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        video = simulated_rig().rig_from_video
        start = self.path.pose_at(0) @ video
        t = time_ns * 1e-9
        yaw = np.pi * (1 - np.cos(2 * np.pi * t / PAN_S))
        nod = np.radians(NOD_DEG) * np.sin(2 * np.pi * NOD_HZ * t)
        turn = so3_exp(np.array([0.0, yaw, 0.0])) @ so3_exp(np.array([nod[0], 0.0, nod[1]]))
        return Pose(start.rotation @ turn, start.translation) @ video.inverse()


@dataclass(frozen=True)
class Sideways:
    """The flight along x instead of z, with the view ahead: what is done before a wall."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        pose, start = self.path.pose_at(time_ns), self.path.pose_at(0)
        moved = pose.translation - start.translation
        place = np.array([moved[2], -1.75 + moved[1], 0.3 * moved[0]])
        turn = 0.3 * (start.inverse() @ pose).rotvec
        return Pose(so3_exp(turn), place)


@dataclass(frozen=True)
class Drive:
    """The flight's bends at a constant height, level and without shake, as of a vehicle on an even road."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]; the view is along the path, as wheels roll."""
        t, (amplitude, hz, phase) = time_ns * 1e-9, self.path.sway[0]
        omega = 2 * np.pi * hz
        slope = amplitude * omega * np.cos(omega * t + phase)
        yaw = np.arctan2(slope, self.path.speed_m_s)
        place = np.array([amplitude * np.sin(omega * t + phase), -1.75, self.path.speed_m_s * t])
        return Pose(so3_exp(np.array([0, yaw, 0])), place)


@dataclass(frozen=True)
class Walk:
    """Down the corridor, up the stairs and into the hall, with the shake of a hand."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        t, path = time_ns * 1e-9, self.path
        along = WALK_M_S * t
        wave = np.sin(2 * np.pi * path.sway[:, 1] * t + path.sway[:, 2])
        step = 0.015 * np.sin(2 * np.pi * 1.7 * t)
        place = np.array([0.35 * wave[0], -EYES_M - _climbed(along) + 0.04 * wave[1] + step, along])
        yaw, pitch = np.radians(14) * wave[3] + 0.1 * wave[2], np.radians(3) * wave[1]
        smooth = so3_exp(np.array([0, yaw, 0])) @ so3_exp(np.array([pitch, 0, 0]))
        shake = np.sin(2 * np.pi * path.shake_hz * t + path.shake_phase).sum(axis=1)
        turn = smooth @ so3_exp(np.radians(SHAKE_DEG) * shake[3:])
        return Pose(turn, place + smooth @ (SHAKE_M * shake[:3]))


def _climbed(along_m: float) -> float:
    """Returns the height of the floor [m]: the slope of the stairs, with rounded ends for a smooth path."""
    slope, round_m = RISE_M / TREAD_M, 0.8
    ends = np.array([STAIRS_FROM_M, HALL_FROM_M])
    rising = round_m * np.logaddexp(0, (along_m - ends) / round_m)  # softplus: 0 before, along - end after
    return float(slope * (rising[0] - rising[1]))


@dataclass(frozen=True)
class Loop:
    """A drive around the block, with the sway and shake of the flight on top."""

    path: Flight

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        t = time_ns * 1e-9
        sway = self.path.pose_at(time_ns)
        ahead = np.array([0.0, 0.0, self.path.speed_m_s * t])
        return on_route(SPEED_M_S * t) @ Pose(sway.rotation, sway.translation - ahead)


MOTIONS: Mapping[str, Callable[[Flight], Motion]] = {
    "flight": lambda path: path,
    "still": Still,
    "tiny-steps": TinySteps,
    "rotation": PureRotation,
    "pan": Pan,
    "sideways": Sideways,
    "drive": Drive,
    "loop": Loop,
    "walk": Walk,
}
"""Motions by name, made of the seed's flight."""


@lru_cache(maxsize=8)
def motion_of(name: str, seed: int) -> Motion:
    """Raises KeyError for a name that is none. Raises InputError for a route whose file is gone."""
    if name.startswith(WORD):
        return Route(name)
    return MOTIONS[name](Flight.seeded(seed))
