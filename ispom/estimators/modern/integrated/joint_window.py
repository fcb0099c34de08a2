"""The last stereo pairs and all video frames between them, as one problem over what the cameras saw."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.view import Noise, Reference, Table, View
from ispom.estimators.modern.lens import corrected
from ispom.geometry import Array, Pose
from ispom.solvers.continuous import (
    LEFT,
    VIDEO,
    PosePrior,
    RigModel,
    RigObservations,
    Solution,
    SplineProblem,
    solve,
)
from ispom.solvers.prior import LENS, PAIR
from ispom.solvers.spline import ORDER
from ispom.solvers.spline_fit import fitted, misfits
from ispom.types import Decision

MIN_VIEWS = {True: 3, False: 2}
"""Of a point to take part: in the video (where two say nothing that could be wrong) and in stereo pairs."""
KNOT_FRAMES = (6.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0)
"""Video frames from one knot to the next, to choose from."""
USUAL_KNOT_FRAMES = 2.0
"""Where the motion cannot tell."""
LEAST_DISPARITY = 1 / 2000
"""Normalised; a smaller one says no more than that the point is far."""
HELD = 1e10
"""Information [1/rad^2, 1/m^2] of a pose that others are told relative to."""
NEIGHBOURS = 5
"""Points whose median depth a new point of the video is given."""
NEWEST = 8
"""The last views are never thinned out: what comes next is placed by them."""
MOST_CARRIED = 3
"""Frames that move along with others, per view that the window may have: with more its oldest part leaves it."""


@dataclass(frozen=True, eq=False)
class JointWindow:
    rig: RigModel
    initial: RigModel
    """The rig as calibrated."""
    views: tuple[View, ...] = ()
    """Oldest first; the first is a stereo pair."""
    table: Table = field(default_factory=Table.empty)
    beliefs: tuple[RigModel, ...] = ()
    """What was known of the rig after each of the last adjustments."""
    of_pair: Array = field(default_factory=lambda: np.zeros(PAIR))
    """What stereo found to be wrong with the pair (see window.Window.extra)."""
    of_lens: Array = field(default_factory=lambda: np.zeros(LENS))
    """What monocular found to be wrong with the video camera (see window.Window.extra)."""
    slid: bool = False
    """Whether views have left it."""
    knots: tuple[float, ...] = ()
    """Video frames from one knot to the next, as chosen after each pair in it but the first."""
    reference: Reference | None = None
    """Of the last adjustment."""

    @property
    def pairs(self) -> list[int]:
        """Places of the stereo pairs among the views."""
        return [i for i, v in enumerate(self.views) if not v.video]

    def camera_pose(self, view: View) -> Pose:
        """world_from_camera of the video or the left camera."""
        return view.world_from_rig @ (self.rig.rig_from_video if view.video else self.rig.rig_from_left)

    def seen(self, view: View) -> Array:
        """(N, 2) normalised coordinates in the video or the left camera, without what is wrong with the lens."""
        return corrected(view.seen, self.of_lens) if view.video else view.seen

    def predicted(self, time_ns: int) -> Pose:
        """world_from_rig if the motion of the last two views goes on; identity before any view."""
        if not self.views:
            return Pose()
        last = self.views[-1]
        before = [v for v in self.views[:-1] if v.video == last.video]
        if not before or last.time_ns <= before[-1].time_ns:
            return last.world_from_rig
        share = (time_ns - last.time_ns) / (last.time_ns - before[-1].time_ns)
        if share > 3:
            return last.world_from_rig
        return last.world_from_rig @ Pose.exp(share * (before[-1].world_from_rig.inverse() @ last.world_from_rig).log())

    def with_view(self, view: View) -> JointWindow:
        """With a view whose pose is known roughly; its new points get a depth, from disparity or from neighbours."""
        new = self.table.places(view.ids) < 0
        anchor = self.camera_pose(view)
        seen = self.seen(view)[new]
        depth = view.rectified(self.of_pair, self.rig.baseline_m)[new] / self.rig.baseline_m
        unknown = ~(depth > 1e-4)
        if unknown.any():
            depth[unknown] = self._neighbours(anchor, seen[unknown])
        values = np.column_stack([seen, depth])
        return replace(self, views=(*self.views, view), table=self.table.with_new(view.ids[new], anchor, values))

    def _neighbours(self, anchor: Pose, seen: Array) -> Array:
        """Inverse depths (N,) of the known points that appear nearest to (N, 2)."""
        xyz = anchor.inverse().apply(self.table.points.xyz_in_world)
        xyz = xyz[xyz[:, 2] > 0.1]
        if not len(xyz):
            return np.full(len(seen), 0.1)
        k = min(NEIGHBOURS, len(xyz))
        _, near = KDTree(xyz[:, :2] / xyz[:, 2:]).query(seen, k=k)
        return np.median(1 / xyz[np.reshape(near, (len(seen), k)), 2], axis=1)

    def adjusted(
        self, noise: Noise, spacing_s: float, most: int, iterations: int, reference_ns: int
    ) -> tuple[JointWindow, Solution] | None:
        """All poses, points and what is free of the rig, made better; None where too little was seen.

        The errors of the points are told relative to the exposure at `reference_ns`.
        """
        problem, used = self._problem(noise, spacing_s, most)
        if problem is None:
            return None
        solution = solve(problem, iterations)
        s = solution.sampled
        poses = [Pose(r, p) for r, p in zip(s.rotations, s.positions, strict=True)]
        edge = self.pairs[1]
        views = tuple(
            replace(
                v,
                world_from_rig=poses[i],
                best=v.best if v.best is not None and i < edge and self.slid else poses[i],
                placed=True,
                information=None,
            )
            for i, v in enumerate(self.views)
        )
        values = self.table.points.values.copy()
        values[used] = solution.problem.points.values
        table = replace(self.table, points=replace(self.table.points, values=values))
        after = replace(self, rig=solution.problem.rig, views=views, table=table)
        reference, parameters = after._seen_from(reference_ns, solution, used)
        beliefs = (*self.beliefs, solution.refined_rig(parameters))[-len(self.pairs) :]
        return replace(after, reference=reference, beliefs=beliefs), solution

    def _seen_from(self, time_ns: int, solution: Solution, used: NDArray[np.int64]) -> tuple[Reference, Array]:
        """The errors of the points that may be seen again, and of the newest pose, relative to a pair's."""
        place = {v.time_ns: i for i, v in enumerate(self.views) if not v.video}
        here = place[time_ns]
        pose = self.views[here].world_from_rig
        parameters = solution.parameter_covariance(PosePrior(here, pose, np.eye(6) * HELD))
        recent = [next((v.ids for v in reversed(self.views) if v.video == video), used[:0]) for video in (True, False)]
        chosen = np.flatnonzero(np.isin(self.table.ids[used], np.concatenate(recent)))
        drift, before = np.zeros((6, 6)), self.reference
        if before is not None:
            # How unsure the way from the last such pair is, and how unsure that one was.
            there = place.get(before.time_ns, 0)
            carry = (pose.inverse() @ self.views[there].world_from_rig).adjoint
            drift = carry @ (before.drift + solution.pose_covariance(there, parameters)) @ carry.T
        points = solution.point_uncertainty(chosen, parameters)
        newest = solution.pose_covariance(len(self.views) - 1, parameters)
        return Reference(time_ns, pose, self.table.ids[used[chosen]], points, newest, drift), parameters

    def misfit(self, spacing_s: float) -> float | None:
        """How far the poses located since the last adjustment lie from a spline with such knots.

        Mean square per degree of freedom, in what their points' errors make of them; None where they are too few.
        """
        times_s = _times_s(self.views, self.rig)
        # Pairs take no part: were the clocks apart, they would look like motion that only fine knots can follow.
        views = tuple(replace(v, placed=v.placed and v.video) for v in self.views)
        if sum(v.placed for v in views) < ORDER:
            return None
        order, times, rotations, positions = _ways(views, times_s)
        new = np.array([self.views[i].information is not None for i in order])
        freedom = new.sum() - (times[new].max() - times[new].min()) / spacing_s if new.any() else 0.0
        if freedom < 2:
            return None
        off = misfits(fitted(times, rotations, positions, spacing_s), times, rotations, positions)[new]
        information = np.stack([self.views[i].information for i in order[new]])
        return float(np.einsum("ei,eij,ej->", off, information, off)) / (6 * float(freedom))

    def with_knots(self, frame_s: float, most: float) -> tuple[JointWindow, Decision]:
        """With the coarsest knots, in frames, that the poses since the last adjustment lie near enough to; and why."""
        chosen, misfit = KNOT_FRAMES[-1], None
        for frames in KNOT_FRAMES[:-1]:
            found = self.misfit(self.spacing_s(frames, frame_s))
            misfit = misfit if found is None else found
            if found is not None and found <= most:
                chosen = frames
                break
        if misfit is None:
            chosen, misfit = USUAL_KNOT_FRAMES, 0.0
        # A window has one spacing: that of its liveliest part.
        knots = (*self.knots, chosen)[1 - len(self.pairs) :]
        because = f"knots every {min(knots):g} frames" + ("" if chosen == min(knots) else ", for the motion before")
        return replace(self, knots=knots), checks.SPLINE_MISFIT.of(misfit, most, because)

    def shortened(self, pairs: int) -> tuple[JointWindow, tuple[View, ...]]:
        """With this many stereo pairs, and the views that left."""
        places = self.pairs
        if len(places) <= pairs:
            return self, ()
        cut = places[-pairs]
        return self._with_views(self.views[cut:], slid=True), self.views[:cut]

    def limited(self, most: int) -> tuple[JointWindow, tuple[View, ...]]:
        """With at most so many views, and those that left: none, unless a very long time passes between two pairs.

        Where there are too many, every second video view of the longest way between two pairs (or since the last one)
        becomes a frame that moves along with the view before it.
        """
        if len(self.views) <= most:
            return self, ()
        if sum(len(v.carried) for v in self.views) > MOST_CARRIED * most:
            cut = len(self.views) // 2
            return self._with_views(self.views[cut:], slid=True), self.views[:cut]
        ends = [-1, *self.pairs, len(self.views) - NEWEST]
        before, after = max(pairwise(ends), key=lambda way: way[1] - way[0])
        views = list[View]()
        for i, view in enumerate(self.views):
            thinned = before < i - 1 and i < after and (i - before) % 2 == 0
            if thinned:
                views[-1] = views[-1].carrying(view)
            else:
                views.append(view)
        return self._with_views(tuple(views), self.slid), ()

    def _with_views(self, views: tuple[View, ...], slid: bool) -> JointWindow:
        """With these of its views, and the points that they see."""
        seen = np.unique(np.concatenate([v.ids for v in views]))
        table = self.table.select(np.isin(self.table.ids, seen))
        return replace(self, views=views, table=table, slid=slid)

    def spacing_s(self, frames: float, frame_s: float) -> float:
        """Of knots that many video frames apart; of a thinned window, views apart: more knots would not be held."""
        if not any(v.carried for v in self.views):
            return frames * frame_s
        span_s = (self.views[-1].time_ns - self.views[0].time_ns) * 1e-9
        return frames * max(frame_s, span_s / len(self.views))

    def _belief(self) -> RigModel:
        """What was known of the rig from observations that are no longer in the window: none counts twice."""
        return self.beliefs[0] if self.slid and len(self.beliefs) >= len(self.pairs) - 1 else self.initial

    def _problem(self, noise: Noise, spacing_s: float, most: int) -> tuple[SplineProblem | None, NDArray[np.int64]]:
        """The problem, and which points of the table take part."""
        views = self.views
        place = np.concatenate([self.table.places(v.ids) for v in views])
        exposure = np.repeat(np.arange(len(views)), [len(v.ids) for v in views])
        video = np.array([v.video for v in views])
        count = np.bincount(place, minlength=len(self.table.ids))
        least = np.where(self.table.ids % 2 == 0, MIN_VIEWS[True], MIN_VIEWS[False])
        used = _longest(count, least, self.table.ids % 2 == 0, most)
        if len(used) < 12:
            return None, used
        number = np.full(len(self.table.ids), -1)
        number[used] = np.arange(len(used))
        owner = number[place]
        index = np.flatnonzero(owner >= 0)
        index = index[np.lexsort((exposure[index], owner[index]))]
        camera = np.where(video[exposure[index]], VIDEO, LEFT)
        seen = np.column_stack(
            [
                np.concatenate([self.seen(v) for v in views]),
                np.concatenate([v.rectified(self.of_pair, self.rig.baseline_m) for v in views]),
            ]
        )[index]
        inverse = 1 / np.array([[noise.video] * 2 + [np.inf], [noise.stereo] * 2 + [noise.disparity]])[camera]
        inverse[np.isnan(seen[:, 2]), 2] = 0.0
        observations = RigObservations(exposure[index], camera, owner[index], np.nan_to_num(seen), inverse)
        points = self.table.select(used).points
        prior = PosePrior(0, views[0].world_from_rig, np.eye(6) * HELD)
        depth_prior = np.column_stack([points.values[:, 2], np.full(len(points), 1.0)])
        times_s = np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9
        spline = fitted(*_ways(views, _times_s(views, self.rig))[1:], spacing_s)
        return SplineProblem(
            spline, times_s, video, points, observations, self.rig, self._belief(), prior, depth_prior, loss=noise.loss
        ), used


def _longest(count: NDArray, least: NDArray, video: NDArray, most: int) -> NDArray[np.int64]:
    """Of the points seen often enough, those seen most often: up to `most` of the video and as many of the pairs."""
    enough = np.flatnonzero(count >= least)
    order = enough[np.argsort(-count[enough], kind="stable")]
    return np.sort(np.concatenate([order[video[order]][:most], order[~video[order]][:most]]))


def _times_s(views: tuple[View, ...], rig: RigModel) -> Array:
    """(E,) of the exposures since the first, by the clock of the pairs."""
    stamped = np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9
    return stamped + np.where([v.video for v in views], rig.clock_offset_s, 0.0)


def _ways(views: tuple[View, ...], times_s: Array) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Which views (E,) have poses of their own, in the order of their times; times, rotations, positions."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.array([views[i].placed for i in order])]
    order = order[np.concatenate([[True], np.diff(times_s[order]) > 1e-6])]
    rotations = np.stack([views[i].world_from_rig.rotation for i in order])
    positions = np.stack([views[i].world_from_rig.translation for i in order])
    return order, times_s[order], rotations, positions
