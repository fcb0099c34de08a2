"""First map: optimises each two-view hypothesis over the frames between, and chooses the one with the lowest cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.key_frame import MAX_DRIFT
from ispom.estimators.modern.monocular.localise import MIN_LOCATED
from ispom.estimators.modern.monocular.map import BundleProblem, Map, RelativeFrame, adjusted, intersected, views
from ispom.estimators.modern.monocular.setup import LOSS, MISTRACKED
from ispom.estimators.modern.monocular.start import MIN_POINTS, MIN_SHARED, NEWEST, Start, poses_held
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
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich
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
SPEED_SIGMA = 0.3
"""Standard deviation of ln of the ratio of the speeds after and before tracking was lost."""
NO_RIVAL = 99.0
"""Largest relative cost of a second hypothesis that is reported, also if there is none."""
CLEARLY_BETTER = 1.25
"""Least ratio of the costs of the second-best and the best hypothesis: less is ambiguous, and waits for more
parallax."""
TWO_VIEW = 2.0
"""Inlier limit of the two-view hypotheses, in loss widths: 1.0 px at the default noise."""
ROUGH = 8.0
"""Inlier limit, in loss widths, of frames resected from points of two views before their optimisation."""
MIN_SIGNIFICANCE = 3.0
"""Least inverse depth of a point in the map, in its standard deviations: bundle adjustment improves the rest."""
BETWEEN = 4
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
    """Returns the first trial with the same solution as the best one, if its cost is not clearly higher.

    This is the essential matrix's, if there is one: its points are not selected by a plane.
    """
    alike = (t for t in trials if t is not None and _same(best.map, t.map))
    return next((t for t in alike if _relative_cost(t, best) < CLEARLY_BETTER), best)


def _clear(good: list[Trial], tried: int) -> Decision:
    """Checks that the best hypothesis beats the second best by CLEARLY_BETTER. A single hypothesis never passes."""
    if tried == 1:
        return checks.AMBIGUITY.of(1.0, CLEARLY_BETTER, "there is no second one")
    others = [t for t in good[1:] if not _same(good[0].map, t.map)]
    if not others:
        return checks.AMBIGUITY.of(NO_RIVAL, CLEARLY_BETTER, "all hypotheses give the same map")
    return checks.AMBIGUITY.of(min(NO_RIVAL, *(_relative_cost(t, good[0]) for t in others)), CLEARLY_BETTER)


def _model(by_essential: list[Trial | None], by_homography: list[Trial | None]) -> Decision:
    """Reports which of the two models gives the better map; at least one must have a map."""
    general, planar = _best(by_essential), _best(by_homography)
    if planar is None:
        because = "gives no map" if by_homography else "explains too few points to be tried"
        return checks.MODEL.of(NO_RIVAL, 1.0, f"no rival: the homography {because}")
    if general is None:
        return checks.MODEL.of(0.0, 1.0, "no rival: the essential matrix gives no map")
    same = "both lead to the same map" if _same(general.map, planar.map) else ""
    return checks.MODEL.of(min(_relative_cost(planar, general), NO_RIVAL), 1.0, same)


def _best(trials: list[Trial | None]) -> Trial | None:
    """Returns the trial with the least cost; None if none has a map."""
    return min((t for t in trials if t is not None), key=lambda t: t.costs.sum(), default=None)


def _in_old_unit(state: Map, start: Start) -> tuple[Map, tuple[Decision, ...]]:
    """Scales the map to the one before it, by the median depth ratio of their common points, if they are enough."""
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
    """A hypothesis after its optimisation."""

    costs: Array
    """(N,) cost of each point common to both views: the mean over its observations, or OUTLIER_COST outside of the
    map."""
    map: Map


def _relative_cost(rival: Trial, best: Trial) -> float:
    """Returns the ratio of the costs of points that either trial explains: the others may move."""
    either = np.minimum(rival.costs, best.costs) < OUTLIER_COST
    return float(rival.costs[either].sum() / max(best.costs[either].sum(), 1e-12))


def _anchored(start: Start, poses: tuple[Pose, ...], unit_sigma: float) -> Prior:
    return anchored_prior(poses, start.extra_sigma, LOSS**2 * start.covariance, LOSS * unit_sigma)


def _same(a: Map, b: Map) -> bool:
    """Checks that two trials converged to the same solution."""
    change = a.poses[-1].inverse() @ b.poses[-1]
    base = np.linalg.norm(a.poses[-1].translation - a.poses[0].translation)
    return bool(np.linalg.norm(change.translation) < SAME_SHARE * base and np.linalg.norm(change.rotvec) < SAME_RAD)


def _trial(
    start: Start, last: TrackedFrame, ids: NDArray[np.int64], second_from_first: Pose, noise: Noise
) -> Trial | None:
    """Optimises one hypothesis, with a few frames between; None if it explains too few points."""
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
    # Outliers of the first pass may fit now.
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
    """Returns the costs (N,) of Trial; `found` is the optimisation of `before` that gave the map."""
    owners = found.window.owners
    mean = np.bincount(owners, _cost(found.distances, width)) / np.bincount(owners)
    kept = np.isin(before.ids, state.points.ids)
    # An untriangulated point may be too distant: then only the rotation moves it.
    turn = state.poses[-1].rotation.T @ start.base.rotation
    costs = _cost(np.linalg.norm(rotate(turn, start.frames[0].at(ids)) - last.at(ids), axis=1), width)
    costs[np.searchsorted(ids, before.ids[kept])] = mean[kept]
    return np.minimum(costs, OUTLIER_COST)


def _spaced(frames: tuple[TrackedFrame, ...], count: int) -> list[TrackedFrame]:
    """Returns up to `count` of the frames, evenly spaced, including the first and the last."""
    if not frames:
        return []
    return [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))]


def _with_points(state: Map, ids: NDArray[np.int64], noise: Noise) -> Map:
    """Adds those of the tracks (M,) as points that can be triangulated."""
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
    """Adds all other frames since the reference, and earlier ones that observe enough points, by resection."""
    keys = {k.time_ns: k for k in state.keys}
    current, guess, others = state.keys[0], start.base, []
    for frame in start.frames:
        if frame.time_ns in keys:
            current = keys[frame.time_ns]
            guess = current.pose
            continue
        pose = _resected(state, frame, guess, MISTRACKED * width)
        if pose is not None:
            guess = pose
            others.append(RelativeFrame(frame.time_ns, current.time_ns, current.pose.inverse() @ pose))
    return replace(state, relative_frames=(*_before(state, start, width), *others))


def _before(state: Map, start: Start, width: float) -> tuple[RelativeFrame, ...]:
    """Returns the frames before the reference, back to the first one that observes too few points for a resection."""
    first, guess, found = state.keys[0], start.base, list[RelativeFrame]()
    for frame in reversed(start.earlier):
        turned = guess if frame.world_from_camera is None else frame.world_from_camera
        pose = _resected(state, frame, Pose(turned.rotation, guess.translation), MISTRACKED * width, MIN_LOCATED)
        if pose is None:
            break
        guess = pose
        found.append(RelativeFrame(frame.time_ns, first.time_ns, first.pose.inverse() @ pose))
    return tuple(reversed(found))


def poses_outside_first_map(world: Map, start: Start) -> tuple[tuple[int, Pose], ...]:
    """Returns the poses of frames outside of the first map. Those between its frames are interpolated; those before it
    keep their orientations, at the position of its first frame."""
    placed = Trajectory.of(world.trajectory())
    first_ns, place = placed.times_ns[0], placed.translations[0]
    held = dict([*poses_held(start.earlier), *start.passed])
    before = [(t, Pose(pose.rotation, place)) for t, pose in held.items() if t < first_ns]
    between = [t for t, _ in start.passed if t > first_ns]
    return (*before, *interpolate(placed, np.array(between, np.int64), "linear").items())


def anchored_prior(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, unit_sigma: float) -> Prior:
    """Returns a prior that makes the first pose the world and its distance to the last the unit, without lens
    correction.

    `first` (6, 6) is the covariance of the first pose, right twist of world_from_camera, and `unit_sigma` the standard
    deviation of ln scale: both are zero except for a map that continues another one. `extra_sigma` (2,) is that of the
    lens correction. All are scaled by the loss width over the noise.
    """
    rotations, translations = views(poses)
    size = POSE * len(poses) + LENS
    hessian = np.zeros((size, size))
    apart = poses[-1].translation - poses[0].translation
    unit = float(np.linalg.norm(apart))
    # A right twist of world_from_camera is, except for its sign, the left one of its inverse.
    hessian[:POSE, :POSE] = np.linalg.inv(first + 1e-12 * np.diag([unit**2] * 3 + [1.0] * 3))
    # Derivative of the distance between the last and the first centre; the first pose is uncertain after a loss.
    along, last = np.zeros(size), POSE * (len(poses) - 1)
    along[last : last + 3] = -rotations[-1] @ apart / unit
    if first.any():
        along[:3] = rotations[0] @ apart / unit
    hessian += np.outer(along, along) / (unit**2 * (1e-12 + unit_sigma**2))
    hessian[size - LENS :, size - LENS :] = np.diag(np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0)
    sandwich = Sandwich(hessian, hessian / LOSS**2)
    return Prior(rotations, translations, np.zeros(LENS), hessian, np.zeros(size), sandwich=sandwich)
