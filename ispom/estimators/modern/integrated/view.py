"""What the joint window holds: views of exposures, their points, and the exposure that covariances are relative to."""

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
"""Of two exposures at one time only one is a point of a spline."""


@dataclass(frozen=True, eq=False)
class View:
    """What was seen at one exposure."""

    time_ns: int
    video: bool
    ids: NDArray[np.int64]
    """(N,) ascending; even in the video, odd in stereo pairs."""
    seen: Array
    """(N, 2) normalised coordinates in the video or the left camera."""
    disparity: Array
    """(N,) x in the left camera minus that in the right one, as matched; NaN where unknown, and for the video."""
    late_s: Array | None = None
    """(N,) by how much later their rows are exposed than the middle one, by whose time the pose is; None for none."""
    middle: Array | None = None
    """(N, 2) `seen` as the middle row would have, by the motion then known; None where rows are exposed together."""
    rate: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) of left_from_world's change (rho [m/s], phi [rad/s]; left) that a late right shutter is held to see."""
    unforeseen: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) by how much the rate of rig_from_world by which its rows were put together (rho [m/s], phi [rad/s]) differs
    from what one pose less tells."""
    world_from_rig: Pose = field(default_factory=Pose)
    located: bool = True
    """Whether the pose is from what was seen; else it is that of the view before."""
    metric: bool = True
    """Whether that is in metres (see `locate`)."""
    information: Array | None = None
    """(6, 6) of the pose as first located."""
    smoothed: Pose | None = None
    """The pose as last adjusted with views on both sides of it; at the window's end it has only those after it."""
    attached: tuple[tuple[int, Pose], ...] = ()
    """Time and rig_from_later_rig of video frames after it that were thinned out: they move along with this view."""

    def poses(self) -> list[tuple[int, Pose, bool]]:
        """Time, world_from_rig, whether of the video: its own, and those of the frames attached to it."""
        pose = self.smoothed or self.world_from_rig
        return [(self.time_ns, pose, self.video), *((t, pose @ way, True) for t, way in self.attached)]

    def with_attached(self, later: View) -> View:
        """With a later view that is none any more: it and what was attached to it move along with this one."""
        way = self.world_from_rig.inverse() @ later.world_from_rig
        attached = ((later.time_ns, way), *((t, way @ further) for t, further in later.attached))
        return replace(self, attached=(*self.attached, *attached))

    def rectified(self, extra: Array, baseline_m: float) -> Array:
        """(N,) disparities without the errors of the pair, `extra` (E,) of right_camera.TERMS."""
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
    """The points known by now."""

    ids: NDArray[np.int64]
    """(M,) ascending."""
    points: AnchoredPoints

    @staticmethod
    def empty() -> Table:
        return Table(np.zeros(0, np.int64), AnchoredPoints(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))))

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) index of each id, -1 where unknown."""
        return places(self.ids, ids)

    def select(self, index: NDArray) -> Table:
        p = self.points
        return Table(self.ids[index], AnchoredPoints(p.anchors_r[index], p.anchors_t[index], p.values[index]))

    def with_new(self, ids: NDArray[np.int64], anchor: Pose, values: Array) -> Table:
        """With points that are anchored in a camera's pose."""
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
    """The exposure that covariances of points and of later poses are relative to: its own error is not part of them."""

    time_ns: int
    world_from_rig: Pose
    ids: NDArray[np.int64]
    """(K,) of the points whose errors are known, ascending."""
    uncertainty: PointUncertainty
    """Of these points."""
    newest: Array
    """(6, 6) covariance of the newest pose that was adjusted."""
    drift: Array
    """(6, 6) covariance of the exposure's own pose in the window's world."""


def times_s(views: tuple[View, ...], rig: RigModel) -> Array:
    """(E,) of the exposures since the first, by the clock of the pairs."""
    stamped = np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9
    return stamped + np.where([v.video for v in views], rig.clock_offset_s, 0.0)


def located_poses(views: tuple[View, ...], times_s: Array) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Which views (E,) have poses of their own, in the order of their times; times, rotations, positions."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.array([views[i].located for i in order])]
    order = order[np.concatenate([[True], np.diff(times_s[order]) > LEAST_APART_S])]
    rotations = np.stack([views[i].world_from_rig.rotation for i in order])
    positions = np.stack([views[i].world_from_rig.translation for i in order])
    return order, times_s[order], rotations, positions
