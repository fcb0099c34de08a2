"""The joint window: the last stereo pairs and all video frames between them, with their observations and poses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.rolling import AHEAD, SPAN_S, steady
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.robust import Noise
from ispom.solvers.right_camera import LAG, LEAST_DISPARITY, PAIR, drift, without_errors, without_lens
from ispom.solvers.spline.continuous import PointUncertainty
from ispom.solvers.spline.problem import AnchoredPoints, RigModel
from ispom.solvers.window.prior import LENS

LEAST_APART_S = 1e-6
"""Least time between two poses of a spline [s]: of two frames at one time, one is used."""
LEAST_INVERSE_DEPTH = 1e-4
"""Least inverse depth [1/m] that a disparity gives; 10 km are beyond what any rig measures."""
NEIGHBOURS = 5
"""Number of neighbours whose median depth initialises a new video point: the median of fewer may be an outlier's."""
NEAREST_BASELINES = 0.2
"""Least depth, in baselines, of the points used for that: nearer ones are outliers."""
USUAL_BASELINES = 20.0
"""Depth, in baselines, of new points if no depth is known: the middle of the range that a pair measures well."""
MOST_EXTRAPOLATED = 3
"""Longest prediction of the motion, in intervals between the last two views; across longer gaps the pose is kept."""
RATES = 8
"""Number of video frames whose rates give the variance of a rate."""
RATE_SHARE = 0.6
"""Error of the rate of four poses, relative to its difference from that of three (0.6 for true poses in sim:city)."""


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
    rate_difference: Array = field(default_factory=lambda: np.zeros(6))
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
        return [
            (self.time_ns, pose, self.video),
            *((t, pose @ this_from_later, True) for t, this_from_later in self.attached),
        ]

    def with_attached(self, later: View) -> View:
        """Attaches a later view and the frames attached to that."""
        this_from_later = self.world_from_rig.inverse() @ later.world_from_rig
        attached = ((later.time_ns, this_from_later), *((t, this_from_later @ pose) for t, pose in later.attached))
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


def estimated_poses(views: tuple[View, ...], times_s: Array) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Returns the indices (E,) of the views with poses of their own, ordered by time; times, rotations, positions."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.array([views[i].located for i in order])]
    order = order[np.concatenate([[True], np.diff(times_s[order]) > LEAST_APART_S])]
    rotations = np.stack([views[i].world_from_rig.rotation for i in order])
    positions = np.stack([views[i].world_from_rig.translation for i in order])
    return order, times_s[order], rotations, positions


