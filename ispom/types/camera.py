"""Cameras, and the rig that they sit on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types.calibration import LensSigma, PairSigma

Frame = Literal["world", "rig", "left", "right", "video", "board", "body"]
Lens = Literal["opencv", "fisheye"]
"""Which polynomial `Camera.distortion` holds."""


Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) RGB, uint8; pixel (0, 0) is the centre of the top-left pixel."""


@dataclass(frozen=True)
class Camera:
    """A camera with one of OpenCV's two distortion models; axes x right, y down, z forward."""

    width: int
    height: int
    fx: float
    """Focal lengths and principal point [px]."""
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    """OpenCV's k1, k2, p1, p2[, k3[, k4, k5, k6]], or k1, k2, k3, k4 of a fisheye lens; empty for none."""
    lens: Lens = "opencv"
    """Perspective with radial and tangential distortion, or fisheye (equidistant; Kannala and Brandt 2006)."""
    line_delay_s: float = 0.0
    """Of a rolling shutter: by how much later each row is exposed than the one above it. Times are the middle row's."""

    @property
    def matrix(self) -> Array:
        """K (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def longer_side_px(self) -> int:
        """How large its images are, whether the camera is held upright or lies."""
        return max(self.width, self.height)

    def project(self, xyz_in_camera: Array) -> Array:
        """Pixels (N, 2) of points (N, 3); a point on or behind the image plane gives NaN."""
        xyz = np.asarray(xyz_in_camera, float).reshape(-1, 3)
        z = np.where(xyz[:, 2] > 1e-9, xyz[:, 2], np.nan)
        if not self.distortion and self.lens == "opencv":
            return np.stack([self.fx * xyz[:, 0] / z + self.cx, self.fy * xyz[:, 1] / z + self.cy], axis=1)
        out = np.full((len(xyz), 2), np.nan)
        front = ~np.isnan(z)
        if front.any() and self.lens == "fisheye":
            coefficients = np.array(self.distortion or (0.0,) * 4, float)
            uv, _ = cv2.fisheye.projectPoints(xyz[front][:, None], np.zeros(3), np.zeros(3), self.matrix, coefficients)
            out[front] = uv.reshape(-1, 2)
        elif front.any():
            uv, _ = cv2.projectPoints(
                xyz[front], np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion, float)
            )
            out[front] = uv.reshape(-1, 2)
        return out

    def normalise(self, uv: Array) -> Array:
        """Undistorted coordinates (N, 2) on the plane z = 1 of pixels (N, 2).

        Rays that a fisheye lens sees at 90 degrees from its axis or more have none: they come out far away.
        """
        uv = np.asarray(uv, float).reshape(-1, 2)
        if not len(uv) or (not self.distortion and self.lens == "opencv"):
            return (uv - (self.cx, self.cy)) / (self.fx, self.fy)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-12)
        if self.lens == "fisheye":
            coefficients = np.array(self.distortion or (0.0,) * 4, float)
            undistorted = cv2.fisheye.undistortPoints(uv[:, None], self.matrix, coefficients, criteria=criteria)
        else:
            coefficients = np.array(self.distortion, float)
            undistorted = cv2.undistortPoints(uv[:, None], self.matrix, coefficients, criteria=criteria)
        return np.asarray(undistorted, float).reshape(-1, 2)

    def scaled(self, factor: float) -> Camera:
        """The camera of the image resized by factor (pixel centres kept in place)."""
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


@dataclass(frozen=True, eq=False)
class Rig:
    """The cameras of the platform and where they sit. Stereo images are rectified: one K, rows aligned, undistorted."""

    video: Camera | None = None
    left: Camera | None = None
    right: Camera | None = None
    rig_from_video: Pose = field(default_factory=Pose)
    rig_from_left: Pose = field(default_factory=Pose)
    rig_from_right: Pose = field(default_factory=Pose)
    rig_from_laser: Pose | None = None
    """Of another sensor, whose points the poses place; None where nothing is said of one."""
    video_sigma: LensSigma | None = None
    """How sure the calibration is of the video camera; None where it does not say: then settings do."""
    pair_sigma: PairSigma | None = None
    """The same of the pair."""

    @property
    def has_stereo(self) -> bool:
        return self.left is not None and self.right is not None

    @property
    def baseline_m(self) -> float:
        """Distance of the right camera from the left one along the left x axis."""
        return float((self.rig_from_left.inverse() @ self.rig_from_right).translation[0])

    def camera(self, name: Frame) -> Camera:
        """The camera called video, left or right; KeyError where the rig has none."""
        found = {"video": self.video, "left": self.left, "right": self.right}[name]
        if found is None:
            raise KeyError(f"this rig has no {name} camera")
        return found

    def rig_from(self, frame: Frame) -> Pose:
        """rig_from_FRAME for rig, video, left or right."""
        return {
            "rig": Pose(),
            "video": self.rig_from_video,
            "left": self.rig_from_left,
            "right": self.rig_from_right,
        }[frame]

    def beside(self, rig: Rig) -> Rig:
        """The `rig`, with the laser of this one, and as sure as this one is."""
        return replace(
            rig, rig_from_laser=self.rig_from_laser, video_sigma=self.video_sigma, pair_sigma=self.pair_sigma
        )

    @staticmethod
    def stereo(left: Camera, baseline_m: float) -> Rig:
        """A rectified pair alone: the rig frame is centred on the baseline (Fig. 6), with the left camera's axes."""
        half = np.array([baseline_m / 2, 0, 0])
        return Rig(left=left, right=left, rig_from_left=Pose(translation=-half), rig_from_right=Pose(translation=half))

    @staticmethod
    def single(video: Camera) -> Rig:
        """A video camera alone: it is the rig."""
        return Rig(video=video)
