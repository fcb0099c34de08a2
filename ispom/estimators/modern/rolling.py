"""Rolling shutter: moves points to where they would be if all rows had been exposed with the middle one.

Each row has its time (`late_s`). Before there is a map, tracks are moved by their velocities in the image (`late_px`);
with one, points are moved by the motion of the camera (`at_middle`), which is velocity and acceleration: with a hand's
shake (4 Hz) a constant rate would put outer rows of 30 ms 0.7 px off. All methods use these functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Camera

AHEAD = 4
"""Number of poses of the polynomial that gives the motion at the newest frame: each more amplifies the noise of the
newest pose."""
LEAST = 3
"""Least number of poses: fewer give no better motion than the tracks do."""
SPAN_S = 0.25
"""Longest time [s] covered by the polynomial's poses: a hand shakes at up to 4 Hz."""
PASSES = 2
"""Number of passes, as poses and motions depend on each other."""


@dataclass(frozen=True, eq=False)
class RollingTracks:
    """The tracks of an image, each row at its own time."""

    time_ns: int
    ids: NDArray[np.int64]
    """(N,) track ids, ascending."""
    uv: NDArray[np.float32]
    """(N, 2) [px] positions."""


@dataclass(frozen=True, eq=False)
class Flow:
    """Displacement of points from one image to the next."""

    px: NDArray[np.float32]
    """(N, 2) displacements [px]; 0 where unknown."""
    interval_s: float

    def mean_px_s(self, camera: Camera) -> NDArray[np.float32]:
        """Returns the velocities (N, 2) [px/s], over the time between the exposures of the two rows."""
        between_s = self.interval_s + camera.line_delay_s * self.px[:, 1]
        return (self.px / np.maximum(between_s, max(self.interval_s, 1e-6) / 2)[:, None]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Speeds:
    """Velocities (N, 2) [px/s] of points in three images."""

    before: NDArray[np.float32]
    last: NDArray[np.float32]
    now: NDArray[np.float32]

    @staticmethod
    def of(camera: Camera, flow: Flow, before: Flow) -> Speeds:
        """Computes velocities that change linearly between the flows; points without an earlier flow have the median
        acceleration of the others."""
        mean, earlier, known = flow.mean_px_s(camera), before.mean_px_s(camera), np.asarray(before.px.any(axis=1))
        gained = np.where(known[:, None], (mean - earlier) / max(flow.interval_s + before.interval_s, 1e-6), 0.0)
        if known.any():
            gained[~known] = np.median(gained[known], axis=0)
        ends = (earlier - before.interval_s * gained, mean - flow.interval_s * gained, mean + flow.interval_s * gained)
        return Speeds(*(each.astype(np.float32) for each in ends))


def late_px(camera: Camera, uv: NDArray[np.float32], speed: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the displacement (N, 2) [px] of points `uv` (N, 2) [px] with velocities `speed` (N, 2) [px/s] between the
    exposures of the middle row and of their own row; 0 for a global shutter."""
    if not camera.line_delay_s:
        return np.zeros((len(uv), 2), np.float32)
    return (late_s(camera, uv[:, 1])[:, None] * speed).astype(np.float32)


def late_s(camera: Camera, rows: Array) -> Array:
    """Returns the exposure times (N,) [s] of rows (N,) [px], relative to the middle row."""
    return camera.line_delay_s * (rows - (camera.height - 1) / 2)


def steady(rate: Array) -> Array:
    """Returns the motion (12,) of a constant rate (6,): a motion is the left rate of camera_from_world at the time of
    the middle row (rho [m/s], phi [rad/s]), and the derivative of that ([m/s^2], [rad/s^2])."""
    return np.concatenate([rate, np.zeros(6)])


def motion_at(poses: list[tuple[int, Pose]], time_ns: int) -> Array:
    """Returns the motion (12,) of camera_from_world at the time of one of at least two poses world_from_camera, from
    the polynomial through all of them."""
    here = next(pose for t, pose in poses if t == time_ns)
    twists = np.array([(pose.inverse() @ here).log() for _, pose in poses])
    seconds = np.array([t - time_ns for t, _ in poses]) * 1e-9
    unit = float(np.abs(seconds).max())
    found = np.zeros((max(len(poses), 3), 6))
    found[: len(poses)] = np.linalg.solve(np.vander(seconds / unit, increasing=True), twists)
    return np.concatenate([found[1] / unit, 2 * found[2] / unit**2])


def at_middle(near: Array, late_s: Array, motion: Array, inverse_depths: Array) -> Array:
    """Moves points (N, 3), in the camera at the times of their rows, to the camera at the time of the middle row.

    The motion (12,) is as of `steady`. `inverse_depths` (N,) scales the translation: 1 for points in metres, inverse
    depths [1/m] for points on the plane z = 1.
    """
    return _moved(near, -late_s, late_s, motion, inverse_depths)


def at_rows(near: Array, late_s: Array, motion: Array) -> Array:
    """Moves points (N, 3), in the camera at the time of the middle row, to that at the times of their rows."""
    return _moved(near, late_s, late_s, motion, np.ones(len(near)))


def _moved(near: Array, seconds: Array, late_s: Array, motion: Array, inverse_depths: Array) -> Array:
    """Moves points for times (N,) [s] by the mean rates between middle row and `late_s` (N,), to second order, as an
    exposure lasts milliseconds."""
    rates, s = motion[:6] + 0.5 * late_s[:, None] * motion[6:], seconds[:, None]
    change = rates[:, :3] * inverse_depths[:, None] + np.cross(rates[:, 3:], near)
    return near + s * change + 0.5 * s**2 * np.cross(rates[:, 3:], change)
