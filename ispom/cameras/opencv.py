"""The built-in camera models, which are OpenCV's: pinhole, radial-tangential, rational, fisheye.

Sources: Brown 1966 (radial-tangential), Claus and Fitzgibbon 2005 (rational), Kannala and Brandt 2006 (fisheye).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras.model import MAX_ROUND_TRIP_PX, CameraModel
from ispom.geometry import Array

if TYPE_CHECKING:
    from ispom.cameras.camera import Camera

LEAST_DEPTH = 1e-9
"""Least depth of a point with a pixel; nearer points are on the image plane or behind it."""
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-12)
"""Termination criteria of the iterations that invert the distortion."""
STILL = np.zeros(3)


class _InFront(CameraModel):
    """A model that projects only points in front of the image plane."""

    def _project(self, camera: Camera, xyz: Array) -> Array:
        """Returns the pixels (N, 2) of points in front of the image plane."""
        raise NotImplementedError

    def _jacobian(self, camera: Camera, xyz: Array) -> Array:
        """Returns the Jacobian (N, 2, 3) at points in front of the image plane."""
        return project_with_derivatives(camera, xyz)[1]

    def project(self, camera: Camera, xyz_in_camera: Array) -> Array:
        out, front = np.full((len(xyz_in_camera), 2), np.nan), xyz_in_camera[:, 2] > LEAST_DEPTH
        if front.any():
            out[front] = self._project(camera, xyz_in_camera[front])
        return out

    def jacobian(self, camera: Camera, xyz_in_camera: Array) -> Array:
        out, front = np.full((len(xyz_in_camera), 2, 3), np.nan), xyz_in_camera[:, 2] > LEAST_DEPTH
        if front.any():
            out[front] = self._jacobian(camera, xyz_in_camera[front])
        return out

    def unproject(self, camera: Camera, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
        x = self.normalise(camera, uv)
        rays = np.column_stack([x, np.ones(len(x))])
        with np.errstate(all="ignore"):
            back = self.project(camera, rays)
            # A polynomial has other solutions beyond the radius at which it turns back.
            outward = np.einsum("ni,nij,nj->n", x / (camera.fx, camera.fy), self.jacobian(camera, rays)[..., :2], x)
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            return rays, (np.linalg.norm(back - uv, axis=1) <= MAX_ROUND_TRIP_PX) & (outward >= 0)


@dataclass(frozen=True)
class Pinhole(_InFront):
    """A perspective camera without distortion."""

    name: str = "pinhole"
    counts: tuple[int, ...] = (0,)

    def project(self, camera: Camera, xyz_in_camera: Array) -> Array:
        xyz = xyz_in_camera
        z = np.where(xyz[:, 2] > LEAST_DEPTH, xyz[:, 2], np.nan)
        return np.stack([camera.fx * xyz[:, 0] / z + camera.cx, camera.fy * xyz[:, 1] / z + camera.cy], axis=1)

    def normalise(self, camera: Camera, uv: Array) -> Array:
        return (uv - (camera.cx, camera.cy)) / (camera.fx, camera.fy)

    def _jacobian(self, camera: Camera, xyz: Array) -> Array:
        x, y, z = xyz.T
        out = np.zeros((len(xyz), 2, 3))
        out[:, 0, 0], out[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
        out[:, 1, 1], out[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
        return out


@dataclass(frozen=True)
class Perspective(_InFront):
    """A perspective camera with OpenCV's coefficients k1, k2, p1, p2[, k3[, k4, k5, k6]]."""

    name: str
    counts: tuple[int, ...]

    def normalise(self, camera: Camera, uv: Array) -> Array:
        if not len(uv):
            return np.zeros((0, 2))
        undistorted = cv2.undistortPoints(uv[:, None], camera.matrix, np.array(camera.distortion, float), criteria=STOP)
        return np.asarray(undistorted, float).reshape(-1, 2)

    def _project(self, camera: Camera, xyz: Array) -> Array:
        uv, _ = cv2.projectPoints(xyz, STILL, STILL, camera.matrix, np.array(camera.distortion, float))
        return np.asarray(uv, float).reshape(-1, 2)


@dataclass(frozen=True)
class Fisheye(_InFront):
    """Equidistant, with the coefficients k1 to k4 of a polynomial of the angle from the axis, which is below 90
    degrees."""

    name: str = "fisheye"
    counts: tuple[int, ...] = (4,)

    def normalise(self, camera: Camera, uv: Array) -> Array:
        if not len(uv):
            return np.zeros((0, 2))
        undistorted = cv2.fisheye.undistortPoints(uv[:, None], camera.matrix, _four(camera), criteria=STOP)
        return np.asarray(undistorted, float).reshape(-1, 2)

    def _project(self, camera: Camera, xyz: Array) -> Array:
        uv, _ = cv2.fisheye.projectPoints(xyz[:, None], STILL, STILL, camera.matrix, _four(camera))
        return np.asarray(uv, float).reshape(-1, 2)


def project_with_derivatives(camera: Camera, xyz: Array) -> tuple[Array, Array, Array]:
    """Projects points (N, 3) in front of a camera with one of OpenCV's models.

    Returns pixels (N, 2), and their derivatives by the point (N, 2, 3) and by fx, fy, cx, cy and the coefficients
    (N, 2, P).
    """
    n, count = len(xyz), 4 + len(camera.distortion)
    if not n:
        return np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros((0, 2, count))
    if camera.lens == "fisheye":
        points = np.ascontiguousarray(xyz)[:, None]
        uv, jacobian = cv2.fisheye.projectPoints(points, STILL, STILL, camera.matrix, _four(camera))
        by_all = np.asarray(jacobian, float).reshape(n, 2, -1)  # f, c, k, rotation, translation, skew
        by_parameters, by_point = by_all[..., :8], by_all[..., 11:14]
    else:
        uv, jacobian = cv2.projectPoints(xyz, STILL, STILL, camera.matrix, np.array(camera.distortion, float))
        by_all = np.asarray(jacobian, float).reshape(n, 2, -1)  # rotation, translation, f, c, k
        by_point, by_parameters = by_all[..., 3:6], by_all[..., 6 : 6 + count]
    return np.asarray(uv, float).reshape(n, 2), by_point, by_parameters


def _four(camera: Camera) -> Array:
    return np.array(camera.distortion or (0.0,) * 4, float)


PINHOLE, FISHEYE = Pinhole(), Fisheye()
RADIAL_TANGENTIAL = Perspective("radtan", (4, 5))
RATIONAL = Perspective("rational", (8,))
