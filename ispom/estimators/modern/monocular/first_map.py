"""First map: optimises each two-view hypothesis over the frames between, and chooses the one with the lowest cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.keyframe import MAX_SCALE_GROWTH
from ispom.estimators.modern.monocular.localise import MIN_LOCATED
from ispom.estimators.modern.monocular.map import BundleProblem, Map, RelativeFrame, optimise, triangulate
from ispom.estimators.modern.monocular.setup import LOSS, MISTRACKED
from ispom.estimators.modern.monocular.state import MIN_POINTS, MIN_SHARED, NEWEST_FRAMES, Start, held_poses
from ispom.estimators.modern.monocular.window import anchored_prior
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.modern.second_motion import second_motion
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise, normalised_mad
from ispom.solvers.localisation import MIN_INLIER_SHARE, fit_pose
from ispom.solvers.multiview.rotation import rotate
from ispom.solvers.multiview.two_view import hypotheses
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.solvers.window.adjustment import Adjusted
from ispom.solvers.window.prior import Prior
from ispom.types import Decision, Trajectory

MIN_SHARE = 0.3
"""Least share of the points in two views that belong to the static scene."""
MOSTLY_PLANAR = 0.7
"""Share of points that a plane explains, from which the report calls the scene planar; it has no other effect."""
MIN_EXPLAINED = 0.5
"""Least share of the points that the best hypothesis must explain: below it, more parallax should separate the scene
from moving objects."""
OUTLIER = 4.0
"""Residuals beyond this many loss widths are outliers; their cost is constant."""
OUTLIER_COST = 0.5 * float(np.log1p(OUTLIER**2))
NO_RIVAL = 99.0
"""Largest relative cost of a second hypothesis that is reported, also if there is none."""
CLEARLY_BETTER = 1.25
"""Least ratio of the costs of the second-best and the best hypothesis: less is ambiguous, and waits for more
parallax."""
TWO_VIEW = 2.0
"""Inlier limit of the two-view hypotheses, in loss widths: 1.0 px at the default noise."""
ROUGH_INLIER = 8.0
"""Inlier limit, in loss widths, of frames resected from points of two views before their optimisation."""
MIN_SIGNIFICANCE = 3.0
"""Least inverse depth of a point in the map, in its standard deviations: bundle adjustment improves the rest."""
FRAMES_BETWEEN = 4
"""Number of frames optimised between the two views, taken from the newest ones: older ones of a long wait share
less."""
FIRST_PASS, SECOND_PASS = (12, 1e-3), (40, 1e-5)
"""Largest number of iterations, and the relative decrease of the cost that ends them, before and after points are
selected again."""
SAME_SHARE, SAME_RAD = 0.1, 0.02
"""Trials are the same solution if their last poses differ by less than this, as a share of the baseline and in
radians."""


def first_map(
    start: Start, last: TrackedFrame, noise: Noise, impatient: bool
) -> tuple[Map | None, tuple[Decision, ...]]:
    """Returns the best hypothesis, if it is clearly the best over all frames since the reference."""
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, last.ids, assume_unique=True)
    found = hypotheses(reference.at(ids), last.at(ids), TWO_VIEW * noise.width)
    planar = checks.PLANE_SHARE.of(found.planar_share, MOSTLY_PLANAR)
    trials = [_trial(start, last, ids, pose, noise) for pose in found.second_from_first]
    good = sorted((t for t in trials if t is not None), key=lambda t: t.costs.sum())
    if not good:
        return None, (planar, checks.MAPS.of(0, 1))
    model = _report_model(trials[: found.essential], trials[found.essential :])
    clear = _check_ambiguity(good, tried=len(trials))
    explained = good[0].costs < OUTLIER_COST
    most = checks.EXPLAINED_SHARE.of(float(explained.mean()), MIN_EXPLAINED)
    second = second_motion(reference.at(ids), last.at(ids), ~explained, noise.width)
    if not clear.passed and impatient:
        clear = replace(clear, passed=True, consequence="accepted, as more parallax would not decide it")
    if not (clear.passed and most.passed):
        return None, (planar, model, clear, most, second)
    best, unit = _in_old_scale(_choose(trials, good[0]).map, start)
    return _with_other_frames(best, start, noise.width), (planar, model, clear, second, *unit)


def _choose(trials: list[Trial | None], best: Trial) -> Trial:
    """Returns the first trial with the same solution as the best one, if its cost is not clearly higher.

    This is the essential matrix's, if there is one: its points are not selected by a plane.
    """
    alike = (t for t in trials if t is not None and _is_same_solution(best.map, t.map))
    return next((t for t in alike if _relative_cost(t, best) < CLEARLY_BETTER), best)


def _check_ambiguity(good: list[Trial], tried: int) -> Decision:
    """Checks that the best hypothesis beats the second best by CLEARLY_BETTER. A single hypothesis never passes."""
    if tried == 1:
        return checks.AMBIGUITY.of(1.0, CLEARLY_BETTER, "there is no second one")
    others = [t for t in good[1:] if not _is_same_solution(good[0].map, t.map)]
    if not others:
        return checks.AMBIGUITY.of(NO_RIVAL, CLEARLY_BETTER, "all hypotheses give the same map")
    return checks.AMBIGUITY.of(min(NO_RIVAL, *(_relative_cost(t, good[0]) for t in others)), CLEARLY_BETTER)


def _report_model(by_essential: list[Trial | None], by_homography: list[Trial | None]) -> Decision:
    """Reports which of the two models gives the better map; at least one must have a map."""
    general, planar = _best(by_essential), _best(by_homography)
    if planar is None:
        because = "gives no map" if by_homography else "explains too few points to be tried"
        return checks.MODEL.of(NO_RIVAL, 1.0, f"no rival: the homography {because}")
    if general is None:
        return checks.MODEL.of(0.0, 1.0, "no rival: the essential matrix gives no map")
    same = "both lead to the same map" if _is_same_solution(general.map, planar.map) else ""
    return checks.MODEL.of(min(_relative_cost(planar, general), NO_RIVAL), 1.0, same)


def _best(trials: list[Trial | None]) -> Trial | None:
    """Returns the trial with the least cost; None if none has a map."""
    return min((t for t in trials if t is not None), key=lambda t: t.costs.sum(), default=None)


def _in_old_scale(local_map: Map, start: Start) -> tuple[Map, tuple[Decision, ...]]:
    """Scales the map to the one before it, by the median depth ratio of their common points, if they are enough and
    agree; otherwise to the same depth of the scene, in a unit of its own."""
    if start.depth is None:
        return local_map, ()
    _, here, there = np.intersect1d(local_map.points.ids, start.points.ids, return_indices=True)
    back = start.base.inverse()
    before, now = back.apply(start.points.xyz[there])[:, 2], back.apply(local_map.points.xyz[here])[:, 2]
    front = (before > 0) & (now > 0)
    count = int(front.sum())
    tests = [checks.UNIT_POINTS.of(count, MIN_SHARED)]
    ratio, sigma_log = np.log(before[front] / now[front]), 0.0
    if tests[0].passed:
        sigma_log = normalised_mad(ratio) / np.sqrt(count)
        tests.append(checks.UNIT_SPREAD.of(100 * sigma_log, 100 * MAX_SCALE_GROWTH))
    if not tests[-1].passed:
        free = "its unit is a guess, by which the scene has the same depth as before the loss"
        factor = start.depth / local_map.median_depth
        local_map = _scaled(local_map, start, factor if 0 < factor < np.inf else 1.0, 0.0)
        return local_map, (*tests[:-1], replace(tests[-1], consequence=free))
    factor = float(np.exp(np.median(ratio)))
    return _scaled(local_map, start, factor, sigma_log), (*tests, checks.UNIT_FACTOR.of(factor, 0.0))


def _scaled(local_map: Map, start: Start, factor: float, sigma_log: float) -> Map:
    """Scales a new map about its start; `sigma_log` is the standard deviation of ln of its unit."""
    centre = start.base.translation

    def larger(xyz: Array) -> Array:
        return centre + factor * (xyz - centre)

    keys = tuple(
        replace(k, world_from_camera=Pose(p.rotation, larger(p.translation)))
        for k, p in zip(local_map.keys, local_map.poses, strict=True)
    )
    local_map = replace(local_map, keys=keys, points=ScenePoints(local_map.points.ids, larger(local_map.points.xyz)))
    return replace(local_map, prior=_anchored_prior(start, local_map.poses, sigma_log))


@dataclass(frozen=True, eq=False)
class Trial:
    """A hypothesis after its optimisation."""

    costs: Array
    """(N,) cost of each point common to both views: the mean over its observations, or OUTLIER_COST outside of the
    map."""
    map: Map


def _relative_cost(rival: Trial, best: Trial) -> float:
    """Returns the ratio of the costs of points that either trial explains: the others may move."""
    either = np.minimum(rival.costs, best.costs) < OUTLIER_COST
    return float(rival.costs[either].sum() / max(best.costs[either].sum(), 1e-12))


def _anchored_prior(start: Start, poses: tuple[Pose, ...], unit_sigma: float = 0.0) -> Prior:
    return anchored_prior(poses, start.extra_sigma, LOSS**2 * start.covariance, LOSS * unit_sigma)


def _is_same_solution(a: Map, b: Map) -> bool:
    """Checks that two trials converged to the same solution."""
    change = a.poses[-1].inverse() @ b.poses[-1]
    base = np.linalg.norm(a.poses[-1].translation - a.poses[0].translation)
    return bool(np.linalg.norm(change.translation) < SAME_SHARE * base and np.linalg.norm(change.rotvec) < SAME_RAD)


def _trial(
    start: Start, last: TrackedFrame, ids: NDArray[np.int64], second_from_first: Pose, noise: Noise
) -> Trial | None:
    """Optimises one hypothesis, with a few frames between; None if it explains too few points."""
    reference, width = start.frames[0], noise.width
    end = start.base @ second_from_first.inverse()
    pair = (replace(reference, world_from_camera=start.base), replace(last, world_from_camera=end))
    of_tracks = TrackNoise() if start.lost is None else start.lost.noise
    local_map = Map(pair, ScenePoints(), None, width, extra_sigma=start.extra_sigma, noise=of_tracks)
    local_map, enough = _with_points(local_map, ids, noise), max(MIN_POINTS, MIN_SHARE * len(ids))
    if len(local_map.points.ids) < enough:
        return None
    keys = [pair[0]]
    for frame in _evenly_spaced(start.frames[1:-1][2 - NEWEST_FRAMES :], FRAMES_BETWEEN):
        pose = _resect(local_map, frame, keys[-1].world_from_camera or start.base, ROUGH_INLIER * width)
        if pose is not None:
            keys.append(replace(frame, world_from_camera=pose))
    local_map = replace(local_map, keys=(*keys, pair[1]))
    local_map, _, _ = optimise(replace(local_map, prior=_anchored_prior(start, local_map.poses)), width, *FIRST_PASS)
    # Outliers of the first pass may fit now.
    local_map = _with_points(replace(local_map, prior=_anchored_prior(start, local_map.poses)), ids, noise)
    local_map, found, before = optimise(local_map, width, *SECOND_PASS)
    if len(local_map.points.ids) < enough:
        return None
    return Trial(_costs(local_map, found, before, start, last, ids, width), local_map)


def _costs(
    local_map: Map,
    found: Adjusted,
    before: BundleProblem,
    start: Start,
    last: TrackedFrame,
    ids: NDArray[np.int64],
    width: float,
) -> Array:
    """Returns the costs (N,) of Trial; `found` is the optimisation of `before` that gave the map."""
    owners = found.window.owners
    mean = np.bincount(owners, _cost(found.distances, width)) / np.bincount(owners)
    kept = np.isin(before.ids, local_map.points.ids)
    # An untriangulated point may be too distant: then only the rotation moves it.
    turn = local_map.poses[-1].rotation.T @ start.base.rotation
    costs = _cost(np.linalg.norm(rotate(turn, start.frames[0].at(ids)) - last.at(ids), axis=1), width)
    costs[np.searchsorted(ids, before.ids[kept])] = mean[kept]
    return np.minimum(costs, OUTLIER_COST)


def _evenly_spaced(frames: tuple[TrackedFrame, ...], count: int) -> list[TrackedFrame]:
    """Returns up to `count` of the frames, evenly spaced, including the first and the last."""
    if not frames:
        return []
    return [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))]


def _with_points(local_map: Map, ids: NDArray[np.int64], noise: Noise) -> Map:
    """Adds those of the tracks (M,) as points that can be triangulated."""
    found = triangulate(local_map, ids, noise)
    good = (found.depth > 0) & (found.worst < MISTRACKED * noise.width) & (found.significance > MIN_SIGNIFICANCE)
    return replace(local_map, points=ScenePoints(ids[good], found.xyz_in_world[good]))


def _cost(distances: Array, width: float) -> Array:
    return 0.5 * np.log1p((distances / width) ** 2)


def _resect(local_map: Map, frame: TrackedFrame, guess: Pose, threshold: float, least: int = 0) -> Pose | None:
    place = local_map.points.places(frame.ids)
    known = place >= 0
    x = corrected(frame.x[known], local_map.extra)
    found = fit_pose(local_map.points.xyz[place[known]], x, guess.inverse(), threshold / 2, threshold)
    if found is None or found.inliers.mean() < MIN_INLIER_SHARE or found.inliers.sum() < least:
        return None
    return found.camera_from_world.inverse()


def _with_other_frames(local_map: Map, start: Start, width: float) -> Map:
    """Adds all other frames since the reference, and earlier ones that observe enough points, by resection."""
    keys = {k.time_ns: k for k in local_map.keys}
    current, guess, others = local_map.keys[0], start.base, []
    for frame in start.frames:
        if frame.time_ns in keys:
            current = keys[frame.time_ns]
            guess = current.pose
            continue
        pose = _resect(local_map, frame, guess, MISTRACKED * width)
        if pose is not None:
            guess = pose
            others.append(RelativeFrame(frame.time_ns, current.time_ns, current.pose.inverse() @ pose))
    return replace(local_map, relative_frames=(*_earlier_frames(local_map, start, width), *others))


def _earlier_frames(local_map: Map, start: Start, width: float) -> tuple[RelativeFrame, ...]:
    """Returns the frames before the reference, back to the first one that observes too few points for a resection."""
    first, guess, found = local_map.keys[0], start.base, list[RelativeFrame]()
    for frame in reversed(start.earlier):
        turned = guess if frame.world_from_camera is None else frame.world_from_camera
        pose = _resect(local_map, frame, Pose(turned.rotation, guess.translation), MISTRACKED * width, MIN_LOCATED)
        if pose is None:
            break
        guess = pose
        found.append(RelativeFrame(frame.time_ns, first.time_ns, first.pose.inverse() @ pose))
    return tuple(reversed(found))


def poses_outside_first_map(local_map: Map, start: Start) -> tuple[tuple[int, Pose], ...]:
    """Returns the poses of frames outside of the first map. Those between its frames are interpolated; those before it
    keep their orientations, at the position of its first frame, unless the camera was lost in motion."""
    placed = Trajectory.of(local_map.trajectory())
    first_ns, place = placed.times_ns[0], placed.translations[0]
    held = {} if start.moves else dict([*held_poses(start.earlier), *start.passed])
    before = [(t, Pose(pose.rotation, place)) for t, pose in held.items() if t < first_ns]
    between = [t for t, _ in start.passed if t > first_ns]
    return (*before, *interpolate(placed, np.array(between, np.int64), "linear").items())
