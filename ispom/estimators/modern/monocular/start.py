"""The start of a map: wait for parallax, hold the place on pure rotation, then choose among what two views allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import LOSS
from ispom.estimators.modern.monocular.map import Between, Map, adjusted, anchored_prior, intersected
from ispom.estimators.paper.keyframes import Frame, Points
from ispom.geometry import Array, Pose
from ispom.solvers.motion_only import fit_pose
from ispom.solvers.prior import LENS, Prior
from ispom.solvers.rotation import dominant_rotation, median_displacement, rotate
from ispom.solvers.two_view import hypotheses
from ispom.types import Decision

BUFFER = 40
"""Frames remembered while waiting; older ones keep the pose held until then."""
MIN_POINTS = 40
"""Fewer points make no map."""
MIN_SHARE = 0.3
"""Of the points in two views, those of the still scene: fewer make no map."""
PLANAR = 0.2
"""With so many of its points on a plane a view may be taken for another one of it."""
MOST = 0.5
"""Share of the points that a pose explains: with fewer, more parallax should tell the scene from what moves in it."""
LEAVING_SHARE = 0.4
"""When fewer points of the first frame are left, a map is tried with what parallax there is, before all are gone."""
LEAVING_PARALLAX = 0.25
"""Share of the usual parallax that such a map wants."""
OUTLIER = 4.0
"""A point that is off by so many deviations is none of the scene."""
OUTLIER_COST = 0.5 * float(np.log1p(OUTLIER**2))
SPEED_SIGMA = 0.3
"""Deviation of the logarithm of the speed, after a loss over that before it."""
MIN_SHARED = 8
"""Fewer points say nothing sure about a turn, nor, of an old map, about the unit of a new one."""
CLEARLY_BETTER = 1.25
"""Cost of the second best hypothesis over that of the best: less is ambiguous, and waits for more parallax."""


@dataclass(frozen=True, eq=False)
class Start:
    """Frames since the reference, which has the pose `base`."""

    frames: tuple[Frame, ...] = ()
    """The first is the reference. Each with the pose held for it (its own rotation, the place of the reference)."""
    base: Pose = Pose()
    speed: float | None = None
    """Units per second before a loss, taken for those of the new map's first baseline; None: that is 1 long."""
    points: Points = Points()
    """Of the map before a loss: where tracks go on, they carry the unit over."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """How far the camera's calibration may be corrected."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) of the base in the world from before a loss; zero where the base is the world."""
    coasting: Callable[[int], Pose] | None = None
    """The pose that goes on from before a loss, by time, for as long as nothing is seen."""

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Start:
        """Adds tracks first seen in the reference, while that is the only frame."""
        frame = self.frames[0]
        frame = replace(frame, ids=np.concatenate([frame.ids, ids]), x=np.concatenate([frame.x, x]))
        return replace(self, frames=(frame,))


@dataclass(frozen=True, eq=False)
class Begun:
    """What a frame did to the start."""

    start: Start
    decisions: tuple[Decision, ...]
    held: Pose | None
    """The frame's pose as long as there is no map; None where it moves already and the place is unknown."""
    map: Map | None = None
    settled: tuple[tuple[int, Pose], ...] = ()


def advance(start: Start, frame: Frame, sigma: float, min_parallax_rad: float) -> Begun:
    """One more frame. `sigma`: deviation of a coordinate, normalised units."""
    if not start.frames:
        frame = replace(frame, world_from_camera=start.base)
        return Begun(replace(start, frames=(frame,)), (), start.base)
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, frame.ids, assume_unique=True)
    share = len(ids) / max(1, len(reference.ids))
    enough = checks.START_POINTS.of(share, LEAVING_SHARE)
    if len(ids) < MIN_POINTS:
        return _restarted(start, frame, sigma, replace(enough, passed=False))
    x1, x2 = reference.at(ids), frame.at(ids)
    rotation = dominant_rotation(x1, x2, 3 * sigma)
    parallax = float(np.arctan(median_displacement(rotation, x1, x2)))
    needed = min_parallax_rad * (1 if enough.passed else LEAVING_PARALLAX)
    moved = checks.START_PARALLAX.of(np.degrees(parallax), np.degrees(needed), passed=parallax >= needed)
    held = Pose(start.base.rotation @ rotation.T, start.base.translation)
    frame = replace(frame, world_from_camera=held)
    waiting, settled = _remembered(replace(start, frames=(*start.frames, frame)))
    found, decisions = None, ()
    if moved.passed:
        found, decisions = _first_map(waiting, frame, sigma, parallax > 3 * min_parallax_rad)
    if found is None and not enough.passed:
        return _restarted(start, frame, sigma, enough)
    if not moved.passed:
        moved = replace(moved, consequence="place held, waiting for parallax")
        return Begun(waiting, (moved,), held, settled=settled)
    return Begun(waiting, (moved, *decisions), None, found, settled)


