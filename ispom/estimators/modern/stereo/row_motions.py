"""Estimates the keyframes' motions during the exposure of a rolling shutter, for the whole window together.

A fixed map does not determine them: points triangulated with a wrong motion are reproduced by it. Observations of the
same points in other rows do, and so do the neighbouring keyframes. Calibration errors distort images much as a motion
does, so they are estimated as well. Runs bundle adjustment over poses, motions, points and corrections of the pair; the
optimisation that follows fixes the motions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.motion_priors import motion_priors
from ispom.estimators.modern.stereo.pair_calibration import ideal
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import MotionPrior, pair_reprojected
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap, variance_factor
from ispom.geometry import Array, Pose
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.robust import cauchy_cost, cauchy_weights
from ispom.solvers.right_camera import BOTH_K1, BOTH_K2, COLUMNS, LAG, PAIR, by_column, drift
from ispom.solvers.window.observation import MIN_DEPTH
from ispom.solvers.window.prior import POSE, Prior

ITERATIONS, TOLERANCE = 8, 1e-3
"""Largest number of steps, and the relative decrease of the cost that ends them: bundle adjustment follows."""
MOVES = 18
"""Number of unknowns of a keyframe: the left twist of its pose (6), and its motion (12)."""
LEAST = 1e-9
"""Information added to each unknown: far points do not determine depth, and a keyframe may have lost all points."""


def with_motions(setup: Setup, world: StereoMap) -> StereoMap:
    """Estimates the keyframes' motions. A map with a global shutter, or one keyframe, is returned unchanged."""
    if len(world.keys) < 2 or not setup.shutter.rolls:
        return world
    believed = motion_priors(world.keys, setup.baseline_m)
    return minimise(
        world,
        lambda values: _cost(setup, values, believed),
        lambda values, damping: _stepped(setup, values, believed, damping),
        ITERATIONS,
        TOLERANCE,
    ).values


def _cost(setup: Setup, world: StereoMap, believed: list[MotionPrior]) -> float:
    """Returns the cost whose normal equations are `Joint`; the cost of observations beyond the limit is constant."""
    places, count = _places(world)
    total, variance = 0.0, variance_factor(world, setup.noise)
    for key, place, known in zip(world.keys, places, believed, strict=True):
        seen = np.flatnonzero((place >= 0) & (count[place] >= 2))
        near = key.left_from_world.apply(world.xyz[place[seen]])
        exact = ideal(world, setup.baseline_m, near, key.at_middle(setup.baseline_m)[seen], key.rate)
        squares = np.full(len(seen), setup.limit**2)
        front = near[:, 2] > MIN_DEPTH
        error = pair_reprojected(near[front], exact[front], setup.baseline_m)[2]
        squares[front] = np.minimum((error**2).sum(axis=1), setup.limit**2)
        total += cauchy_cost(squares, setup.noise.width)
        total += 0.5 * variance * float((((known.motion - key.motion) / known.sigma) ** 2).sum())
    return total if world.prior is None else total + world.prior.cost(_shift(world, world.prior))


def _places(world: StereoMap) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
    """Returns map indices of each keyframe's points, -1 if absent, and the number of observations of each map point."""
    places = [world.places(k.ids) for k in world.keys]
    every = np.concatenate(places)
    return places, np.bincount(every[every >= 0], minlength=len(world.ids))


def _shift(world: StereoMap, prior: Prior) -> Array:
    """Returns the change of poses and corrections since the prior's linearisation."""
    poses = [k.left_from_world for k in world.keys]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    return prior.shifted(rotations, translations, world.extra)


