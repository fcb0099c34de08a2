"""Data of the estimation of a trajectory as a spline from the observations of a rig; `continuous.solve` solves it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.solvers.spline.curve import Sampled, Spline

VIDEO, LEFT = 0, 1
"""Camera numbers in the observations."""


@dataclass(frozen=True, eq=False)
class AnchoredPoints:
    """Points of the scene, each in the coordinate frame of its anchor, which is fixed in the world."""

    anchors_r: Array
    """(M, 3, 3) world_from_anchor."""
    anchors_t: Array
    """(M, 3) world_from_anchor [m]."""
    values: Array
    """(M, 3) x / z, y / z and 1 / z [1/m] in the anchor."""

    def __len__(self) -> int:
        return len(self.values)

    @property
    def xyz_in_world(self) -> Array:
        """Returns the positions (M, 3) [m]; a point at or beyond infinity is placed 1 km away."""
        ray = np.column_stack([self.values[:, :2], np.ones(len(self))])
        depth = 1 / np.maximum(self.values[:, 2], 1e-3)
        return np.einsum("mij,mj->mi", self.anchors_r, depth[:, None] * ray) + self.anchors_t


@dataclass(frozen=True, eq=False)
class RowBands:
    """Bands of rows of a rolling shutter, each with one time that differs from its frame's."""

    exposure: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(B,) index of the frame."""
    late_s: Array = field(default_factory=lambda: np.zeros(0))
    """(B,) delay after the frame's time."""


@dataclass(frozen=True, eq=False)
class RigObservations:
    """Observations of the points by the cameras, sorted by point."""

    exposure: NDArray[np.int64]
    """(O,) index of the time: frames first, then bands of rows."""
    camera: NDArray[np.int64]
    """(O,) VIDEO or LEFT."""
    owner: NDArray[np.int64]
    """(O,) index of the point."""
    seen: Array
    """(O, 3) normalised, undistorted x and y; left x minus right x."""
    inverse_sigma: Array
    """(O, 3) inverse standard deviations; 0 where unknown, as the third is in video frames."""


@dataclass(frozen=True, eq=False)
class RigModel:
    """The calibration of the rig: the pose of the video camera in it, and its time offset."""

    rig_from_video: Pose
    rig_from_left: Pose
    baseline_m: float
    """Baseline of the rectified pair, from the left camera to the right one."""
    clock_offset_s: float
    """Time offset of video frames: exposure on the stereo clock minus time stamp."""
    information: Array
    """(7, 7) information of rotation [rad], position [m] and offset [s], about these values."""
    free: NDArray[np.bool_]
    """(7,) whether each is an unknown."""

    def moved(self, step: Array) -> RigModel:
        """Returns the rig with the video camera rotated by step[:3] and moved by step[3:6], the offset by step[6]."""
        video = self.rig_from_video
        video = Pose(video.rotation @ so3_exp(step[:3]), video.translation + step[3:6])
        return replace(self, rig_from_video=video, clock_offset_s=self.clock_offset_s + float(step[6]))

    def minus(self, other: RigModel) -> Array:
        """Returns the step (7,) from the other rig to this one."""
        a, b = self.rig_from_video, other.rig_from_video
        turn, shift = so3_log(b.rotation.T @ a.rotation), a.translation - b.translation
        return np.concatenate([turn, shift, [self.clock_offset_s - other.clock_offset_s]])

    def arrays(self) -> tuple[Array, Array]:
        """Returns rotations (2, 3, 3) and positions (2, 3) of the video and the left camera in the rig."""
        poses = (self.rig_from_video, self.rig_from_left)
        return np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])


@dataclass(frozen=True, eq=False)
class PosePrior:
    """The prior of the pose at one frame, which fixes the world."""

    exposure: int
    world_from_rig: Pose
    information: Array
    """(6, 6) information of the rotation in the rig [rad] and the position in the world [m]."""


@dataclass(frozen=True, eq=False)
class SplineProblem:
    """The values, observations and priors; `solve` returns it with optimised values."""

    spline: Spline
    times_s: Array
    """(E,) time stamps of the frames."""
    video: NDArray[np.bool_]
    """(E,) whether a frame is the video camera's."""
    points: AnchoredPoints
    observations: RigObservations
    rig: RigModel
    rig_prior: RigModel
    """The prior of the rig."""
    prior: PosePrior
    depth_prior: Array
    """(M, 2) prior inverse depth [1/m] and its inverse variance."""
    smoothness: tuple[float, float] = (100.0, 50.0)
    """Prior standard deviations of angular [rad/s^2] and linear [m/s^2] acceleration."""
    loss: float = 2.0
    """Scale of the robust loss, in standard deviations of an observation."""
    bands: RowBands = RowBands()

    def sampled(self) -> Sampled:
        """Returns the poses at the frames, on the clock of the stereo pair, followed by those of the bands."""
        exposed = self.times_s + np.where(self.video, self.rig.clock_offset_s, 0.0)
        return self.spline.at(np.concatenate([exposed, exposed[self.bands.exposure] + self.bands.late_s]))

    @property
    def exposures(self) -> NDArray[np.int64]:
        """Returns the frame index (O,) of each observation."""
        return np.concatenate([np.arange(len(self.times_s)), self.bands.exposure])[self.observations.exposure]
