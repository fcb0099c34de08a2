"""Fits video poses between two stereo frames to the metric poses (section 6.3, steps 2 and 3; Fig. 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Pose, rotation_angle_rad, rotation_between, slerp
from ispom.types import Trajectory


@dataclass(frozen=True, eq=False)
class Segment:
    """Poses that start and end at the metric ones, and the corrections that this needed."""

    poses: Trajectory
    """world_from_video at the requested times, metric."""
    scale: float
    """Metres per unit of the video trajectory."""
    turn_rad: float
    """Angle between the two segment vectors, after alignment of the first orientations."""
    residual_rad: float
    """Angle of the last orientation's error, which is distributed over the segment."""


def fit_segment(
    video: Trajectory,
    own_start: Pose,
    own_end: Pose,
    start: Pose,
    end: Pose,
    span_ns: tuple[int, int],
    min_length_m: float,
) -> Segment | None:
    """Fits video poses, in their own world and unit, between two times of known metric poses.

    `own_start` and `own_end` are the video's poses at the two times `span_ns`; `start` and `end` are world_from_video
    there. The video world is rotated so that the first orientations agree (the worlds are unrelated). Then positions
    are scaled, and rotated about the start by the smallest rotation that aligns the ends. None if the metric segment is
    shorter than `min_length_m`, or the video's not above rounding, as no scale is defined then.
    """
    metric_vector = end.translation - start.translation
    own_vector = own_end.translation - own_start.translation
    if np.linalg.norm(metric_vector) < min_length_m or np.linalg.norm(own_vector) < 1e-9:
        return None
    scale = float(np.linalg.norm(metric_vector) / np.linalg.norm(own_vector))
    world_from_own = start.rotation @ own_start.rotation.T
    turn = rotation_between(world_from_own @ own_vector, metric_vector)
    offsets = scale * (video.translations - own_start.translation)
    positions = start.translation + offsets @ (turn @ world_from_own).T
    rotations, residual_rad = fit_rotations(video, own_start, own_end, start, end, span_ns)
    poses = Trajectory(video.times_ns, rotations, positions, "video")
    return Segment(poses, scale, float(rotation_angle_rad(turn)), residual_rad)


def fit_rotations(
    video: Trajectory, own_start: Pose, own_end: Pose, start: Pose, end: Pose, span_ns: tuple[int, int]
) -> tuple[np.ndarray, float]:
    """Returns orientations (N, 3, 3) that start and end at the metric ones, and the error [rad] distributed for it."""
    world_from_own = start.rotation @ own_start.rotation.T
    residual = end.rotation @ (world_from_own @ own_end.rotation).T
    fraction = (video.times_ns - span_ns[0]) / (span_ns[1] - span_ns[0])
    return slerp(np.eye(3), residual, fraction) @ world_from_own @ video.rotations, float(rotation_angle_rad(residual))
