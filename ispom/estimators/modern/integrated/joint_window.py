"""The joint window: the last stereo pairs and all video frames between them, with their observations and poses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from ispom.estimators.modern.integrated.view import Reference, Table, View
from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.rolling import AHEAD, SPAN_S, steady
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR, without_lens
from ispom.solvers.spline.problem import RigModel
from ispom.solvers.window.prior import LENS

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
        way = self._way(last.video)
        if way is None:
            return last.world_from_rig
        share = (time_ns - last.time_ns) / way[1]
        if share > MOST_EXTRAPOLATED:
            return last.world_from_rig
        return last.world_from_rig @ Pose.exp(share * way[0].log())

    def motion(self, video: bool) -> Array:
        """Returns the motion (12,) of rig_from_world, see rolling.steady: the mean between a camera's last two
        views; 0 for fewer."""
        way = self._way(video)
        return np.zeros(12) if way is None else steady(-way[0].log() / (way[1] * 1e-9))

    def rate_variance(self) -> Array:
        """Returns the variance (6,) of the rates that corrected the rolling shutter of the last video frames."""
        off = [v.unforeseen for v in self.views if v.video and v.located][-RATES:]
        square = (np.reshape(off, (-1, 2, 3)) ** 2).mean(axis=(0, 2)) if off else np.zeros(2)
        return RATE_SHARE**2 * np.repeat(square, 3)

    def recent(self, time_ns: int) -> list[tuple[int, Pose]]:
        """Returns times and poses world_from_rig of the last video frames before this time, for the rate of the
        motion."""
        views = [v for v in self.views if v.video and v.located and time_ns - SPAN_S * 1e9 <= v.time_ns < time_ns]
        return [(v.time_ns, v.world_from_rig) for v in views[1 - AHEAD :]]

    def _way(self, video: bool) -> tuple[Pose, int] | None:
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