@dataclass(frozen=True, eq=False)
class _Observed:
    """A keyframe's observations of points that at least two keyframes observe."""

    point: NDArray[np.int64]
    """(O,) indices in the map, ascending."""
    by_unknown: Array
    """(O, 3, MOVES + PAIR) Jacobian of x, y and right x by the keyframe's unknowns, and the pair's."""
    by_point: Array
    """(O, 3, 3) Jacobian by the point in the world."""
    error: Array
    """(O, 3) residuals, observed minus projected."""

    @staticmethod
    def of(
        setup: Setup, world: StereoMap, key: KeyFrame, place: NDArray[np.int64], count: NDArray[np.int64]
    ) -> _Observed:
        """Returns the inliers; `place` (N,) and `count` (M,) are as of `_places`."""
        near = key.left_from_world.apply(world.xyz[place])
        good = np.flatnonzero((place >= 0) & (count[place] >= 2) & (near[:, 2] > MIN_DEPTH))
        middle, near = key.at_middle(setup.baseline_m)[good], near[good]
        exact = ideal(world, setup.baseline_m, near, middle, key.rate)
        by_twist, by_point, error = pair_reprojected(near, exact, setup.baseline_m)
        by_motion = key.shutter.by_motion(by_twist, key.seen[good, 1])
        by_unknown = np.concatenate([by_twist, by_motion, _by_pair(setup, world, key, near, exact)], axis=2)
        inside = (error**2).sum(axis=1) < setup.limit**2
        in_world = by_point[inside] @ key.left_from_world.rotation
        return _Observed(place[good][inside], by_unknown[inside], in_world, error[inside])


def _by_pair(setup: Setup, world: StereoMap, key: KeyFrame, near: Array, exact: Array) -> Array:
    """Returns the Jacobian (N, 3, PAIR) of x, y and right x by the corrections of the pair, at observations `exact`
    (N, 3) without calibration errors; 0 if the right x is unknown."""
    late = drift(near, key.rate[None], world.extra[LAG], setup.baseline_m)
    out, square = np.zeros((len(exact), 3, PAIR)), (exact[:, :2] ** 2).sum(axis=1)
    out[:, :2, BOTH_K1], out[:, :2, BOTH_K2] = square[:, None] * exact[:, :2], square[:, None] ** 2 * exact[:, :2]
    out[:, 2, :COLUMNS] = by_column(exact[:, [2, 1]], exact[:, 0] - exact[:, 2], late)
    return out


@dataclass(frozen=True, eq=False)
class Joint:
    """Normal equations of the keyframes (MOVES each) and the pair: the Schur complement over the points.

    Residuals are in units of the loss width. The other fields give the steps of the points.
    """

    hessian: Array
    """(D, D) reduced matrix."""
    right: Array
    """(D,) reduced right side."""
    used: NDArray[np.int64]
    """(U,) indices of the points in the map."""
    inverse: Array
    """(U, 3, 3) inverses of the points' own blocks."""
    side: Array
    """(U, 3) right side of the points."""
    rows: Array
    """(U, 3, D) blocks between the points and the other unknowns."""

    @staticmethod
    def of(setup: Setup, world: StereoMap, believed: list[MotionPrior], damping: float = 0.0) -> Joint:
        """Builds the equations with the prior `believed` of each keyframe's motion, from points that at least two
        keyframes observe. `damping` raises the points' diagonal entries by this share."""
        places, count = _places(world)
        observed = [_Observed.of(setup, world, *each, count) for each in zip(world.keys, places, strict=True)]
        used = np.unique(np.concatenate([seen.point for seen in observed]))
        first = len(observed) * MOVES
        pair = np.arange(first, first + PAIR)
        hessian, right = LEAST * np.eye(first + PAIR), np.zeros(first + PAIR)
        own, side, rows = np.zeros((len(used), 3, 3)), np.zeros((len(used), 3)), np.zeros((len(used), 3, first + PAIR))
        for c, seen in enumerate(observed):
            here, point = np.concatenate([MOVES * c + np.arange(MOVES), pair]), np.searchsorted(used, seen.point)
            weight = cauchy_weights((seen.error**2).sum(axis=1), setup.noise.width)
            root = np.sqrt(weight)[:, None, None] / setup.noise.width
            by_unknown, by_point, error = root * seen.by_unknown, root * seen.by_point, root[:, 0] * seen.error
            flat, turned = by_unknown.reshape(-1, len(here)), by_point.transpose(0, 2, 1)
            hessian[np.ix_(here, here)] += flat.T @ flat
            right[here] += flat.T @ error.ravel()
            own[point] += turned @ by_point
            side[point] += (turned @ error[:, :, None])[:, :, 0]
            shared = turned @ by_unknown
            rows[point, :, MOVES * c : MOVES * (c + 1)] = shared[:, :, :MOVES]
            rows[point, :, first:] += shared[:, :, MOVES:]
        _add_known(setup, world, believed, hessian, right)
        inverse = np.linalg.inv(own * (1 + damping * np.eye(3)) + LEAST * np.eye(3))
        carried, flat = (inverse @ rows).reshape(-1, len(right)), rows.reshape(-1, len(right))
        reduced = hessian - flat.T @ carried
        return Joint((reduced + reduced.T) / 2, right - carried.T @ side.ravel(), used, inverse, side, rows)

    def without_motions(self, first_poses: int = 0) -> tuple[Array, Array]:
        """Returns the equations (6 C + E, 6 C + E) and (6 C + E,) after elimination of the motions, and of the first
        `first_poses` poses."""
        pose = np.append((np.arange(len(self.right) - PAIR) % MOVES) < POSE, np.ones(PAIR, bool))
        pose[: first_poses * MOVES] = False
        h, g = self.hessian, self.right
        # Motions and poses have different units; scaling to a unit diagonal avoids rounding errors.
        scale = 1 / np.sqrt(h.diagonal())
        scaled = scale[:, None] * h * scale
        gain = np.linalg.solve(scaled[np.ix_(~pose, ~pose)], scaled[np.ix_(~pose, pose)]).T
        rest = scaled[np.ix_(pose, pose)] - gain @ scaled[np.ix_(~pose, pose)]
        back = 1 / scale[pose]
        return back[:, None] * (rest + rest.T) / 2 * back, g[pose] - back * (gain @ (scale * g)[~pose])


