"""The window of a rolling shutter: its keyframes' motions during the exposure are unknowns, too.

A fixed map does not determine them: points triangulated with a wrong motion are reproduced by it. Observations of the
same points in other rows do, and so do the neighbouring keyframes. Calibration errors distort images much as a motion
does, so `with_motions` runs bundle adjustment over poses, motions, points and corrections of the pair. The optimisation
that follows fixes the motions; covariances and marginalisation do not: with fixed motions, standard deviations of poses
were six to twenty times too small, and the prior outweighed the observations in the window.

The window's kernels have one pose per keyframe; here each observation has the pose at the time of its row. (With a pose
per band of 2 ms, which the kernels could have, motions did not converge: they were off by 0.2 m/s instead of 0.01.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.pair import Setup
from ispom.estimators.modern.stereo.predict import SHAKE_RAD_S, motion_sigma
from ispom.estimators.modern.stereo.shutter import MotionPrior, pair_reprojected
from ispom.estimators.modern.stereo.state import KeyFrame, StereoMap
from ispom.estimators.modern.stereo.window import packed, split_at_oldest
from ispom.geometry import Array, Pose
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.robust import robust_cost, robust_weights
from ispom.numerics.twist import twist_of
from ispom.solvers.right_camera import BOTH_K1, BOTH_K2, COLUMNS, PAIR
from ispom.solvers.window.adjustment import as_inverse_depths
from ispom.solvers.window.observation import MIN_DEPTH
from ispom.solvers.window.prior import POSE, Prior
from ispom.solvers.window.problem import PoseFamily, Window

MOTION_ITERATIONS, MOTION_TOLERANCE = 8, 1e-3
"""Largest number of steps, and the relative decrease of the cost that ends them: bundle adjustment follows."""
MOTION_UNKNOWNS = 18
"""Number of unknowns of a keyframe: the left twist of its pose (6), and its motion (12)."""
REGULARISATION = 1e-9
"""Information added to each unknown: far points do not determine depth, and a keyframe may have lost all points."""


def with_motions(setup: Setup, world: StereoMap) -> StereoMap:
    """Estimates the keyframes' motions. A map with a global shutter, or one keyframe, is returned unchanged."""
    if len(world.keys) < 2 or not setup.rolls:
        return world
    expected = motion_priors(world.keys, setup.baseline_m)
    return minimise(
        world,
        lambda values: _cost(setup, values, expected),
        lambda values, damping: _stepped(setup, values, expected, damping),
        MOTION_ITERATIONS,
        MOTION_TOLERANCE,
    ).values


def with_rolling_covariance(setup: Setup, world: StereoMap) -> StereoMap:
    """Returns the map with the covariance of its keyframes' poses, whose motions are unknown, too."""
    covariance = _covariance(setup, world)
    return replace(world, covariance=covariance, newest=_newest(setup, world, covariance))


def rolling_with_frame_covariance(setup: Setup, world: StereoMap, key: KeyFrame) -> StereoMap:
    """See `window.with_frame_covariance`."""
    families = setup.families(world)  # not of this frame, which was localised without them
    both = replace(world, keys=(*world.keys, key.only(world.places(key.ids) >= 0)))
    return replace(world, keys=both.keys, newest=_newest(setup, world, _covariance(setup, both, families)))


def rolling_without_oldest(setup: Setup, world: StereoMap) -> StereoMap:
    """Marginalises the oldest keyframe, see `window.without_oldest`.

    Each marginalisation treats the remaining keyframes' motions as new unknowns with their own prior. They are the same
    ones, but the window's prior does not contain motions.
    """
    past, rest = split_at_oldest(world)
    expected = motion_priors(world.keys, setup.baseline_m)
    window, _, _ = packed(setup, world)
    leaving = tuple(family.of_first_pose(window) for family in window.families)
    joint = _Joint.of(setup, replace(world, keys=past), expected, families=leaving)
    hessian, right = joint.without_motions(first_poses=1)
    poses = [k.left_from_world for k in past[1:]]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    return replace(world, keys=rest, prior=Prior(rotations, translations, world.extra, hessian, -right))


