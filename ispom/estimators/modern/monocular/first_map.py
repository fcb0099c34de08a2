"""The first map: each motion that two views allow, adjusted over the frames between; the one that explains most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.key_frame import MAX_DRIFT
from ispom.estimators.modern.monocular.localise import MIN_LOCATED
from ispom.estimators.modern.monocular.map import BundleProblem, Map, RelativeFrame, adjusted, intersected, views
from ispom.estimators.modern.monocular.second_motion import second_motion
from ispom.estimators.modern.monocular.setup import LOSS, MISTRACKED
from ispom.estimators.modern.monocular.start import MIN_POINTS, MIN_SHARED, NEWEST, Start, poses_held
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise, normalised_mad
from ispom.solvers.localisation import MIN_INLIER_SHARE, fit_pose
from ispom.solvers.multiview.rotation import rotate
from ispom.solvers.multiview.two_view import hypotheses
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.solvers.window.adjustment import Adjusted
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich
from ispom.types import Decision, Trajectory

MIN_SHARE = 0.3
"""Of the points in two views, those of the still scene: fewer make no map."""
MOSTLY_PLANAR = 0.7
"""Share of points that a plane explains, from which the report calls the scene planar; it steers nothing."""
MIN_EXPLAINED = 0.5
"""Share of the points that a pose explains: with fewer, more parallax should tell the scene from what moves in it."""
OUTLIER = 4.0
"""A point that is off by so many widths of the loss is none of the scene: its cost grows no more."""
OUTLIER_COST = 0.5 * float(np.log1p(OUTLIER**2))
SPEED_SIGMA = 0.3
"""Deviation of the logarithm of the speed, after a loss over that before it."""
NO_RIVAL = 99.0
"""Relative cost from which on, or without a rival at all, the report says no more than that."""
CLEARLY_BETTER = 1.25
"""Cost of the second best hypothesis over that of the best: less is ambiguous, and waits for more parallax."""
TWO_VIEW = 2.0
"""Inlier limit of the two-view hypotheses, in widths of the loss: 1.0 px at the default noise."""
ROUGH = 8.0
"""Inlier limit, in widths of the loss, of frames resected from points of two views that are not adjusted yet."""
MIN_SIGNIFICANCE = 3.0
"""Inverse depth over its standard deviation from which a point enters the map: bundle adjustment improves the rest."""
BETWEEN = 4
"""Frames between the two views that are adjusted with them, of the newest ones: older ones of a long wait show less."""
FIRST_PASS, SECOND_PASS = (12, 1e-3), (40, 1e-5)
"""Most iterations, and the relative decrease of the cost that ends them, before and after points are chosen anew."""
SAME_SHARE, SAME_RAD = 0.1, 0.02
"""Two trials are one solution where their last poses differ by less, of the baseline and in angle."""


def first_map(
    start: Start, last: TrackedFrame, noise: Noise, impatient: bool
) -> tuple[Map | None, tuple[Decision, ...]]:
    """The best of the hypotheses, if it is clearly the best over all frames since the reference."""
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, last.ids, assume_unique=True)
    found = hypotheses(reference.at(ids), last.at(ids), TWO_VIEW * noise.width)
    planar = checks.PLANE_SHARE.of(found.planar_share, MOSTLY_PLANAR)
    trials = [_trial(start, last, ids, pose, noise) for pose in found.second_from_first]
    good = sorted((t for t in trials if t is not None), key=lambda t: t.costs.sum())
    if not good:
        return None, (planar, checks.MAPS.of(0, 1))
    model = _model(trials[: found.essential], trials[found.essential :])
    clear = _clear(good, tried=len(trials))
    explained = good[0].costs < OUTLIER_COST
    most = checks.EXPLAINED_SHARE.of(float(explained.mean()), MIN_EXPLAINED)
    second = second_motion(reference.at(ids), last.at(ids), ~explained, noise.width)
    if not clear.passed and impatient:
        clear = replace(clear, passed=True, consequence="accepted, as more parallax would not decide it")
    if not (clear.passed and most.passed):
        return None, (planar, model, clear, most, second)
    best, unit = _in_old_unit(_chosen(trials, good[0]).map, start)
    return _filled(best, start, noise.width), (planar, model, clear, second, *unit)


def _chosen(trials: list[Trial | None], best: Trial) -> Trial:
    """Of the trials that are one solution with the best, and not clearly worse, the first.

    That is the essential matrix's, where there is one: it took no plane for granted to choose its points.
    """
    alike = (t for t in trials if t is not None and _same(best.map, t.map))
    return next((t for t in alike if _relative_cost(t, best) < CLEARLY_BETTER), best)


def _clear(good: list[Trial], tried: int) -> Decision:
    """Whether the first one is clearly the best, of so many hypotheses tried; one that has no rival never is."""
    if tried == 1:
        return checks.AMBIGUITY.of(1.0, CLEARLY_BETTER, "there is no second one")
    others = [t for t in good[1:] if not _same(good[0].map, t.map)]
    if not others:
        return checks.AMBIGUITY.of(NO_RIVAL, CLEARLY_BETTER, "all hypotheses give the same map")
    return checks.AMBIGUITY.of(min(NO_RIVAL, *(_relative_cost(t, good[0]) for t in others)), CLEARLY_BETTER)


def _model(by_essential: list[Trial | None], by_homography: list[Trial | None]) -> Decision:
    """Which of the two models gives the better map; one of them does."""
    general, planar = _best(by_essential), _best(by_homography)
    if planar is None:
        because = "gives no map" if by_homography else "explains too few points to be tried"
        return checks.MODEL.of(NO_RIVAL, 1.0, f"no rival: the homography {because}")
    if general is None:
        return checks.MODEL.of(0.0, 1.0, "no rival: the essential matrix gives no map")
    same = "both lead to the same map" if _same(general.map, planar.map) else ""
    return checks.MODEL.of(min(_relative_cost(planar, general), NO_RIVAL), 1.0, same)


def _best(trials: list[Trial | None]) -> Trial | None:
    """That of least cost; None where none has a map."""
    return min((t for t in trials if t is not None), key=lambda t: t.costs.sum(), default=None)


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
        spread = checks.UNIT_SPREAD.of(100 * SPEED_SIGMA, MAX_DRIFT)
        return state, (replace(shared, consequence="the speed before the loss gives the scale instead"), spread)
    ratio = np.log(before[front] / now[front])
    sigma_log = normalised_mad(ratio) / np.sqrt(count)
    factor, centre = float(np.exp(np.median(ratio))), start.base.translation

    def larger(xyz: Array) -> Array:
        return centre + factor * (xyz - centre)

    keys = tuple(
        replace(k, world_from_camera=Pose(p.rotation, larger(p.translation)))
        for k, p in zip(state.keys, state.poses, strict=True)
    )
    state = replace(state, keys=keys, points=ScenePoints(state.points.ids, larger(state.points.xyz)))
    state = replace(state, prior=_anchored(start, state.poses, sigma_log))
    carried = checks.UNIT_FACTOR.of(factor, 0.0), checks.UNIT_SPREAD.of(100 * sigma_log, MAX_DRIFT)
    return state, (shared, *carried)


@dataclass(frozen=True, eq=False)
class Trial:
    """A hypothesis after its adjustment."""

    costs: Array
    """(N,) of each point common to both views: mean of its observations, OUTLIER_COST where it is in no map."""
    map: Map


def _relative_cost(rival: Trial, best: Trial) -> float:
    """Cost over that of the best, of the points that either of them explains: others may move by themselves."""
    either = np.minimum(rival.costs, best.costs) < OUTLIER_COST
    return float(rival.costs[either].sum() / max(best.costs[either].sum(), 1e-12))


def _anchored(start: Start, poses: tuple[Pose, ...], unit_sigma: float) -> Prior:
    return anchored_prior(poses, start.extra_sigma, LOSS**2 * start.covariance, LOSS * unit_sigma)


def _same(a: Map, b: Map) -> bool:
    """Whether two trials converged to one solution."""
    change = a.poses[-1].inverse() @ b.poses[-1]
    base = np.linalg.norm(a.poses[-1].translation - a.poses[0].translation)
    return bool(np.linalg.norm(change.translation) < SAME_SHARE * base and np.linalg.norm(change.rotvec) < SAME_RAD)


def _trial(
    start: Start, last: TrackedFrame, ids: NDArray[np.int64], second_from_first: Pose, noise: Noise
) -> Trial | None:
    """One hypothesis, adjusted over a few frames between as well; None where it explains too few points."""
    reference, width = start.frames[0], noise.width
    seconds = (last.time_ns - reference.time_ns) * 1e-9
    unit = 1.0 if start.speed is None else start.speed * seconds
    end = start.base @ second_from_first.inverse().scaled(unit)
    pair = (replace(reference, world_from_camera=start.base), replace(last, world_from_camera=end))
    of_tracks = TrackNoise() if start.lost is None else start.lost.noise
    state = Map(pair, ScenePoints(), None, width, extra_sigma=start.extra_sigma, noise=of_tracks)
    state, enough = _with_points(state, ids, noise), max(MIN_POINTS, MIN_SHARE * len(ids))
    if len(state.points.ids) < enough:
        return None
    keys = [pair[0]]
    for frame in _spaced(start.frames[1:-1][2 - NEWEST :], BETWEEN):
        pose = _resected(state, frame, keys[-1].world_from_camera or start.base, ROUGH * width)
        if pose is not None:
            keys.append(replace(frame, world_from_camera=pose))
    state = replace(state, keys=(*keys, pair[1]))
    unit_sigma = 0.0 if start.speed is None else SPEED_SIGMA
    state, _, _ = adjusted(replace(state, prior=_anchored(start, state.poses, unit_sigma)), width, *FIRST_PASS)
    # What was off at first may fit by now.
    state = _with_points(replace(state, prior=_anchored(start, state.poses, unit_sigma)), ids, noise)
    state, found, before = adjusted(state, width, *SECOND_PASS)
    if len(state.points.ids) < enough:
        return None
    return Trial(_costs(state, found, before, start, last, ids, width), state)


def _costs(
    state: Map,
    found: Adjusted,
    before: BundleProblem,
    start: Start,
    last: TrackedFrame,
    ids: NDArray[np.int64],
    width: float,
) -> Array:
    """(N,) see Trial; `found` is the adjustment of `before` that gave the map."""
    owners = found.window.owners
    mean = np.bincount(owners, _cost(found.distances, width)) / np.bincount(owners)
    kept = np.isin(before.ids, state.points.ids)
    # A point without a place may be too far for one: then the turn alone moves it.
    turn = state.poses[-1].rotation.T @ start.base.rotation
    costs = _cost(np.linalg.norm(rotate(turn, start.frames[0].at(ids)) - last.at(ids), axis=1), width)
    costs[np.searchsorted(ids, before.ids[kept])] = mean[kept]
    return np.minimum(costs, OUTLIER_COST)


def _spaced(frames: tuple[TrackedFrame, ...], count: int) -> list[TrackedFrame]:
    """At most `count` of them, evenly, the first and the last included."""
    if not frames:
        return []
    return [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))]


def _with_points(state: Map, ids: NDArray[np.int64], noise: Noise) -> Map:
    """With those of the tracks (M,) as points that have a place."""
    found = intersected(state, ids, noise)
    good = (found.depth > 0) & (found.worst < MISTRACKED * noise.width) & (found.significance > MIN_SIGNIFICANCE)
    return replace(state, points=ScenePoints(ids[good], found.xyz_in_world[good]))


def _cost(distances: Array, width: float) -> Array:
    return 0.5 * np.log1p((distances / width) ** 2)


def _resected(state: Map, frame: TrackedFrame, guess: Pose, threshold: float, least: int = 0) -> Pose | None:
    place = state.points.places(frame.ids)
    known = place >= 0
    x = corrected(frame.x[known], state.extra)
    found = fit_pose(state.points.xyz[place[known]], x, guess.inverse(), threshold / 2, threshold)
    if found is None or found.inliers.mean() < MIN_INLIER_SHARE or found.inliers.sum() < least:
        return None
    return found.camera_from_world.inverse()


def _filled(state: Map, start: Start, width: float) -> Map:
    """With all other frames since the reference, and those before it that see enough, by resection from the map."""
    keys = {k.time_ns: k for k in state.keys}
    current, guess, others = state.keys[0], start.base, []
    for frame in start.frames:
        if frame.time_ns in keys:
            current = keys[frame.time_ns]
            guess = current.world_from_camera or guess
            continue
        pose = _resected(state, frame, guess, MISTRACKED * width)
        if pose is not None and current.world_from_camera is not None:
            guess = pose
            others.append(RelativeFrame(frame.time_ns, current.time_ns, current.world_from_camera.inverse() @ pose))
    return replace(state, relative_frames=(*_before(state, start, width), *others))


def _before(state: Map, start: Start, width: float) -> tuple[RelativeFrame, ...]:
    """The frames before the reference, back to the first one that sees too few points of the map for that."""
    first, guess, found = state.keys[0], start.base, list[RelativeFrame]()
    assert first.world_from_camera is not None
    for frame in reversed(start.earlier):
        turned = guess if frame.world_from_camera is None else frame.world_from_camera
        pose = _resected(state, frame, Pose(turned.rotation, guess.translation), MISTRACKED * width, MIN_LOCATED)
        if pose is None:
            break
        guess = pose
        found.append(RelativeFrame(frame.time_ns, first.time_ns, first.world_from_camera.inverse() @ pose))
    return tuple(reversed(found))


def poses_outside_first_map(world: Map, start: Start) -> tuple[tuple[int, Pose], ...]:
    """The poses of frames that the first map does not place: between others by these; before them all turned as they
    were held, where the first one was."""
    placed = Trajectory.of(world.trajectory())
    first_ns, place = placed.times_ns[0], placed.translations[0]
    held = dict([*poses_held(start.earlier), *start.passed])
    before = [(t, Pose(pose.rotation, place)) for t, pose in held.items() if t < first_ns]
    between = [t for t, _ in start.passed if t > first_ns]
    return (*before, *interpolate(placed, np.array(between, np.int64), "linear").items())


def anchored_prior(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, unit_sigma: float) -> Prior:
    """Makes the first pose the world, and its distance to the last the unit; no correction of the camera yet.

    `first` (6, 6) covariance of the first pose, twist on the right of world_from_camera, and `unit_sigma` deviation of
    the logarithm of the unit: zero but for a map that goes on from another one. `extra_sigma` (2,): of the camera's
    correction. All as widened as the loss is.
    """
    rotations, translations = views(poses)
    size = POSE * len(poses) + LENS
    hessian = np.zeros((size, size))
    apart = poses[-1].translation - poses[0].translation
    unit = float(np.linalg.norm(apart))
    # A right twist of world_from_camera is, but for its sign, the left one of its inverse.
    hessian[:POSE, :POSE] = np.linalg.inv(first + 1e-12 * np.diag([unit**2] * 3 + [1.0] * 3))
    # How left twists' rho move the last centre away from the first, which may be anywhere after a loss.
    along, last = np.zeros(size), POSE * (len(poses) - 1)
    along[last : last + 3] = -rotations[-1] @ apart / unit
    if first.any():
        along[:3] = rotations[0] @ apart / unit
    hessian += np.outer(along, along) / (unit**2 * (1e-12 + unit_sigma**2))
    hessian[size - LENS :, size - LENS :] = np.diag(np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0)
    sandwich = Sandwich(hessian, hessian / LOSS**2)
    return Prior(rotations, translations, np.zeros(LENS), hessian, np.zeros(size), sandwich=sandwich)