def _stepped(setup: Setup, world: StereoMap, believed: list[MotionPrior], damping: float) -> StereoMap:
    """Takes one damped step; fixed corrections of the pair are not unknowns."""
    joint = Joint.of(setup, world, believed, damping)
    free = np.append(np.ones(len(joint.right) - PAIR, bool), setup.extra_sigma > 0)
    step, matrix = np.zeros(len(free)), joint.hessian[np.ix_(free, free)]
    step[free] = np.linalg.solve(matrix + damping * np.diag(matrix.diagonal()), joint.right[free])
    xyz = world.xyz.copy()
    xyz[joint.used] += (joint.inverse @ (joint.side - joint.rows @ step)[:, :, None])[:, :, 0]
    keys = tuple(
        replace(k, left_from_world=Pose.exp(s[:POSE]) @ k.left_from_world, motion=k.motion + s[POSE:])
        for k, s in zip(world.keys, step[:-PAIR].reshape(-1, MOVES), strict=True)
    )
    return replace(world, keys=keys, xyz=xyz, extra=world.extra + step[-PAIR:])


def _add_known(setup: Setup, world: StereoMap, believed: list[MotionPrior], hessian: Array, right: Array) -> None:
    """Adds the priors of the motions, and the window's prior on poses and pair."""
    variance = variance_factor(world, setup.noise)  # residuals are in units of the loss width
    for c, (key, known) in enumerate(zip(world.keys, believed, strict=True)):
        here, information = MOVES * c + np.arange(POSE, MOVES), variance * known.sigma**-2
        hessian[here, here] += information
        right[here] += information * (known.motion - key.motion)
    prior = world.prior
    if prior is None:
        return
    first = len(right) - PAIR
    of_poses = (MOVES * np.arange(len(prior.rotations))[:, None] + np.arange(POSE)).ravel()
    here = np.concatenate([of_poses, np.arange(first, first + PAIR)])
    hessian[np.ix_(here, here)] += prior.hessian
    right[here] -= prior.gradient + prior.hessian @ _shift(world, prior)
