"""Wrong calibrations: the estimators get another one than that which made the images.

Simulated rigs are marked as exact; these have no calibration uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import cv2
import numpy as np

from ispom.geometry import Pose, so3_exp
from ispom.settings import Range
from ispom.simulation.scenario.fault import Spell, with_images
from ispom.types import Camera, FrameName, Image, Sequence


@dataclass(frozen=True, kw_only=True)
class WrongLens:
    """Wrong interior orientation."""

    camera: Literal["video", "stereo"] = "video"
    """The pair's cameras share it."""
    focal_percent: Annotated[float, Range(-50, 50)] = 1.0
    """More than it is."""
    centre_x_px: Annotated[float, Range(-100, 100)] = 0.0
    centre_y_px: Annotated[float, Range(-100, 100)] = 0.0
    k1: Annotated[float, Range(-1, 1)] = 0.0
    """First coefficient of the distortion, more than it is; of the video camera only: the pair's images have none."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        rig = sequence.rig
        if self.camera == "video":
            return replace(sequence, rig=rig.changed(video=self.wrong(rig.camera("video")), video_sigma=None))
        left, right = (self.wrong(rig.camera(name)) for name in ("left", "right"))
        return replace(sequence, rig=rig.changed(left=left, right=right, pair_sigma=None))

    def wrong(self, camera: Camera) -> Camera:
        factor = 1 + self.focal_percent / 100
        lens = camera.distortion or ((0.0,) * 4 if self.k1 else ())
        return replace(
            camera,
            fx=factor * camera.fx,
            fy=factor * camera.fy,
            cx=camera.cx + self.centre_x_px,
            cy=camera.cy + self.centre_y_px,
            distortion=(lens[0] + self.k1, *lens[1:]) if lens else lens,
        )


@dataclass(frozen=True, kw_only=True)
class WrongBaseline:
    """Wrong distance of the stereo cameras: an error of scale."""

    percent: Annotated[float, Range(-50, 50)] = 1.0
    """More than it is."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        rig, factor = sequence.rig, 1 + self.percent / 100
        left, right = (replace(p, translation=factor * p.translation) for p in (rig.rig_from_left, rig.rig_from_right))
        return replace(sequence, rig=rig.changed(rig_from_left=left, rig_from_right=right, pair_sigma=None))


@dataclass(frozen=True, kw_only=True)
class WrongPair(Spell):
    """The right camera has rotated since the pair was calibrated; the rig is unchanged."""

    pitch_deg: Annotated[float, Range(-5, 5)] = 0.0
    """About its x axis: rows no longer agree."""
    yaw_deg: Annotated[float, Range(-5, 5)] = 0.05
    """About its y axis: all disparities change by the same amount."""
    roll_deg: Annotated[float, Range(-5, 5)] = 0.0
    """About its z axis."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        matrix = sequence.rig.camera("right").matrix
        was_from_is = so3_exp(np.radians([self.pitch_deg, self.yaw_deg, self.roll_deg]))
        homography = matrix @ was_from_is @ np.linalg.inv(matrix)

        def change(image: Image, _: FrameName, __: int) -> Image:
            flags, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, image.shape[1::-1]
            seen = cv2.warpPerspective(image, homography, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            return np.asarray(seen, np.uint8)

        uncertain = replace(sequence, rig=sequence.rig.changed(pair_sigma=None))
        return with_images(uncertain, change, self, "right")


@dataclass(frozen=True, kw_only=True)
class Unlevel(Spell):
    """The right images of the pair are not level with the left ones; the rig is unchanged."""

    rows_px: Annotated[float, Range(-100, 100)] = 3.0
    """Number of rows by which the right images are lower."""
    roll_deg: Annotated[float, Range(-5, 5)] = 0.0
    """Angle by which the right images are turned about their middle, clockwise [degrees]."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        def change(image: Image, _: FrameName, __: int) -> Image:
            height, width = image.shape[:2]
            matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -self.roll_deg, 1.0)
            matrix[1, 2] += self.rows_px
            seen = cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
            return np.asarray(seen, np.uint8)

        uncertain = replace(sequence, rig=sequence.rig.changed(pair_sigma=None))
        return with_images(uncertain, change, self, "right")


@dataclass(frozen=True, kw_only=True)
class WrongShutter:
    """Wrong line delay of all cameras with a rolling shutter."""

    percent: Annotated[float, Range(-100, 100)] = -100.0
    """Slower than it is; -100: no rolling shutter."""

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        rig = sequence.rig
        cameras = {name: self.wrong(camera) for name, camera in rig.cameras.items()}
        return replace(sequence, rig=rig.changed(**cameras, video_sigma=None, pair_sigma=None))

    def wrong(self, camera: Camera) -> Camera:
        return replace(camera, line_delay_s=(1 + self.percent / 100) * camera.line_delay_s)


@dataclass(frozen=True, kw_only=True)
class WrongMount:
    """Wrong pose of the video camera on the rig: rotated and shifted along the camera's own axes."""

    pitch_deg: Annotated[float, Range(-90, 90)] = 0.0
    yaw_deg: Annotated[float, Range(-90, 90)] = 0.5
    roll_deg: Annotated[float, Range(-90, 90)] = 0.0
    x_m: Annotated[float, Range(-1, 1)] = 0.0
    y_m: Annotated[float, Range(-1, 1)] = 0.0
    z_m: Annotated[float, Range(-1, 1)] = 0.0

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        turn = np.radians([self.pitch_deg, self.yaw_deg, self.roll_deg])
        was_from_wrong = Pose.from_rotvec(turn, np.array([self.x_m, self.y_m, self.z_m]))
        rig = sequence.rig
        return replace(sequence, rig=rig.changed(rig_from_video=rig.rig_from_video @ was_from_wrong))