def poses_held(frames: tuple[Frame, ...]) -> tuple[tuple[int, Pose], ...]:
    """The poses held for frames in which enough was seen to tell at least how they were turned."""
    return tuple((f.time_ns, f.world_from_camera) for f in frames if f.world_from_camera and len(f.ids) >= MIN_SHARED)


def _remembered(start: Start) -> tuple[Start, tuple[tuple[int, Pose], ...]]:
    """Without the oldest frames after the reference, where there are too many."""
    extra = len(start.frames) - BUFFER
    if extra <= 0:
        return start, ()
    gone = start.frames[1 : 1 + extra]
    done = poses_held(gone)
    return replace(start, frames=(start.frames[0], *start.frames[1 + extra :])), done


def _restarted(start: Start, frame: Frame, sigma: float, why: Decision) -> Begun:
    """Too few of the reference's points are left: this frame becomes the reference, the rotation so far kept."""
    last = start.frames[-1]
    ids = np.intersect1d(last.ids, frame.ids, assume_unique=True)
    base = last.world_from_camera or start.base
    blind = start.coasting is not None and len(start.frames) == 1
    if len(ids) >= MIN_SHARED:
        turn = dominant_rotation(last.at(ids), frame.at(ids), 3 * sigma)
        base = Pose(base.rotation @ turn.T, base.translation)
    elif blind and start.coasting is not None:
        base = start.coasting(frame.time_ns)
    done = poses_held(start.frames)
    new = replace(start, frames=(replace(frame, world_from_camera=base),), base=base)
    return Begun(new, (replace(why, consequence="begins again from here"),), base, settled=done)


def _first_map(start: Start, last: Frame, sigma: float, impatient: bool) -> tuple[Map | None, tuple[Decision, ...]]:
    """The best of the hypotheses, if it is clearly the best over all frames since the reference."""
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, last.ids, assume_unique=True)
    found = hypotheses(reference.at(ids), last.at(ids), 2 * sigma, planar_from=PLANAR)
    planar = checks.PLANE_SHARE.of(found.planar_share, 0.7)
    trials = [_trial(start, last, ids, pose, sigma) for pose in found.second_from_first]
    good = sorted((t for t in trials if t is not None), key=lambda t: t.costs.sum())
    if not good:
        return None, (planar, checks.MAPS.of(0, 1))
    best = good[0].map
    ratio = min((_costlier(t, good[0]) for t in good[1:] if not _same(best, t.map)), default=np.inf)
    clear = checks.AMBIGUITY.of(min(ratio, 99.0), CLEARLY_BETTER)
    share = float((good[0].costs < OUTLIER_COST).mean())
    most = checks.EXPLAINED_SHARE.of(share, MOST)
    if not (clear.passed and most.passed) and not impatient:
        return None, (planar, clear, most)
    best, carried = _in_old_unit(best, start)
    return _filled(best, start, sigma), (planar, clear, *carried)


def _in_old_unit(state: Map, start: Start) -> tuple[Map, tuple[Decision, ...]]:
    """The map in the unit of the one before it, where enough points are in both: median ratio of their depths."""
    _, here, there = np.intersect1d(state.points.ids, start.points.ids, return_indices=True)
    back = start.base.inverse()
    before, now = back.apply(start.points.xyz[there])[:, 2], back.apply(state.points.xyz[here])[:, 2]
    front = (before > 0) & (now > 0)
    if not len(start.points.ids):
        return state, ()
    count = int(front.sum())
    shared = checks.UNIT_POINTS.of(count, MIN_SHARED)
    if not shared.passed:
        return state, (replace(shared, consequence="the speed before the loss is taken instead"),)
    ratio = np.log(before[front] / now[front])
    middle = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - middle))) / np.sqrt(count)
    factor, centre = float(np.exp(middle)), start.base.translation

    def larger(xyz: Array) -> Array:
        return centre + factor * (xyz - centre)

    keys = tuple(
        replace(k, world_from_camera=Pose(p.rotation, larger(p.translation)))
        for k, p in zip(state.keys, state.poses, strict=True)
    )
    state = replace(state, keys=keys, points=Points(state.points.ids, larger(state.points.xyz)))
    state = replace(state, prior=_anchored(start, state.poses, spread))
    return state, (replace(shared, consequence=f"depth ratio {factor:.3f}, known to {spread:.3f}"),)


@dataclass(frozen=True, eq=False)
class Trial:
    """A hypothesis after its adjustment."""

    costs: Array
    """(N,) of each point common to both views: mean of its observations, OUTLIER_COST where it is in no map."""
    map: Map