def motion_priors(keys: tuple[KeyFrame, ...], baseline_m: float) -> list[MotionPrior]:
    """Returns the motion prior of each keyframe, from the poses of its neighbours."""
    ways = [b.left_from_world @ a.left_from_world.inverse() for a, b in pairwise(keys)]
    seconds = np.array([b.time_ns - a.time_ns for a, b in pairwise(keys)]) * 1e-9
    rates = np.array([twist_of(way) for way in ways]) / seconds[:, None]
    foreseen = np.array([motion_sigma(way, baseline_m) for way in ways]) / seconds[:, None]
    shaken = SHAKE_RAD_S * _shaken(rates, seconds, foreseen.mean(axis=0) / SHAKE_RAD_S)
    sigma = np.concatenate([shaken, SHAKE_RAD_S * shaken])
    # The rate to the neighbour that is nearer in time has the larger weight.
    share = (seconds[:-1] / (seconds[:-1] + seconds[1:]))[:, None]
    between = (1 - share) * rates[:-1] + share * rates[1:]
    change = (rates[1:] - rates[:-1]) / (0.5 * (seconds[:-1] + seconds[1:]))[:, None]
    inner = np.concatenate([between, change], axis=1)
    every = [steady(rates[0]), *inner, steady(rates[-1])]
    return [MotionPrior(motion, sigma) for motion in every]


def _shaken(rates: Array, seconds: Array, usual: Array) -> Array:
    """Returns standard deviations (6,) of poses from a steady motion, from differences of the mean rates (C, 6) over
    times (C,) [s]. The `usual` (6,) counts as one more difference along one axis."""
    before, after = 1 / seconds[:-1], 1 / seconds[1:]
    # Propagates independent, equal deviations of the middle pose and of those at the ends.
    gain = (before + after) ** 2 + before**2 + after**2
    found = np.diff(rates, axis=0) ** 2 / gain[:, None]
    square = [np.append(found[:, part], usual[part][0] ** 2).mean() for part in (slice(0, 3), slice(3, 6))]
    return np.sqrt(np.repeat(square, 3))


def _covariance(setup: Setup, world: StereoMap, families: Families = None) -> Array:
    """Returns the covariance, see `StereoMap.covariance` and `_Joint.of`."""
    expected = motion_priors(world.keys, setup.baseline_m)
    hessian, _ = _Joint.of(setup, world, expected, families=families).without_motions()
    free = np.append(np.ones(len(hessian) - PAIR, bool), setup.extra_sigma > 0)
    inside, found = np.ix_(free, free), np.zeros_like(hessian)
    scale = 1 / np.sqrt(hessian.diagonal()[free])
    found[inside] = scale[:, None] * np.linalg.inv(scale[:, None] * hessian[inside] * scale) * scale
    return found


def _newest(setup: Setup, world: StereoMap, known: Array) -> Array:
    """Returns the covariance (6, 6) of the newest pose from that of the window."""
    last = slice(len(known) - PAIR - POSE, len(known) - PAIR)
    return world.variance_factor(setup.noise) * known[last, last]


def _cost(setup: Setup, world: StereoMap, expected: list[MotionPrior]) -> float:
    """Returns the cost whose normal equations are `_Joint`; the cost of observations beyond the limit is constant."""
    window, _, _ = packed(setup, world)
    cost = robust_cost(np.minimum(window.squared_errors, setup.limit**2), setup.noise.width)
    cost += _MotionFamily(expected, world.variance_factor(setup.noise)).cost(world)
    return cost + sum(term.cost(window) for term in window.terms)


