"""An error of the calibration as a value, and the sequence that is told to have it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np

from ispom.geometry import Pose
from ispom.settings import Range
from ispom.types import Camera, Rig, Sequence


@dataclass(frozen=True)
class Perturbation:
    """What the calibration says too much of each: the estimators are told it, the cameras stay as they are."""

    video_focal_percent: Annotated[float, Range(-5, 5)] = 0.0
    """Focal length of the video camera."""
    video_centre_x_px: Annotated[float, Range(-20, 20)] = 0.0
    """Principal point of the video camera, to the right."""
    video_centre_y_px: Annotated[float, Range(-20, 20)] = 0.0
    """Principal point of the video camera, down."""
    pair_focal_percent: Annotated[float, Range(-5, 5)] = 0.0
    """Focal length of the rectified pair."""
    pair_centre_x_px: Annotated[float, Range(-20, 20)] = 0.0
    """Principal point of the rectified pair, to the right in both images."""
    pair_centre_y_px: Annotated[float, Range(-20, 20)] = 0.0
    """Principal point of the rectified pair, down in both images."""
    baseline_percent: Annotated[float, Range(-5, 5)] = 0.0
    """Distance of the two cameras of the pair."""
    turn_x_deg: Annotated[float, Range(-5, 5)] = 0.0
    """Rotation of the video camera on the rig about its own axes: x to the right (pitch),"""
    turn_y_deg: Annotated[float, Range(-5, 5)] = 0.0
    """y down (yaw),"""
    turn_z_deg: Annotated[float, Range(-5, 5)] = 0.0
    """z forward (roll)."""
    shift_x_m: Annotated[float, Range(-0.2, 0.2)] = 0.0
    """Place of the video camera on the rig, along the rig's axes: x to the right,"""
    shift_y_m: Annotated[float, Range(-0.2, 0.2)] = 0.0
    """y down,"""
    shift_z_m: Annotated[float, Range(-0.2, 0.2)] = 0.0
    """z forward."""
    clock_ms: Annotated[float, Range(-100, 100)] = 0.0
    """Time stamps of the video: later by this than those of the pairs."""

    @property
    def said(self) -> dict[str, float]:
        """By name, what is not 0."""
        return {field.name: value for field in fields(self) if (value := getattr(self, field.name))}

    def of_camera(self, camera: Camera, name: str) -> Camera:
        """The `video` camera, or the left or right one, as the perturbed calibration has it."""
        whose = "video" if name == "video" else "pair"
        factor = 1 + getattr(self, f"{whose}_focal_percent") / 100
        shift = [getattr(self, f"{whose}_centre_{axis}_px") for axis in "xy"]
        return replace(
            camera, fx=camera.fx * factor, fy=camera.fy * factor, cx=camera.cx + shift[0], cy=camera.cy + shift[1]
        )

    def of_rig(self, rig: Rig) -> Rig:
        """The rig as the perturbed calibration has it; the middle of the baseline stays. It does not say how sure it is
        of what is wrong, so that the methods correct that as far as their settings let them."""
        middle = (rig.rig_from_left.translation + rig.rig_from_right.translation) / 2
        wrong_pair, wrong_video = (any(n.startswith(of) for n in self.said) for of in (("pair", "baseline"), "video"))
        found = rig.changed(
            video_sigma=None if wrong_video else rig.video_sigma,
            pair_sigma=None if wrong_pair else rig.pair_sigma,
        )
        for name in ("left", "right"):
            if getattr(rig, name) is not None and rig.has_stereo:
                pose = rig.rig_from(name)
                away = (1 + self.baseline_percent / 100) * (pose.translation - middle)
                camera = self.of_camera(rig.camera(name), name)
                found = found.changed(**{name: camera, f"rig_from_{name}": Pose(pose.rotation, middle + away)})
        if rig.video is None:
            return found
        turn = Pose.from_rotvec(np.radians([self.turn_x_deg, self.turn_y_deg, self.turn_z_deg]), np.zeros(3))
        shift = Pose(translation=np.array([self.shift_x_m, self.shift_y_m, self.shift_z_m]))
        # A video camera alone is the rig: it has no place on it.
        placed = shift @ rig.rig_from_video @ turn if rig.has_stereo else rig.rig_from_video
        return found.changed(video=self.of_camera(rig.video, "video"), rig_from_video=placed)

    def of_sequence(self, sequence: Sequence) -> Sequence:
        """The same images with the rig, and the clock of the video, as the perturbed calibration has them."""
        told = replace(sequence, rig=self.of_rig(sequence.rig))
        both = sequence.rig.video is not None and sequence.rig.has_stereo
        return told.with_video_later(self.clock_ms * 1e-3) if both and self.clock_ms else told
