"""A camera: the size of its images, its parameters, and the model that they belong to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.cameras.model import CameraModel
from ispom.cameras.registry import model_of
from ispom.geometry import Array


@dataclass(frozen=True)
class Camera:
    """A camera and its lens; axes x right, y down, z forward."""

    width: int
    height: int
    fx: float
    """Focal lengths and principal point [px]."""
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    """The coefficients of the model: OpenCV's k1, k2, p1, p2[, k3[, k4, k5, k6]], or k1, k2, k3, k4 of a fisheye lens;
    empty for none."""
    lens: str = "opencv"
    """`opencv` (perspective with radial and tangential distortion; the number of coefficients names the model),
    `fisheye` (equidistant; Kannala and Brandt 2006), or the name of a model of an installed package."""
    line_delay_s: float = 0.0
    """Delay of each row of a rolling shutter after the row above it; frames have the time of their middle row."""

    @property
    def model(self) -> CameraModel:
        """The model that projects. Raises InputError where no installed package has it."""
        return model_of(self.lens, len(self.distortion))

    @property
    def matrix(self) -> Array:
        """K (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def longer_side_px(self) -> int:
        """The larger of width and height, which is independent of the camera's orientation."""
        return max(self.width, self.height)

    def project(self, xyz_in_camera: Array) -> Array:
        """Returns the pixels (N, 2) of points (N, 3); NaN for a point outside of the field of view (on or behind the
        image plane of a perspective camera)."""
        return self.model.project(self, np.asarray(xyz_in_camera, float).reshape(-1, 3))

    def unproject(self, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Returns unit rays (N, 3) of pixels (N, 2), and a mask (N,) of the valid ones; pixels beyond the model's range
        have none."""
        return self.model.unproject(self, np.asarray(uv, float).reshape(-1, 2))

    def project_jacobian(self, xyz_in_camera: Array) -> Array:
        """Returns (N, 2, 3), the derivative of `project` with respect to the points [px per their unit]; NaN where
        `project` is."""
        return self.model.jacobian(self, np.asarray(xyz_in_camera, float).reshape(-1, 3))

    def normalise(self, uv: Array) -> Array:
        """Returns undistorted coordinates (N, 2) on the plane z = 1 of pixels (N, 2).

        Rays at 90 degrees from the axis or more have no such coordinates, and get large ones.
        """
        return self.model.normalise(self, np.asarray(uv, float).reshape(-1, 2))

    def scaled(self, factor: float) -> Camera:
        """Returns the camera of the image resized by `factor` (pixel centres kept in place)."""
        width, height = round(self.width * factor), round(self.height * factor)
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            line_delay_s=self.line_delay_s / sy,
        )
