"""What one trajectory as a spline through the observations of a rig is estimated from; `continuous.solve` solves it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp, so3_log
from ispom.solvers.spline.curve import Sampled, Spline

VIDEO, LEFT = 0, 1
"""Camera numbers of the observations."""


@dataclass(frozen=True, eq=False)
class AnchoredPoints:
    """Points of the scene, each in its anchor: a frame at rest in the world."""

    anchors_r: Array
    """(M, 3, 3) world_from_anchor."""
    anchors_t: Array
    """(M, 3) [m]."""
    values: Array
    """(M, 3): x / z, y / z and 1 / z in the anchor; 1 / z in 1/m."""

    def __len__(self) -> int:
        return len(self.values)

    @property
    def xyz_in_world(self) -> Array:
        """(M, 3) [m]; a point at or beyond infinity is put 1 km away."""
        ray = np.column_stack([self.values[:, :2], np.ones(len(self))])
        depth = 1 / np.maximum(self.values[:, 2], 1e-3)
        return np.einsum("mij,mj->mi", self.anchors_r, depth[:, None] * ray) + self.anchors_t


@dataclass(frozen=True, eq=False)
class RowBands:
    """Rows of a rolling shutter that count as exposed together, at another time than their exposure's."""

    exposure: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(B,) index of the exposure."""
    late_s: Array = field(default_factory=lambda: np.zeros(0))
    """(B,) how much later than it."""


@dataclass(frozen=True, eq=False)
class RigObservations:
    """Where the cameras saw the points; sorted by point."""

    exposure: NDArray[np.int64]
    """(O,) index of the time: of an exposure, or from their number on of a band of rows."""
    camera: NDArray[np.int64]
    """(O,) VIDEO or LEFT."""
    owner: NDArray[np.int64]
    """(O,) index of the point."""
    seen: Array
    """(O, 3) normalised, undistorted coordinates; left x minus right x."""
    inverse_sigma: Array
    """(O, 3) one over the standard deviation of each; 0 where it is unknown, as the third is in the video."""


@dataclass(frozen=True, eq=False)
class RigModel:
    """What is believed about the rig: the pose of the video camera in it, and its clock."""

    rig_from_video: Pose
    rig_from_left: Pose
    baseline_m: float
    """From the left camera to the right one of a rectified pair."""
    clock_offset_s: float
    """Video exposes this much later than its time stamps say, on the stereo clock."""
    information: Array
    """(7, 7) of rotation [rad], position [m] and offset [s], about the values here."""
    free: NDArray[np.bool_]
    """(7,) which of them are unknowns."""

    def moved(self, step: Array) -> RigModel:
        """With the video camera turned by step[:3], moved by step[3:6], and the offset changed by step[6]."""
        video = self.rig_from_video
        video = Pose(video.rotation @ so3_exp(step[:3]), video.translation + step[3:6])
        return replace(self, rig_from_video=video, clock_offset_s=self.clock_offset_s + float(step[6]))

    def minus(self, other: RigModel) -> Array:
        """(7,) the step that leads from the other to this one."""
        a, b = self.rig_from_video, other.rig_from_video
        turn, shift = so3_log(b.rotation.T @ a.rotation), a.translation - b.translation
        return np.concatenate([turn, shift, [self.clock_offset_s - other.clock_offset_s]])

    def arrays(self) -> tuple[Array, Array]:
        """Rotations (2, 3, 3) and positions (2, 3) of video and left camera in the rig."""
        poses = (self.rig_from_video, self.rig_from_left)
        return np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])


@dataclass(frozen=True, eq=False)
class PosePrior:
    """What is believed about the pose at one exposure: it holds the world in place."""

    exposure: int
    world_from_rig: Pose
    information: Array
    """(6, 6) of the rotation in the rig [rad] and the position in the world [m]."""


@dataclass(frozen=True, eq=False)
class SplineProblem:
    """All that is known; `solve` gives the same with better values."""

    spline: Spline
    times_s: Array
    """(E,) of the exposures, as stamped."""
    video: NDArray[np.bool_]
    """(E,) which of them are the video camera's."""
    points: AnchoredPoints
    observations: RigObservations
    rig: RigModel
    rig_prior: RigModel
    """What was known about the rig before these observations."""
    prior: PosePrior
    depth_prior: Array
    """(M, 2) expected inverse depth [1/m] and its inverse variance."""
    smoothness: tuple[float, float] = (100.0, 50.0)
    """Standard deviations of angular [rad/s^2] and linear [m/s^2] acceleration."""
    loss: float = 2.0
    """Scale of the Cauchy loss, in standard deviations of an observation."""
    bands: RowBands = RowBands()

    def sampled(self) -> Sampled:
        """The poses at the exposures, by the clock of the stereo pair, and after them those of the bands."""
        exposed = self.times_s + np.where(self.video, self.rig.clock_offset_s, 0.0)
        return self.spline.at(np.concatenate([exposed, exposed[self.bands.exposure] + self.bands.late_s]))

    @property
    def exposures(self) -> NDArray[np.int64]:
        """(O,) that the observations belong to."""
        return np.concatenate([np.arange(len(self.times_s)), self.bands.exposure])[self.observations.exposure]
