"""The last stereo pairs and all video frames between them, as one problem over what the cameras saw."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation, Slerp

from ispom.geometry import Array, Pose, so3_exp
from ispom.solvers.continuous import (
    LEFT,
    VIDEO,
    Observations,
    Points,
    PosePrior,
    Problem,
    RigModel,
    Solution,
    Spread,
    solve,
)
from ispom.solvers.prior import PAIR
from ispom.solvers.spline import Spline
from ispom.solvers.window import offset_at

MIN_VIEWS = {True: 3, False: 2}
"""Of a point to take part: in the video (where two say nothing that could be wrong) and in stereo pairs."""
HELD = 1e10
"""Information [1/rad^2, 1/m^2] of a pose that others are told relative to."""
NEIGHBOURS = 5
"""Points whose median depth a new point of the video is given."""


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
    rate_rad_s: float = 0.0
    """Turn rate about the left camera's y axis."""
    world_from_rig: Pose = field(default_factory=Pose)
    covariance: Array | None = None
    """(6, 6) of the twist (rho, phi) on the pose's right; None before the first adjustment."""
    best: Pose | None = None
    """The pose as last adjusted with views on both sides of it; at the window's end it has only those after it."""

    def rectified(self, extra: Array) -> Array:
        """(N,) disparities without what is wrong with the pair, `extra` (4,) of window.Window."""
        right = self.seen[:, 0] - self.disparity
        return self.disparity + offset_at(right, extra) + (1 + right**2) * extra[1] * self.rate_rad_s


@dataclass(frozen=True, eq=False)
class Table:
    """The points known by now."""

    ids: NDArray[np.int64]
    """(M,) ascending."""
    points: Points

    @staticmethod
    def empty() -> Table:
        return Table(np.zeros(0, np.int64), Points(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))))

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) index of each id, -1 where unknown."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)

    def select(self, index: NDArray) -> Table:
        p = self.points
        return Table(self.ids[index], Points(p.anchors_r[index], p.anchors_t[index], p.values[index]))

    def with_new(self, ids: NDArray[np.int64], anchor: Pose, values: Array) -> Table:
        """With points that are anchored in a camera's pose."""
        n, p = len(ids), self.points
        all_ids = np.concatenate([self.ids, ids])
        rotations = np.concatenate([p.anchors_r, np.repeat(anchor.rotation[None], n, 0)])
        positions = np.concatenate([p.anchors_t, np.repeat(anchor.translation[None], n, 0)])
        found = Table(all_ids, Points(rotations, positions, np.concatenate([p.values, values])))
        return found.select(np.argsort(all_ids, kind="stable"))


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of what is seen, in normalised units, and the loss beyond them."""

    video: float
    stereo: float
    disparity: float
    loss: float


@dataclass(frozen=True, eq=False)
class Reference:
    """The exposure that what is known of the points, and of later poses, is relative to: its own error is no part."""

    time_ns: int
    world_from_rig: Pose
    ids: NDArray[np.int64]
    """(K,) of the points whose errors are known, ascending."""
    spread: Spread
    newest: Array
    """(6, 6) covariance of the newest pose that was adjusted."""


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
    slid: bool = False
    """Whether views have left it."""
    reference: Reference | None = None
    """Of the last adjustment."""

    @property
    def pairs(self) -> list[int]:
        """Places of the stereo pairs among the views."""
        return [i for i, v in enumerate(self.views) if not v.video]

    def camera_pose(self, view: View) -> Pose:
        """world_from_camera of the video or the left camera."""
        return view.world_from_rig @ (self.rig.rig_from_video if view.video else self.rig.rig_from_left)

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

    def with_view(self, view: View, baseline_m: float) -> JointWindow:
        """With a view whose pose is known roughly; its new points get a depth, from disparity or from neighbours."""
        new = self.table.places(view.ids) < 0
        anchor = self.camera_pose(view)
        depth = view.rectified(self.of_pair)[new] / baseline_m
        unknown = ~(depth > 1e-4)
        if unknown.any():
            depth[unknown] = self._neighbours(anchor, view.seen[new][unknown])
        values = np.column_stack([view.seen[new], depth])
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
        unknowns = solution.unknowns(problem.prior)
        covariances = solution.covariances(unknowns)
        s = solution.sampled
        poses = [Pose(r, p) for r, p in zip(s.rotations, s.positions, strict=True)]
        edge = self.pairs[1]
        views = tuple(
            replace(
                v,
                world_from_rig=poses[i],
                covariance=v.covariance if v.best is not None and i < edge and self.slid else covariances[i],
                best=v.best if v.best is not None and i < edge and self.slid else poses[i],
            )
            for i, v in enumerate(self.views)
        )
        values = self.table.points.values.copy()
        values[used] = solution.problem.points.values
        table = replace(self.table, points=replace(self.table.points, values=values))
        beliefs = (*self.beliefs, solution.believed(unknowns))[-len(self.pairs) :]
        after = replace(self, rig=solution.problem.rig, views=views, table=table, beliefs=beliefs)
        return replace(after, reference=after._seen_from(reference_ns, solution, used)), solution

    def _seen_from(self, time_ns: int, solution: Solution, used: NDArray[np.int64]) -> Reference:
        """The errors of the points that may be seen again, and of the newest pose, relative to a pair's."""
        place = next(
            i for i in reversed(range(len(self.views))) if self.views[i].time_ns == time_ns and not self.views[i].video
        )
        pose = self.views[place].world_from_rig
        unknowns = solution.unknowns(PosePrior(place, pose, np.eye(6) * HELD))
        recent = [next((v.ids for v in reversed(self.views) if v.video == video), used[:0]) for video in (True, False)]
        chosen = np.flatnonzero(np.isin(self.table.ids[used], np.concatenate(recent)))
        newest = solution.covariances(unknowns)[-1]
        return Reference(time_ns, pose, self.table.ids[used[chosen]], solution.spread(chosen, unknowns), newest)

    def shortened(self, pairs: int) -> tuple[JointWindow, tuple[View, ...]]:
        """With this many stereo pairs, and the views that left."""
        places = self.pairs
        if len(places) <= pairs:
            return self, ()
        cut = places[-pairs]
        views = self.views[cut:]
        seen = np.unique(np.concatenate([v.ids for v in views]))
        table = self.table.select(np.isin(self.table.ids, seen))
        return replace(self, views=views, table=table, slid=True), self.views[:cut]

    def limited(self, most: int) -> tuple[JointWindow, tuple[View, ...]]:
        """With at most so many views, and those that left."""
        if len(self.views) <= most:
            return self, ()
        return replace(self, views=self.views[-most:], slid=True), self.views[:-most]

    def _belief(self) -> RigModel:
        """What was known of the rig from observations that are no longer in the window: none counts twice."""
        return self.beliefs[0] if self.slid and len(self.beliefs) >= len(self.pairs) - 1 else self.initial

    def _problem(self, noise: Noise, spacing_s: float, most: int) -> tuple[Problem | None, NDArray[np.int64]]:
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
            [np.concatenate([v.seen for v in views]), np.concatenate([v.rectified(self.of_pair) for v in views])]
        )[index]
        inverse = 1 / np.array([[noise.video] * 2 + [np.inf], [noise.stereo] * 2 + [noise.disparity]])[camera]
        inverse[np.isnan(seen[:, 2]), 2] = 0.0
        observations = Observations(exposure[index], camera, owner[index], np.nan_to_num(seen), inverse)
        points = self.table.select(used).points
        times_s = np.array([v.time_ns - views[0].time_ns for v in views]) * 1e-9
        first_pose = views[0].world_from_rig
        prior = PosePrior(0, first_pose, _information(views[0].covariance, first_pose))
        depth_prior = np.column_stack([points.values[:, 2], np.full(len(points), 1.0)])
        spline = _spline(views, times_s + np.where(video, self.rig.clock_offset_s, 0.0), spacing_s)
        return Problem(
            spline, times_s, video, points, observations, self.rig, self._belief(), prior, depth_prior, loss=noise.loss
        ), used


