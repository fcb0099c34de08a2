"""What a camera model is: the contract of all of them, built in or of a package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

if TYPE_CHECKING:
    from ispom.cameras.camera import Camera

FARTHEST = 1e3
"""Distance on the plane z = 1 that rays get which never meet it, or only farther away (0.06 degrees before it)."""
BACK_PX = 1e-3
"""A ray is valid if it is projected back as close to its pixel."""


@runtime_checkable
class CameraModel(Protocol):
    """How a lens maps points to pixels. Each function is given the camera whose parameters it uses.

    A model of a package is an instance of a subclass; an entry point of the group `ispom.cameras` names it.
    `ispom.check_camera_model` is the contract as a test.
    """

    name: str
    """As in files and `Camera.lens`."""
    counts: tuple[int, ...]
    """Numbers of coefficients that `Camera.distortion` may have."""

    def project(self, camera: Camera, xyz_in_camera: Array) -> Array:
        """Returns pixels (N, 2) of points (N, 3); NaN for points that have none."""
        ...

    def unproject(self, camera: Camera, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Returns unit rays (N, 3) of pixels (N, 2), and a mask (N,) of the valid ones, which `project` maps back onto
        their pixels. The others are any finite values."""
        ...

    def jacobian(self, camera: Camera, xyz_in_camera: Array) -> Array:
        """Returns d uv / d xyz (N, 2, 3); NaN for points that have no pixel."""
        ...

    def normalise(self, camera: Camera, uv: Array) -> Array:
        """Returns (N, 2), the rays on the plane z = 1; `FARTHEST` for rays that never meet it."""
        rays, _ = self.unproject(camera, uv)
        radii = np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
        return rays[:, :2] / np.maximum(rays[:, 2:], np.maximum(radii / FARTHEST, 1e-12))