def _costlier(rival: Trial, best: Trial) -> float:
    """Cost over that of the best, of the points that either of them explains: others may move by themselves."""
    either = np.minimum(rival.costs, best.costs) < OUTLIER_COST
    return float(rival.costs[either].sum() / max(best.costs[either].sum(), 1e-12))


def _anchored(start: Start, poses: tuple[Pose, ...], unit_sigma: float) -> Prior:
    return anchored_prior(poses, start.extra_sigma, LOSS**2 * start.covariance, LOSS * unit_sigma)


def _same(a: Map, b: Map) -> bool:
    """Whether two trials converged to one solution."""
    change = a.poses[-1].inverse() @ b.poses[-1]
    base = np.linalg.norm(a.poses[-1].translation - a.poses[0].translation)
    return bool(np.linalg.norm(change.translation) < 0.1 * base and np.linalg.norm(change.rotvec) < 0.02)


def _trial(start: Start, last: Frame, ids: NDArray[np.int64], second_from_first: Pose, sigma: float) -> Trial | None:
    """One hypothesis, adjusted over a few frames between as well; None where it explains too few points."""
    reference = start.frames[0]
    seconds = (last.time_ns - reference.time_ns) * 1e-9
    unit = 1.0 if start.speed is None else start.speed * seconds
    end = start.base @ second_from_first.inverse().scaled(unit)
    pair = (replace(reference, world_from_camera=start.base), replace(last, world_from_camera=end))
    state = Map(pair, Points(), None, extra_sigma=start.extra_sigma)
    state, enough = _with_points(state, ids, sigma), max(MIN_POINTS, MIN_SHARE * len(ids))
    if len(state.points.ids) < enough:
        return None
    inner = start.frames[1:-1]
    chosen = [inner[i] for i in np.unique(np.linspace(0, len(inner) - 1, 4).round().astype(int))] if inner else []
    keys = [pair[0]]
    for frame in chosen:
        pose = _located(state, frame, keys[-1].world_from_camera or start.base, 8 * sigma)
        if pose is not None:
            keys.append(replace(frame, world_from_camera=pose))
    state = replace(state, keys=(*keys, pair[1]))
    unit_sigma = 0.0 if start.speed is None else SPEED_SIGMA
    state, _, _ = adjusted(replace(state, prior=_anchored(start, state.poses, unit_sigma)), sigma, 12)
    # What was off at first may fit by now.
    state = _with_points(replace(state, prior=_anchored(start, state.poses, unit_sigma)), ids, sigma)
    state, found, before = adjusted(state, sigma, 40, 1e-5)
    if len(state.points.ids) < enough:
        return None
    owners = found.window.owners
    mean = np.bincount(owners, _cost(found.distances, sigma)) / np.bincount(owners)
    kept = np.isin(before.ids, state.points.ids)
    # A point without a place may be too far for one: then the turn alone moves it.
    turn = state.poses[-1].rotation.T @ start.base.rotation
    costs = _cost(np.linalg.norm(rotate(turn, reference.at(ids)) - last.at(ids), axis=1), sigma)
    costs[np.searchsorted(ids, before.ids[kept])] = mean[kept]
    return Trial(np.minimum(costs, OUTLIER_COST), state)


def _with_points(state: Map, ids: NDArray[np.int64], sigma: float) -> Map:
    """With those of the tracks (M,) as points that have a place."""
    found = intersected(state, ids, sigma)
    good = (found.depth > 0) & (found.worst < 6 * sigma) & (found.significance > 2)
    return replace(state, points=Points(ids[good], found.xyz_in_world[good]))


def _cost(distances: Array, sigma: float) -> Array:
    return 0.5 * np.log1p((distances / sigma) ** 2)


def _located(state: Map, frame: Frame, guess: Pose, threshold: float) -> Pose | None:
    place = state.points.places(frame.ids)
    known = place >= 0
    x = corrected(frame.x[known], state.extra)
    found = fit_pose(state.points.xyz[place[known]], x, guess.inverse(), threshold / 2, threshold)
    return None if found is None or found.inliers.mean() < 0.6 else found.camera_from_world.inverse()


def _filled(state: Map, start: Start, sigma: float) -> Map:
    """With all other frames since the reference, by resection from the map."""
    keys = {k.time_ns: k for k in state.keys}
    current, guess, between = state.keys[0], start.base, []
    for frame in start.frames:
        if frame.time_ns in keys:
            current = keys[frame.time_ns]
            guess = current.world_from_camera or guess
            continue
        pose = _located(state, frame, guess, 6 * sigma)
        if pose is not None and current.world_from_camera is not None:
            guess = pose
            between.append(Between(frame.time_ns, current.time_ns, current.world_from_camera.inverse() @ pose))
    return replace(state, between=tuple(between))
