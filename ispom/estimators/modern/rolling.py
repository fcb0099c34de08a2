"""A rolling shutter: where points would be, had all rows been exposed with the middle one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Camera

AHEAD = 4
"""Poses of the polynomial that tells the motion at the newest frame: each more makes errors of its own pose larger."""
LEAST = 3
"""Fewer tell no more than the tracks' own motions do."""
SPAN_S = 0.25
"""The polynomial's poses are from no longer a time: a hand shakes at up to 4 Hz."""
PASSES = 2
"""Poses and motions follow from each other."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What an image showed, rows at their own times."""

    time_ns: int
    ids: NDArray[np.int64]
    """(N,) ascending."""
    uv: NDArray[np.float32]
    """(N, 2) [px]."""


@dataclass(frozen=True, eq=False)
class Flow:
    """How points moved from one image to the next."""

    px: NDArray[np.float32]
    """(N, 2) [px]; 0 where unknown."""
    interval_s: float

    def mean_px_s(self, camera: Camera) -> NDArray[np.float32]:
        """(N, 2) velocity [px/s]: over the time from the exposure of one row to that of another."""
        between_s = self.interval_s + camera.line_delay_s * self.px[:, 1]
        return (self.px / np.maximum(between_s, max(self.interval_s, 1e-6) / 2)[:, None]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Speeds:
    """(N, 2) velocities [px/s] of points in three images."""

    before: NDArray[np.float32]
    last: NDArray[np.float32]
    now: NDArray[np.float32]

    @staticmethod
    def of(camera: Camera, flow: Flow, before: Flow) -> Speeds:
        """They change as the means of both motions do; where there was none before, as those of the others."""
        mean, earlier, known = flow.mean_px_s(camera), before.mean_px_s(camera), np.asarray(before.px.any(axis=1))
        gained = np.where(known[:, None], (mean - earlier) / max(flow.interval_s + before.interval_s, 1e-6), 0.0)
        if known.any():
            gained[~known] = np.median(gained[known], axis=0)
        ends = (earlier - before.interval_s * gained, mean - flow.interval_s * gained, mean + flow.interval_s * gained)
        return Speeds(*(each.astype(np.float32) for each in ends))


def late_px(camera: Camera, uv: NDArray[np.float32], speed: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 2) [px] by how far points at (N, 2), with `speed` (N, 2) [px/s], went between the exposures of the middle row
    and of their own; 0 for a shutter that does not roll."""
    if not camera.line_delay_s:
        return np.zeros((len(uv), 2), np.float32)
    rows = uv[:, 1:] - (camera.height - 1) / 2
    return (camera.line_delay_s * rows * speed).astype(np.float32)


def late_s(camera: Camera, rows: Array) -> Array:
    """(N,) [s] after the middle row are rows (N,) [px] exposed."""
    return camera.line_delay_s * (rows - (camera.height - 1) / 2)


def steady(rate: Array) -> Array:
    """(12,) the motion whose rate (6,) does not change. See `mean_rates`."""
    return np.concatenate([rate, np.zeros(6)])


def mean_rates(motion: Array, seconds: Array) -> Array:
    """(N, 6) over times (N,) after the middle row, of a motion (12,): its rate then (rho [m/s], phi [rad/s]), and how
    that changes ([m/s^2], [rad/s^2])."""
    return motion[:6] + 0.5 * seconds[:, None] * motion[6:]


def motion_at(poses: list[tuple[int, Pose]], time_ns: int) -> Array:
    """(2, 6) how camera_from_world goes on from one of the times of these poses world_from_camera, two at least.

    By left twists (rho, phi) of the first times s [s] plus the second times s^2, of the polynomial through them all.
    """
    here = next(pose for t, pose in poses if t == time_ns)
    twists = np.array([(pose.inverse() @ here).log() for _, pose in poses])
    seconds = np.array([t - time_ns for t, _ in poses]) * 1e-9
    unit = float(np.abs(seconds).max())
    found = np.zeros((max(len(poses), 3), 6))
    found[: len(poses)] = np.linalg.solve(np.vander(seconds / unit, increasing=True), twists)
    return found[1:3] / np.array([[unit], [unit**2]])


def moved(near: Array, seconds: Array, rate: Array, far: Array) -> Array:
    """Points (N, 3) after times (N,), in a camera of which camera_from_world changes by `rate` (6,) (rho [m/s], phi
    [rad/s]; left), or by the mean rates (N, 6) over these times. To second order: an exposure lasts milliseconds.

    `far` (N,) is what a metre of that motion counts for: 1, or of points on the plane z = 1 their inverse depths [1/m].
    """
    s = seconds[:, None]
    change = rate[..., :3] * far[:, None] + np.cross(rate[..., 3:], near)
    return near + s * change + 0.5 * s**2 * np.cross(rate[..., 3:], change)