@dataclass(frozen=True, eq=False)
class JointWindow:
    """The frames that are optimised together, and the results."""

    rig: RigModel
    calibrated: RigModel
    """The rig as calibrated."""
    views: tuple[View, ...] = ()
    """Oldest first; the first is a stereo pair."""
    table: Table = field(default_factory=Table.empty)
    rig_estimates: tuple[RigModel, ...] = ()
    """The rig with its information after each of the last optimisations."""
    pair_errors: Array = field(default_factory=lambda: np.zeros(PAIR))
    """Corrections of the stereo pair by the stereo method (see right_camera.TERMS)."""
    lens_correction: Array = field(default_factory=lambda: np.zeros(LENS))
    """Lens correction of the video camera by the monocular method (see window.Window.extra). It is that of the last
    optimisation, as the points fit the observations only with the same correction."""
    lens_covariance: Array | None = None
    """(2, 2) covariance of the lens correction; None if unknown."""
    truncated: bool = False
    """Whether views have left the window."""
    knots: tuple[float, ...] = ()
    """Knot spacing in video frames, as chosen after each pair in the window but the first."""
    spline_error: float = 0.0
    """Squared error of the spline, see knots.spline_error."""
    reference: Reference | None = None
    """Reference of the last optimisation."""

    @property
    def pairs(self) -> list[int]:
        """Indices of the stereo pairs among the views."""
        return [i for i, v in enumerate(self.views) if not v.video]

    @property
    def usual_ns(self) -> int | None:
        """Longest interval between the pairs [ns]; None for fewer than two."""
        times_ns = [self.views[i].time_ns for i in self.pairs]
        return max((b - a for a, b in pairwise(times_ns)), default=None)

    def camera_pose(self, view: View) -> Pose:
        """Returns world_from_camera of the video or the left camera."""
        return view.world_from_rig @ (self.rig.rig_from_video if view.video else self.rig.rig_from_left)

    def seen(self, view: View) -> Array:
        """Returns the normalised coordinates (N, 2) in the video or the left camera, without lens errors, as the middle
        row would have observed them."""
        seen = view.seen if view.middle is None else view.middle
        return corrected(seen, self.lens_correction) if view.video else without_lens(seen, self.pair_errors)

    def predicted(self, time_ns: int) -> Pose:
        """Predicts world_from_rig with the velocity of the last two views; identity before any view."""
        if not self.views:
            return Pose()
        last = self.views[-1]
        recent = self._last_motion(last.video)
        if recent is None:
            return last.world_from_rig
        before_from_last, interval_ns = recent
        share = (time_ns - last.time_ns) / interval_ns
        if share > MOST_EXTRAPOLATED:
            return last.world_from_rig
        return last.world_from_rig @ Pose.exp(share * before_from_last.log())

    def motion(self, video: bool) -> Array:
        """Returns the motion (12,) of rig_from_world, see rolling.steady: the mean between a camera's last two
        views; 0 for fewer."""
        recent = self._last_motion(video)
        if recent is None:
            return np.zeros(12)
        before_from_last, interval_ns = recent
        return steady(-before_from_last.log() / (interval_ns * 1e-9))

    def rate_variance(self) -> Array:
        """Returns the variance (6,) of the rates that corrected the rolling shutter of the last video frames."""
        off = [v.rate_difference for v in self.views if v.video and v.located][-RATES:]
        square = (np.reshape(off, (-1, 2, 3)) ** 2).mean(axis=(0, 2)) if off else np.zeros(2)
        return RATE_SHARE**2 * np.repeat(square, 3)

    def recent(self, time_ns: int) -> list[tuple[int, Pose]]:
        """Returns times and poses world_from_rig of the last video frames before this time, for the rate of the
        motion."""
        views = [v for v in self.views if v.video and v.located and time_ns - SPAN_S * 1e9 <= v.time_ns < time_ns]
        return [(v.time_ns, v.world_from_rig) for v in views[1 - AHEAD :]]

    def _last_motion(self, video: bool) -> tuple[Pose, int] | None:
        """Returns before_rig_from_last_rig of the last two views of a camera, and the time [ns] between them."""
        views = [v for v in self.views if v.video == video][-2:]
        if len(views) < 2 or views[1].time_ns <= views[0].time_ns:
            return None
        return views[0].world_from_rig.inverse() @ views[1].world_from_rig, views[1].time_ns - views[0].time_ns

    def with_view(self, view: View) -> JointWindow:
        """Adds a view with a rough pose; its new points get a depth from disparity or from neighbours."""
        new = self.table.places(view.ids) < 0
        anchor = self.camera_pose(view)
        seen = self.seen(view)[new]
        inverse_depth = view.rectified(self.pair_errors, self.rig.baseline_m)[new] / self.rig.baseline_m
        unknown = ~(inverse_depth > LEAST_INVERSE_DEPTH)
        if unknown.any():
            inverse_depth[unknown] = self._neighbours(anchor, seen[unknown])
        values = np.column_stack([seen, inverse_depth])
        return replace(self, views=(*self.views, view), table=self.table.with_new(view.ids[new], anchor, values))

    def _neighbours(self, anchor: Pose, seen: Array) -> Array:
        """Returns the median inverse depths (N,) of the known points nearest to normalised coordinates (N, 2)."""
        xyz = anchor.inverse().apply(self.table.points.xyz_in_world)
        xyz = xyz[xyz[:, 2] > NEAREST_BASELINES * self.rig.baseline_m]
        if not len(xyz):
            return np.full(len(seen), 1 / (USUAL_BASELINES * self.rig.baseline_m))
        k = min(NEIGHBOURS, len(xyz))
        _, near = KDTree(xyz[:, :2] / xyz[:, 2:]).query(seen, k=k)
        return np.median(1 / xyz[np.reshape(near, (len(seen), k)), 2], axis=1)

    def with_views(self, views: tuple[View, ...], truncated: bool) -> JointWindow:
        """Keeps only these views and the points that they observe."""
        seen = np.unique(np.concatenate([v.ids for v in views]))
        table = self.table.select(np.isin(self.table.ids, seen))
        return replace(self, views=views, table=table, truncated=truncated)
