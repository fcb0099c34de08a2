"""An error of the calibration as a value, and its application to rigs, sequences and integrated trajectories."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np

from ispom.geometry import Pose
from ispom.settings import Range
from ispom.solvers.trajectory.anchoring import anchored
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Camera, Rig, Sequence, Trajectory


@dataclass(frozen=True)
class Perturbation:
    """Errors that are added to the calibration given to the estimators; the images are unchanged."""

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
    """Position of the video camera on the rig, along the rig's axes: x to the right,"""
    shift_y_m: Annotated[float, Range(-0.2, 0.2)] = 0.0
    """y down,"""
    shift_z_m: Annotated[float, Range(-0.2, 0.2)] = 0.0
    """z forward."""
    clock_ms: Annotated[float, Range(-100, 100)] = 0.0
    """Time offset of the video's stamps, relative to those of the pairs."""

    @property
    def nonzero(self) -> dict[str, float]:
        """All errors that are not 0, by name."""
        return {field.name: value for field in fields(self) if (value := getattr(self, field.name))}

    def of_camera(self, camera: Camera, name: str) -> Camera:
        """Perturbs the `video` camera, or the left or right one."""
        whose = "video" if name == "video" else "pair"
        factor = 1 + getattr(self, f"{whose}_focal_percent") / 100
        shift = [getattr(self, f"{whose}_centre_{axis}_px") for axis in "xy"]
        return replace(
            camera, fx=camera.fx * factor, fy=camera.fy * factor, cx=camera.cx + shift[0], cy=camera.cy + shift[1]
        )

    def of_rig(self, rig: Rig) -> Rig:
        """Perturbs the rig about the middle of the baseline. Perturbed cameras lose the standard deviations of their
        calibration, so that the methods correct them within their own settings."""
        middle = (rig.rig_from_left.translation + rig.rig_from_right.translation) / 2
        pair_differs = any(name.startswith(("pair", "baseline")) for name in self.nonzero)
        video_differs = any(name.startswith("video") for name in self.nonzero)
        changed = rig.changed(
            video_sigma=None if video_differs else rig.video_sigma,
            pair_sigma=None if pair_differs else rig.pair_sigma,
        )
        for name in ("left", "right"):
            if getattr(rig, name) is not None and rig.has_stereo:
                pose = rig.rig_from(name)
                away = (1 + self.baseline_percent / 100) * (pose.translation - middle)
                camera = self.of_camera(rig.camera(name), name)
                changed = changed.changed(**{name: camera, f"rig_from_{name}": Pose(pose.rotation, middle + away)})
        if rig.video is None:
            return changed
        turn = Pose.from_rotvec(np.radians([self.turn_x_deg, self.turn_y_deg, self.turn_z_deg]), np.zeros(3))
        shift = Pose(translation=np.array([self.shift_x_m, self.shift_y_m, self.shift_z_m]))
        # A video camera without a pair is the rig itself.
        placed = shift @ rig.rig_from_video @ turn if rig.has_stereo else rig.rig_from_video
        return changed.changed(video=self.of_camera(rig.video, "video"), rig_from_video=placed)

    def of_sequence(self, sequence: Sequence) -> Sequence:
        """Returns the same images with the perturbed rig and video clock."""
        perturbed = replace(sequence, rig=self.of_rig(sequence.rig))
        both = sequence.rig.video is not None and sequence.rig.has_stereo
        return perturbed.with_video_later(self.clock_ms * 1e-3) if both and self.clock_ms else perturbed


def predict_integrated(run: Trajectory, pairs: Trajectory, rig: Rig, perturbation: Perturbation) -> Trajectory:
    """Predicts world_from_rig at the video frames of an integrated run, at the run's own times.

    `pairs` is world_from_rig at the stereo frames with the perturbed calibration. The shape of the video's path does
    not change. Errors of the mount and of the clock move that path relative to the rig's; as it is anchored at the
    stereo frames, only the variation between two of them remains.
    """
    perturbed = perturbation.of_rig(rig)
    delay_ns = round(perturbation.clock_ms * 1e6)
    own = run.moved(right=rig.rig_from_video @ perturbed.rig_from_video.inverse())
    own = replace(own, times_ns=own.times_ns + delay_ns)
    inside = pairs.times_ns[(pairs.times_ns >= own.times_ns[0]) & (pairs.times_ns <= own.times_ns[-1])]
    inside = np.setdiff1d(inside, own.times_ns)
    at_pairs = interpolate(own, inside, "linear")
    both = Trajectory.of([*own.items(), *at_pairs.items()], run.frame)
    predicted = anchored(both, pairs)
    predicted = predicted.select(np.isin(predicted.times_ns, own.times_ns))
    return replace(predicted, times_ns=predicted.times_ns - delay_ns)
