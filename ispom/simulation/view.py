"""The rays of a camera's pixels: all from one place, or each row's from where a rolling shutter exposed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array, Pose
from ispom.simulation.noise import Values
from ispom.types import Camera


@dataclass(frozen=True, eq=False)
class View:
    """A camera's rays, on the plane z = 1 of the camera."""

    rays: Array
    """(H, W, 2) of the pixel centres."""
    change: Values
    """(6, H W) the rays again, their change per pixel to the right, and per pixel down."""
    start: Values | None = None
    """(3, H W) where the rays begin [m], if not in the camera's centre."""

    @staticmethod
    def of(camera: Camera) -> View:
        u, v = np.meshgrid(np.arange(-1, camera.width + 1.0), np.arange(-1, camera.height + 1.0))
        rays = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*u.shape, 2)
        right, down = (rays[1:-1, 2:] - rays[1:-1, :-2]) / 2, (rays[2:, 1:-1] - rays[:-2, 1:-1]) / 2
        rays = np.ascontiguousarray(rays[1:-1, 1:-1])
        change = np.concatenate([a.reshape(-1, 2).T for a in (rays, right, down)]).astype(np.float32, order="C")
        return View(rays, change)

    def rolled(self, middle_from_row: Sequence[Pose]) -> View:
        """The same rays in the camera of the middle row, if rows (H,) had poses of their own."""
        height, width = self.rays.shape[:2]
        turn = np.stack([pose.rotation for pose in middle_from_row])
        right, down = self.change[2:].astype(float).reshape(2, 2, height, width).transpose(0, 2, 3, 1)
        rays = _turned(turn, self.rays)
        changes = (_turned(turn, self.rays + change) - rays for change in (right, down))
        change = np.concatenate([a.reshape(-1, 2).T for a in (rays, *changes)]).astype(np.float32, order="C")
        start = np.stack([pose.translation for pose in middle_from_row]).astype(np.float32)
        return View(rays, change, np.ascontiguousarray(np.repeat(start, width, axis=0).T))


def _turned(turn: Array, rays: Array) -> Array:
    """(H, W, 2) rays of rows with rotations (H, 3, 3)."""
    out = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) @ turn.transpose(0, 2, 1)
    return np.asarray(out[..., :2] / out[..., 2:])