def _stepped(setup: Setup, world: StereoMap, expected: list[MotionPrior], damping: float) -> StereoMap:
    """Takes one damped step; fixed corrections of the pair are not unknowns."""
    joint = _Joint.of(setup, world, expected, damping)
    free = np.append(np.ones(len(joint.right) - PAIR, bool), setup.extra_sigma > 0)
    step, matrix = np.zeros(len(free)), joint.hessian[np.ix_(free, free)]
    step[free] = np.linalg.solve(matrix + damping * np.diag(matrix.diagonal()), joint.right[free])
    moves, extra = np.split(step, [len(step) - PAIR])
    keys = tuple(
        replace(k, left_from_world=Pose.exp(s[:POSE]) @ k.left_from_world, motion=k.motion + s[POSE:])
        for k, s in zip(world.keys, moves.reshape(-1, MOTION_UNKNOWNS), strict=True)
    )
    xyz = world.xyz.copy()
    points = (joint.inverse @ (joint.side - joint.rows @ step)[:, :, None])[:, :, 0]
    xyz[joint.used] += as_inverse_depths(joint.window, points)
    return replace(world, keys=keys, xyz=xyz, extra=world.extra + extra)


@dataclass(frozen=True, eq=False)
class _MotionFamily:
    """The prior of the keyframes' motions as a residual family; residuals are in units of the loss width."""

    expected: list[MotionPrior]
    variance: float
    """Variance of the image points' noise relative to the squared loss width."""

    def cost(self, world: StereoMap) -> float:
        moves = [(prior.motion - k.motion) / prior.sigma for k, prior in zip(world.keys, self.expected, strict=True)]
        return 0.5 * self.variance * float((np.array(moves) ** 2).sum())

    def add(self, world: StereoMap, hessian: Array, right: Array) -> None:
        """Adds the second derivatives and the negative gradient by the keyframes' unknowns."""
        for c, (key, prior) in enumerate(zip(world.keys, self.expected, strict=True)):
            here, information = MOTION_UNKNOWNS * c + np.arange(POSE, MOTION_UNKNOWNS), self.variance * prior.sigma**-2
            hessian[here, here] += information
            right[here] += information * (prior.motion - key.motion)


Families = tuple[PoseFamily, ...] | None


