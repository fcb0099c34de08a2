"""Contents of the joint window: views, points, and the reference of the covariances."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.robust import Noise
from ispom.solvers.right_camera import LAG, LEAST_DISPARITY, drift, without_errors
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.problem import AnchoredPoints, RigModel

LEAST_APART_S = 1e-6
"""Least time between two poses of a spline [s]: of two frames at one time, one is used."""


@dataclass(frozen=True, eq=False)
class View:
    """The observations and the pose of one frame."""

    time_ns: int
    video: bool
    ids: NDArray[np.int64]
    """(N,) ids, ascending; even for the video, odd for stereo pairs."""
    seen: Array
    """(N, 2) normalised coordinates in the video or the left camera."""
    disparity: Array
    """(N,) normalised disparity, x in the left camera minus x in the right one; NaN if unknown, and for the video."""
    late_s: Array | None = None
    """(N,) exposure time of each row relative to the middle one, at which the pose is; None for a global shutter."""
    middle: Array | None = None
    """(N, 2) `seen` at the time of the middle row, by the motion known then; None for a global shutter."""
    rate: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) left rate of left_from_world (rho [m/s], phi [rad/s]) with which a delay of the right shutter is
    corrected."""
    unforeseen: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) difference of the rates of rig_from_world (rho [m/s], phi [rad/s]) by all poses used and by one pose less: a
    measure of their error."""
    world_from_rig: Pose = field(default_factory=Pose)
    located: bool = True
    """Whether the pose was estimated from observations; otherwise it is that of the view before."""
    metric: bool = True
    """Whether the pose is metric (see `locate`)."""
    information: Array | None = None
    """(6, 6) information of the pose when it was first localised."""
    smoothed: Pose | None = None
    """The pose as last optimised with views on both sides of it; at the start of the window it has only those after
    it."""
    attached: tuple[tuple[int, Pose], ...] = ()
    """Time and rig_from_later_rig of the later video frames that were thinned out: they move along with this view."""

    def poses(self) -> list[tuple[int, Pose, bool]]:
        """Returns time, world_from_rig, and whether of the video, of this view and of the frames attached to it."""
        pose = self.smoothed or self.world_from_rig
        return [(self.time_ns, pose, self.video), *((t, pose @ way, True) for t, way in self.attached)]

    def with_attached(self, later: View) -> View:
        """Attaches a later view and the frames attached to that."""
        way = self.world_from_rig.inverse() @ later.world_from_rig
        attached = ((later.time_ns, way), *((t, way @ further) for t, further in later.attached))
        return replace(self, attached=(*self.attached, *attached))

    def rectified(self, extra: Array, baseline_m: float) -> Array:
        """Returns the disparities (N,) without the errors of the pair; `extra` (E,) are the corrections
        right_camera.TERMS."""
        if self.video:
            return self.disparity
        seen = without_errors(np.column_stack([self.seen, self.seen[:, 0] - self.disparity]), extra)
        parallel = seen[:, 0] - seen[:, 2]
        depth = baseline_m / np.maximum(parallel, LEAST_DISPARITY)
        near = np.column_stack([seen[:, :2], np.ones(len(seen))]) * depth[:, None]
        late = drift(near, self.rate[None], extra[LAG], baseline_m)
        return parallel + extra[LAG] * late[:, 0]


@dataclass(frozen=True, eq=False)
class Table:
    """The known points."""

    ids: NDArray[np.int64]
    """(M,) ids, ascending."""
    points: AnchoredPoints

    @staticmethod
    def empty() -> Table:
        return Table(np.zeros(0, np.int64), AnchoredPoints(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))))

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns the index (N,) of each id, -1 where unknown."""
        return places(self.ids, ids)

    def select(self, index: NDArray) -> Table:
        p = self.points
        return Table(self.ids[index], AnchoredPoints(p.anchors_r[index], p.anchors_t[index], p.values[index]))

    def with_new(self, ids: NDArray[np.int64], anchor: Pose, values: Array) -> Table:
        """Adds points anchored in a camera's pose."""
        n, p = len(ids), self.points
        all_ids = np.concatenate([self.ids, ids])
        rotations = np.concatenate([p.anchors_r, np.repeat(anchor.rotation[None], n, 0)])
        positions = np.concatenate([p.anchors_t, np.repeat(anchor.translation[None], n, 0)])
        found = Table(all_ids, AnchoredPoints(rotations, positions, np.concatenate([p.values, values])))
        return found.select(np.argsort(all_ids, kind="stable"))


@dataclass(frozen=True, eq=False)
class RigNoise:
    """Noise of the observations of both cameras, normalised."""

    video: Noise
    stereo: Noise
    disparity: Noise

    def of(self, video: bool) -> Noise:
        """Returns the noise of an image point."""
        return self.video if video else self.stereo


@dataclass(frozen=True, eq=False)
class Reference:
    """The frame that covariances of points and of later poses are relative to: they exclude its own error."""

    time_ns: int
    world_from_rig: Pose
    ids: NDArray[np.int64]
    """(K,) ids of the points with a covariance, ascending."""
    uncertainty: PointUncertainty
    """Uncertainty of these points."""
    newest: Array
    """(6, 6) covariance of the newest optimised pose."""
    drift: Array
    """(6, 6) covariance of the frame's own pose in the window's world."""


def times_s(views: tuple[View, ...], rig: RigModel) -> Array:
    """Returns the times (E,) [s] of the frames since the first, by the clock of the pairs."""
    stamped = np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9
    return stamped + np.where([v.video for v in views], rig.clock_offset_s, 0.0)


def located_poses(views: tuple[View, ...], times_s: Array) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Returns the indices (E,) of the views with poses of their own, ordered by time; times, rotations, positions."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.array([views[i].located for i in order])]
    order = order[np.concatenate([[True], np.diff(times_s[order]) > LEAST_APART_S])]
    rotations = np.stack([views[i].world_from_rig.rotation for i in order])
    positions = np.stack([views[i].world_from_rig.translation for i in order])
    return order, times_s[order], rotations, positions
