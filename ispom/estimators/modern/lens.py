"""Corrections of a camera's focal length and radial distortion, self-calibrated from its images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.reductions import squares
from ispom.types import Camera


def corrected(x: Array, extra: Array) -> Array:
    """Converts normalised coordinates (N, 2) of the given calibration, x (1 + f + k |x|^2), to corrected ones x (N,
    2)."""
    if not extra.any():
        return x
    out = x
    for _ in range(3):
        out = x / stretch(out, extra)[:, None]
    return out


def stretch(x: Array, extra: Array) -> Array:
    """Returns (N,) 1 + f + k |x|^2 of normalised coordinates x (N, 2); a third correction k2 adds k2 |x|^4."""
    square = squares(x)
    out = 1 + extra[0] + extra[1] * square
    return out + extra[2] * square**2 if len(extra) > 2 else out


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera with its corrections (f, k) or (f, k, k2)."""

    camera: Camera
    extra: Array

    def normalise(self, uv: NDArray[np.float32]) -> Array:
        """Returns the normalised coordinates (N, 2) of pixels (N, 2)."""
        return corrected(self.camera.normalise(uv), self.extra)

    def in_image(self, xyz_in_camera: Array) -> Array:
        """Returns the pixels (N, 2) of points (N, 3) in the camera; NaN outside of the image."""
        uv, last = self.project(xyz_in_camera), (self.camera.width - 1, self.camera.height - 1)
        inside = (xyz_in_camera[:, 2] > 0) & (uv > 0).all(axis=1) & (uv < last).all(axis=1)
        return np.where(inside[:, None], uv, np.nan)

    def project(self, xyz_in_camera: Array) -> Array:
        """Returns the pixels (N, 2) of points (N, 3) in the camera; NaN for points behind it."""
        if not self.extra.any():
            return self.camera.project(xyz_in_camera)
        z = np.where(xyz_in_camera[:, 2] > 1e-9, xyz_in_camera[:, 2], np.nan)[:, None]
        wrong = stretch(xyz_in_camera[:, :2] / z, self.extra)[:, None]
        return self.camera.project(np.column_stack([xyz_in_camera[:, :2] * wrong, xyz_in_camera[:, 2]]))
