"""The last stereo pairs and all video frames between them: what the cameras saw, and where they were."""

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
"""[1/m] A smaller one, from a disparity with its errors, is none: 10 km are beyond what any rig measures."""
NEIGHBOURS = 5
"""Points whose median depth a new point of the video is given: a median of fewer may be that of an outlier."""
NEAREST_BASELINES = 0.2
"""Depth, in baselines, of the nearest known points that lend theirs to others: nearer ones are outliers."""
USUAL_BASELINES = 20.0
"""Depth, in baselines, of points where none is known yet: the middle of what a pair measures well."""
MOST_EXTRAPOLATED = 3
"""Intervals between the last two views that their motion is taken to go on; after longer gaps it says nothing."""

RATES = 8
"""Video frames whose rates tell how far off rates are."""
RATE_SHARE = 0.6
"""How far off the rate by four poses is, over what it differs by from that of three (0.6 of true poses in sim:city)."""


@dataclass(frozen=True, eq=False)
class JointWindow:
    """The exposures that are adjusted together, and all that they were found to say."""

    rig: RigModel
    calibrated: RigModel
    """The rig as calibrated."""
    views: tuple[View, ...] = ()
    """Oldest first; the first is a stereo pair."""
    table: Table = field(default_factory=Table.empty)
    rig_estimates: tuple[RigModel, ...] = ()
    """The rig with its information after each of the last adjustments."""
    pair_errors: Array = field(default_factory=lambda: np.zeros(PAIR))
    """What stereo found to be wrong with the pair (see right_camera.TERMS)."""
    lens_correction: Array = field(default_factory=lambda: np.zeros(LENS))
    """What monocular found to be wrong with the video camera (see window.Window.extra), as it was when the points were
    adjusted: by another one they would not lie where they are seen."""
    lens_covariance: Array | None = None
    """(2, 2) of it; None where it is not known."""
    truncated: bool = False
    """Whether views have left it."""
    knots: tuple[float, ...] = ()
    """Video frames from one knot to the next, as chosen after each pair in it but the first."""
    spline_error: float = 0.0
    """How far their spline passes beside a pose, see knots.spline_error."""
    reference: Reference | None = None
    """Of the last adjustment."""

    @property
    def pairs(self) -> list[int]:
        """Places of the stereo pairs among the views."""
        return [i for i, v in enumerate(self.views) if not v.video]

    @property
    def usual_ns(self) -> int | None:
        """Longest interval between its pairs; None of fewer than two."""
        times_ns = [self.views[i].time_ns for i in self.pairs]
        return max((b - a for a, b in pairwise(times_ns)), default=None)

    def camera_pose(self, view: View) -> Pose:
        """world_from_camera of the video or the left camera."""
        return view.world_from_rig @ (self.rig.rig_from_video if view.video else self.rig.rig_from_left)

    def seen(self, view: View) -> Array:
        """(N, 2) normalised coordinates in the video or the left camera, without what is wrong with its lens; where the
        middle row would have seen them."""
        seen = view.seen if view.middle is None else view.middle
        return corrected(seen, self.lens_correction) if view.video else without_lens(seen, self.pair_errors)

    def predicted(self, time_ns: int) -> Pose:
        """world_from_rig if the motion of the last two views goes on; identity before any view."""
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
        """(12,) of rig_from_world, as of rolling.mean_rates: the mean between a camera's last two views, 0 before."""
        way = self._way(video)
        return np.zeros(12) if way is None else steady(-way[0].log() / (way[1] * 1e-9))

    def rate_variance(self) -> Array:
        """(6,) of the rates by which rows of the last video frames were put together."""
        off = [v.unforeseen for v in self.views if v.video and v.located][-RATES:]
        square = (np.reshape(off, (-1, 2, 3)) ** 2).mean(axis=(0, 2)) if off else np.zeros(2)
        return RATE_SHARE**2 * np.repeat(square, 3)

    def recent(self, time_ns: int) -> list[tuple[int, Pose]]:
        """Times and poses world_from_rig of the last video frames before this time that tell how the rig moves then."""
        views = [v for v in self.views if v.video and v.located and time_ns - SPAN_S * 1e9 <= v.time_ns < time_ns]
        return [(v.time_ns, v.world_from_rig) for v in views[1 - AHEAD :]]

    def _way(self, video: bool) -> tuple[Pose, int] | None:
        """before_rig_from_last_rig of the last two views of a camera, and the time [ns] between them."""
        views = [v for v in self.views if v.video == video][-2:]
        if len(views) < 2 or views[1].time_ns <= views[0].time_ns:
            return None
        return views[0].world_from_rig.inverse() @ views[1].world_from_rig, views[1].time_ns - views[0].time_ns

    def with_view(self, view: View) -> JointWindow:
        """With a view whose pose is known roughly; its new points get a depth, from disparity or from neighbours."""
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
        """Inverse depths (N,) of the known points that appear nearest to (N, 2)."""
        xyz = anchor.inverse().apply(self.table.points.xyz_in_world)
        xyz = xyz[xyz[:, 2] > NEAREST_BASELINES * self.rig.baseline_m]
        if not len(xyz):
            return np.full(len(seen), 1 / (USUAL_BASELINES * self.rig.baseline_m))
        k = min(NEIGHBOURS, len(xyz))
        _, near = KDTree(xyz[:, :2] / xyz[:, 2:]).query(seen, k=k)
        return np.median(1 / xyz[np.reshape(near, (len(seen), k)), 2], axis=1)

    def with_views(self, views: tuple[View, ...], truncated: bool) -> JointWindow:
        """With these of its views, and the points that they see."""
        seen = np.unique(np.concatenate([v.ids for v in views]))
        table = self.table.select(np.isin(self.table.ids, seen))
        return replace(self, views=views, table=table, truncated=truncated)
