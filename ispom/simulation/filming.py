"""Somebody films a calibration target with the three cameras: where the board is, when they expose, what they see.

Everything is exact truth; `board.py` makes pictures of it, and adding noise to the projected points makes corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.geometry import Array, Pose, so3_exp
from ispom.types import Camera, Rig

LEFT = Camera(752, 480, 458.6, 457.3, 367.2, 248.4, (-0.283, 0.074, 0.0002, 0.00002))
RIGHT = Camera(752, 480, 457.6, 456.1, 380.0, 255.2, (-0.284, 0.0745, -0.0001, -0.00004))
VIDEO = Camera(640, 480, 452.0, 455.0, 322.3, 237.1, (-0.22, 0.06, 0.0006, -0.0004))
BASELINE_M = 0.11
PAUSE_S = 0.8
"""From one pose of the board to the next, while it is filmed in motion."""


def filming_rig() -> Rig:
    """Three cameras that are not rectified; the rig frame is that of the left camera."""
    right = Pose.from_rotvec(np.radians([0.6, -0.9, 0.4]), np.array([BASELINE_M, 0.0008, -0.0011]))
    video = Pose.from_rotvec(np.radians([1.2, -1.7, 0.9]), np.array([0.06, -0.045, 0.03]))
    return Rig.of(video=VIDEO, left=LEFT, right=RIGHT, rig_from_video=video, rig_from_right=right)


def board_poses(camera: Camera, size_m: tuple[float, float], count: int, seed: int, alike: bool = False) -> list[Pose]:
    """camera_from_board of `count` good views: tilted to 45 degrees, near and far, over the whole image.

    With `alike`, all views are the bad ones of somebody who never tilts the board nor moves it far.
    """
    rng = np.random.default_rng([seed, 2])
    centre_in_board = np.array([size_m[0] / 2, size_m[1] / 2, 0])
    out = []
    for _ in range(count):
        tilt = np.radians(rng.uniform(-45, 45, 2)) if not alike else np.radians(rng.normal(0, 0.3, 2))
        turn = np.radians(rng.uniform(-25, 25)) if not alike else np.radians(rng.normal(0, 1))
        rotation = so3_exp(np.array([tilt[0], tilt[1], 0])) @ so3_exp(np.array([0, 0, turn]))
        share = rng.uniform(0.35, 0.75) if not alike else 0.5
        distance = camera.fx * max(size_m[0] / camera.width, size_m[1] / camera.height) / share
        room = (1 - share) / 2 if not alike else 0.02
        uv = np.array([camera.width, camera.height]) * (0.5 + rng.uniform(-room, room, 2))
        at = np.append((uv - (camera.cx, camera.cy)) / (camera.fx, camera.fy), 1.0) * distance
        out.append(Pose(rotation, at - rotation @ centre_in_board))
    return out


@dataclass(frozen=True, eq=False)
class Filming:
    """The rig moves smoothly before a board that hangs still."""

    rig: Rig
    left_from_board: tuple[Pose, ...]
    """At PAUSE_S from one to the next."""
    clock_offset_s: float
    """What the video camera's clock shows more than the pair's, at the same moment."""

    @staticmethod
    def of(rig: Rig, size_m: tuple[float, float], duration_s: float, seed: int, clock_offset_s: float = 0.0) -> Filming:
        """A session of this length before a board of this size; the left camera sees all of it most of the time."""
        count = max(4, round(duration_s / PAUSE_S) + 1)
        return Filming(rig, tuple(board_poses(rig.camera("left"), size_m, count, seed)), clock_offset_s)

    @property
    def duration_s(self) -> float:
        return PAUSE_S * (len(self.left_from_board) - 1)

    def left_from_board_at(self, time_s: float) -> Pose:
        """At a time [s] of the pair's clock."""
        rotations, positions = self._splines
        return Pose(rotations(time_s).as_matrix(), positions(time_s))

    @cached_property
    def _splines(self) -> tuple[RotationSpline, CubicSpline]:
        times = PAUSE_S * np.arange(len(self.left_from_board))
        rotations = RotationSpline(times, Rotation.from_matrix([p.rotation for p in self.left_from_board]))
        return rotations, CubicSpline(times, [p.translation for p in self.left_from_board])

    def video_from_board_at(self, video_time_s: float) -> Pose:
        """At a time [s] of the video camera's clock."""
        video_from_left = self.rig.rig_from_video.inverse() @ self.rig.rig_from_left
        return video_from_left @ self.left_from_board_at(video_time_s - self.clock_offset_s)


def seen_points(
    camera: Camera, camera_from_board: Pose, xyz_in_board: Array, noise_px: float, rng: np.random.Generator
) -> tuple[NDArray[np.intp], Array]:
    """Indices (N,) and pixels (N, 2) with Gaussian noise of the points that are in the image."""
    uv = camera.project(camera_from_board.apply(xyz_in_board))
    uv = uv + noise_px * rng.standard_normal(uv.shape)
    inside = (uv >= 0).all(1) & (uv <= (camera.width - 1, camera.height - 1)).all(1)
    ids = np.flatnonzero(inside)
    return ids, uv[ids]
