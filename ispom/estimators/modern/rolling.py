"""A rolling shutter: where points would be, had all rows been exposed with the middle one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Camera


def speed_px_s(
    camera: Camera, flow: NDArray[np.float32], before: NDArray[np.float32], interval_s: float
) -> NDArray[np.float32]:
    """(N, 2) velocity [px/s] of points at the end of their motion `flow` (N, 2) [px] in the last `interval_s`.

    Extrapolated from that and the motion `before` (N, 2) in the interval before it, 0 where there was none.
    """
    known = np.asarray(before.any(axis=1))
    now = np.where(known[:, None], 1.5 * flow - 0.5 * before, flow)
    between_s = interval_s + camera.line_delay_s * flow[:, 1]  # from the exposure of one row to that of another
    return (now / np.maximum(between_s, interval_s / 2)[:, None]).astype(np.float32)


def late_px(camera: Camera, uv: NDArray[np.float32], speed: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 2) [px] by how far points at (N, 2), with `speed` (N, 2) [px/s], went between the exposures of the middle row
    and of their own; 0 for a shutter that does not roll."""
    rows = uv[:, 1:] - (camera.height - 1) / 2
    return (camera.line_delay_s * rows * speed).astype(np.float32)


def late_s(camera: Camera, rows: Array) -> Array:
    """(N,) [s] after the middle row are rows (N,) [px] exposed."""
    return camera.line_delay_s * (rows - (camera.height - 1) / 2)


def moved(near: Array, seconds: Array, rate: Array, far: Array) -> Array:
    """Points (N, 3) after times (N,), in a camera of which camera_from_world changes by `rate` (6,) (rho [m/s], phi
    [rad/s]; left). To second order: an exposure lasts milliseconds.

    `far` (N,) is what a metre of that motion counts for: 1, or of points on the plane z = 1 their inverse depths [1/m].
    """
    s = seconds[:, None]
    change = rate[:3] * far[:, None] + np.cross(rate[3:], near)
    return near + s * change + 0.5 * s**2 * np.cross(rate[3:], change)