@dataclass(frozen=True, eq=False)
class _Joint:
    """Normal equations of the keyframes (MOTION_UNKNOWNS each) and the pair, without the points (Schur complement).

    Residuals are in units of the loss width. The other fields give the steps of the points.
    """

    hessian: Array
    """(D, D) reduced matrix."""
    right: Array
    """(D,) reduced right side."""
    window: Window
    """The poses, points and observations."""
    used: NDArray[np.int64]
    """(M,) indices of the points in the map."""
    inverse: Array
    """(M, 3, 3) inverses of the points' own blocks."""
    side: Array
    """(M, 3) right side of the points."""
    rows: Array
    """(M, 3, D) blocks between the points and the other unknowns."""

    @staticmethod
    def of(
        setup: Setup, world: StereoMap, expected: list[MotionPrior], damping: float = 0.0, families: Families = None
    ) -> _Joint:
        """Builds the equations with the prior `expected` of each keyframe's motion, from points that at least two
        keyframes observe. `damping` raises the points' diagonal entries by this share; `families` replace those of the
        window."""
        made, used, origin = packed(setup, world)
        made = made if families is None else replace(made, families=families)
        first, points = MOTION_UNKNOWNS * len(world.keys), len(used)
        pair, size = np.arange(first, first + PAIR), first + PAIR
        hessian, right = REGULARISATION * np.eye(size), np.zeros(size)
        own, side, rows = np.zeros((points, 3, 3)), np.zeros((points, 3)), np.zeros((points, 3, size))
        for c, key in enumerate(world.keys):
            of = np.flatnonzero(made.cameras == c)
            near = key.left_from_world.apply(made.points[made.owners[of]])
            late_s = required(key.late_s, "the keyframe has a global shutter")[origin[of]]
            front = near[:, 2] > MIN_DEPTH
            of, near, late_s = of[front], near[front], late_s[front, None, None]
            by_twist, by_point, error = pair_reprojected(near, made.observed.seen[of], setup.baseline_m)
            by_unknown = [by_twist, late_s * by_twist, 0.5 * late_s**2 * by_twist, _by_pair(made, of)]
            squares = (error**2).sum(axis=1)
            root = np.sqrt(robust_weights(squares, setup.noise.width) * (squares < setup.limit**2))[:, None, None]
            root /= setup.noise.width
            jacobian, error = root * np.concatenate(by_unknown, axis=2), root[:, 0] * error
            here, point = np.concatenate([MOTION_UNKNOWNS * c + np.arange(MOTION_UNKNOWNS), pair]), made.owners[of]
            flat, turned = (
                jacobian.reshape(-1, len(here)),
                np.swapaxes(root * by_point @ key.left_from_world.rotation, 1, 2),
            )
            hessian[np.ix_(here, here)] += flat.T @ flat
            right[here] += flat.T @ error.ravel()
            own[point] += turned @ np.swapaxes(turned, 1, 2)
            side[point] += (turned @ error[:, :, None])[:, :, 0]
            rows[point[:, None, None], np.arange(3)[:, None], here] += turned @ jacobian
        _MotionFamily(expected, world.variance_factor(setup.noise)).add(world, hessian, right)
        poses = MOTION_UNKNOWNS * np.arange(len(world.keys))[:, None] + np.arange(POSE)
        here = np.concatenate([poses.ravel(), pair])
        by_terms, by_terms_right = np.zeros((len(here), len(here))), np.zeros(len(here))
        for term in made.terms:
            term.add(made, by_terms, by_terms_right)
        hessian[np.ix_(here, here)] += by_terms
        right[here] += by_terms_right
        inverse = np.linalg.inv(own * (1 + damping * np.eye(3)) + REGULARISATION * np.eye(3))
        carried, flat = (inverse @ rows).reshape(-1, size), rows.reshape(-1, size)
        reduced = hessian - flat.T @ carried
        right -= carried.T @ side.ravel()
        return _Joint((reduced + reduced.T) / 2, right, made, used, inverse, side, rows)

    def without_motions(self, first_poses: int = 0) -> tuple[Array, Array]:
        """Returns the equations (6 C + E, 6 C + E) and (6 C + E,) after elimination of the motions, and of the first
        `first_poses` poses."""
        pose = np.append((np.arange(len(self.right) - PAIR) % MOTION_UNKNOWNS) < POSE, np.ones(PAIR, bool))
        pose[: first_poses * MOTION_UNKNOWNS] = False
        h, g = self.hessian, self.right
        # Motions and poses have different units; scaling to a unit diagonal avoids rounding errors.
        scale = 1 / np.sqrt(h.diagonal())
        scaled = scale[:, None] * h * scale
        gain = np.linalg.solve(scaled[np.ix_(~pose, ~pose)], scaled[np.ix_(~pose, pose)]).T
        rest = scaled[np.ix_(pose, pose)] - gain @ scaled[np.ix_(~pose, pose)]
        back = 1 / scale[pose]
        return back[:, None] * (rest + rest.T) / 2 * back, g[pose] - back * (gain @ (scale * g)[~pose])


def _by_pair(made: Window, of: NDArray[np.int64]) -> Array:
    """Returns the Jacobian (N, 3, PAIR) of x, y and right x of observations (N,) by the corrections of the pair; 0 if
    the right x is unknown."""
    x = made.observed.seen[of, :2]
    out, square = np.zeros((len(of), 3, PAIR)), (x**2).sum(axis=1)[:, None]
    out[:, :2, BOTH_K1], out[:, :2, BOTH_K2] = square * x, square**2 * x
    out[:, 2, :COLUMNS] = made.factors[of]
    return out
