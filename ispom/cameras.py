"""Cameras, and the models of their lenses: OpenCV's (pinhole, radial-tangential, rational, fisheye), equirectangular
360-degree images, and packages' own.

Sources: Brown 1966 (radial-tangential), Claus and Fitzgibbon 2005 (rational), Kannala and Brandt 2006 (fisheye).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.registry import Registry

FARTHEST = 1e3
"""Distance on the plane z = 1 that rays get which never meet it, or only farther away (0.06 degrees before it)."""
BACK_PX = 1e-3
"""A ray is valid if it is projected back as close to its pixel."""
LEAST_DEPTH = 1e-9
"""Points nearer to the image plane, and those behind it, have no pixel."""
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-12)
"""Of the iterations that undo the distortion."""
STILL = np.zeros(3)
OPENCV = "opencv"
"""The perspective models together: the number of coefficients names one of them."""


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
    `fisheye` (equidistant; Kannala and Brandt 2006), `equirectangular` (all directions), or the name of a model of an
    installed package."""
    line_delay_s: float = 0.0
    """Of a rolling shutter: by how much later each row is exposed than the one above it. Times are the middle row's."""

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
        """The larger of width and height: it does not depend on how the camera is held."""
        return max(self.width, self.height)

    def project(self, xyz_in_camera: Array) -> Array:
        """Returns the pixels (N, 2) of points (N, 3); NaN for a point that the lens cannot see (on or behind the image
        plane of a perspective camera)."""
        return self.model.project(self, np.asarray(xyz_in_camera, float).reshape(-1, 3))

    def unproject(self, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Returns unit rays (N, 3) of pixels (N, 2), and which of them are valid: a pixel beyond the model's range has
        none."""
        return self.model.unproject(self, np.asarray(uv, float).reshape(-1, 2))

    def project_jacobian(self, xyz_in_camera: Array) -> Array:
        """Returns (N, 2, 3), the derivative of `project` with respect to the points [px per their unit]; NaN where
        `project` is."""
        return self.model.jacobian(self, np.asarray(xyz_in_camera, float).reshape(-1, 3))

    def normalise(self, uv: Array) -> Array:
        """Returns undistorted coordinates (N, 2) on the plane z = 1 of pixels (N, 2).

        Rays at 90 degrees from the axis or more have none: they come out far away.
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
    all_around: bool = False
    """Whether every direction has a pixel, also that to the back."""

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


class _InFront(CameraModel):
    """A model that sees only points in front of the image plane."""

    def _project(self, camera: Camera, xyz: Array) -> Array:
        """Pixels (N, 2) of points in front."""
        raise NotImplementedError

    def _jacobian(self, camera: Camera, xyz: Array) -> Array:
        """(N, 2, 3) at points in front."""
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
            return rays, (np.linalg.norm(back - uv, axis=1) <= BACK_PX) & (outward >= 0)


@dataclass(frozen=True)
class Pinhole(_InFront):
    """Without distortion."""

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
    """With OpenCV's coefficients k1, k2, p1, p2[, k3[, k4, k5, k6]]."""

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


@dataclass(frozen=True)
class Equirectangular(CameraModel):
    """A panorama of all directions: columns are longitudes and rows latitudes, of equal angles.

    The camera's axis is in the middle of the image; the direction to its back is at both sides. `fx` and `fy` are
    pixels per radian. A point in the centre has no pixel; points right above and below it have no Jacobian.
    """

    name: str = "equirectangular"
    counts: tuple[int, ...] = (0,)
    all_around: bool = True

    @staticmethod
    def camera(width: int, height: int) -> Camera:
        """Returns the camera of an image of the whole sphere."""
        return Camera(
            width, height, width / (2 * np.pi), height / np.pi, (width - 1) / 2, (height - 1) / 2, (), "equirectangular"
        )

    def project(self, camera: Camera, xyz_in_camera: Array) -> Array:
        x, y, z = xyz_in_camera.T
        longitude, latitude = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
        uv = np.stack([camera.fx * longitude + camera.cx, camera.fy * latitude + camera.cy], axis=1)
        uv[np.linalg.norm(xyz_in_camera, axis=1) <= LEAST_DEPTH] = np.nan
        return uv

    def unproject(self, camera: Camera, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
        longitude, latitude = ((uv - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
        level = np.cos(latitude)
        rays = np.stack([level * np.sin(longitude), np.sin(latitude), level * np.cos(longitude)], axis=1)
        valid = (np.abs(longitude) <= np.pi + 1e-9) & (np.abs(latitude) <= np.pi / 2 + 1e-9)
        return rays, valid

    def jacobian(self, camera: Camera, xyz_in_camera: Array) -> Array:
        x, y, z = xyz_in_camera.T
        level, out = np.hypot(x, z), np.full((len(xyz_in_camera), 2, 3), np.nan)
        some = level > LEAST_DEPTH
        x, y, z, level = x[some], y[some], z[some], level[some]
        square = level**2 + y**2
        nothing = np.zeros_like(x)
        out[some, 0] = camera.fx * np.stack([z / level**2, nothing, -x / level**2], axis=1)
        out[some, 1] = camera.fy * np.stack([-x * y / (level * square), level / square, -z * y / (level * square)], 1)
        return out


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


PINHOLE, FISHEYE, EQUIRECTANGULAR = Pinhole(), Fisheye(), Equirectangular()
RADIAL_TANGENTIAL = Perspective("radtan", (4, 5))
RATIONAL = Perspective("rational", (8,))

BUILT_IN = (PINHOLE, RADIAL_TANGENTIAL, RATIONAL, FISHEYE, EQUIRECTANGULAR)
CAMERA_MODELS: Registry[CameraModel] = Registry(
    "ispom.cameras",
    CameraModel,  # type: ignore[type-abstract]
    "camera model",
    BUILT_IN,
    "or install the package that adds it",
)


def model_of(lens: str, count: int) -> CameraModel:
    """Returns the model of a lens with `count` coefficients. Raises InputError where no installed package has it."""
    if lens == OPENCV:
        return PINHOLE if not count else RADIAL_TANGENTIAL if count <= 5 else RATIONAL
    return FISHEYE if lens == FISHEYE.name else CAMERA_MODELS.get(lens)


def require_opencv(camera: Camera, what: str) -> None:
    """Raises InputError where the camera's model is not one of OpenCV's, which is all that `what` knows."""
    if camera.lens not in (OPENCV, FISHEYE.name):
        raise InputError(
            f"{what} has no camera model {camera.lens}: use a camera of the models opencv or fisheye there"
        )


def resampling(source: Camera, target: Camera, source_from_target: Array) -> tuple[NDArray, NDArray]:
    """Returns the maps x, y (H, W) of cv2.remap that make the image of `target` from that of `source` at the same
    place, rotated by (3, 3); -1 where `source` does not see the direction."""
    grid = np.stack(np.meshgrid(np.arange(target.width), np.arange(target.height)), axis=-1).reshape(-1, 2)
    rays, valid = target.unproject(grid.astype(float))
    uv = np.where(valid[:, None], source.project(rays @ source_from_target.T), -1.0)
    x, y = np.nan_to_num(uv, nan=-1.0).astype(np.float32).T.reshape(2, target.height, target.width)
    return x, y
