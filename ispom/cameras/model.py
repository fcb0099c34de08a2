"""The contract of camera models, built in or of a package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

if TYPE_CHECKING:
    from ispom.cameras.camera import Camera

MAX_NORMALISED = 1e3
"""Largest distance from the axis on the plane z = 1, which rays at more than 89.94 degrees from the axis get."""
MAX_ROUND_TRIP_PX = 1e-3
"""Largest distance [px] between a pixel and the projection of its ray, if the ray is valid."""


@runtime_checkable
class CameraModel(Protocol):
    """How a lens maps points to pixels. Each function is given the camera whose parameters it uses.

    A model of a package is an instance of a subclass; an entry point of the group `ispom.cameras` names it.
    `ispom.check_camera_model` is the contract as a test.
    """

    name: str
    """Name in files and in `Camera.lens`."""
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
        """Returns the rays' positions (N, 2) on the plane z = 1; at a distance of `MAX_NORMALISED` for rays that do not
        meet it."""
        rays, _ = self.unproject(camera, uv)
        radii = np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
        return rays[:, :2] / np.maximum(rays[:, 2:], np.maximum(radii / MAX_NORMALISED, 1e-12))