def _longest(count: NDArray, least: NDArray, video: NDArray, most: int) -> NDArray[np.int64]:
    """Of the points seen often enough, those seen most often: up to `most` of the video and as many of the pairs."""
    enough = np.flatnonzero(count >= least)
    order = enough[np.argsort(-count[enough], kind="stable")]
    return np.sort(np.concatenate([order[video[order]][:most], order[~video[order]][:most]]))


def _information(covariance: Array | None, pose: Pose) -> Array:
    """(6, 6) of the rotation in the rig and the position in the world, of that of a twist (rho, phi)."""
    if covariance is None:
        return np.eye(6) * 1e8
    turn = np.zeros((6, 6))
    turn[:3, 3:], turn[3:, :3] = np.eye(3), pose.rotation
    return np.linalg.inv(turn @ covariance @ turn.T + 1e-12 * np.eye(6))


def _spline(views: tuple[View, ...], times_s: Array, spacing_s: float) -> Spline:
    """Knots on the way through the poses of the views."""
    order = np.argsort(times_s, kind="stable")
    order = order[np.concatenate([[True], np.diff(times_s[order]) > 1e-6])]
    times = times_s[order]
    start = times[0] - 0.25 * spacing_s
    count = int(np.floor((times[-1] - start) / spacing_s)) + 4
    at = np.clip(start + spacing_s * (np.arange(count) - 1), times[0], times[-1])
    rotations = np.stack([views[i].world_from_rig.rotation for i in order])
    positions = np.stack([views[i].world_from_rig.translation for i in order])
    turned = Slerp(times, Rotation.from_matrix(rotations))(at).as_matrix()
    moved = np.column_stack([np.interp(at, times, positions[:, k]) for k in range(3)])
    # A knot's spline passes beside it by a sixth of the bend there.
    steps = Rotation.from_matrix(np.swapaxes(turned[:-1], 1, 2) @ turned[1:]).as_rotvec()
    turned[1:-1] = turned[1:-1] @ so3_exp(-np.diff(steps, axis=0) / 6)
    moved[1:-1] -= np.diff(moved, 2, axis=0) / 6
    return Spline(float(start), spacing_s, np.ascontiguousarray(turned), moved)
