"""How the key frames moved while the rows of a rolling shutter were exposed: sought for all of the window together.

Against a map alone it cannot be found: points that a wrong motion put aside are put aside alike the next time. What
tells is that the same points are seen in other rows, and where the key frames before and after are. What is wrong with
the pair bends images much as a motion does, so it is sought as well. Steps of bundle adjustment of poses, motions,
points and pair; the adjustment that follows holds the motions.
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
"""Steps, at most, and the relative decrease of the cost that ends them: bundle adjustment follows."""
MOVES = 18
"""Unknowns of a key frame: the left twist of its pose, and its motion."""
LEAST = 1e-9
"""Added to the information of each unknown: far points say nothing of their depth, and nothing may be left to see of a
key frame's points."""


def with_motions(setup: Setup, world: StereoMap) -> StereoMap:
    """The map with better motions of its key frames. Nothing changes with a global shutter, or a single key frame."""
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
    """That of which `Joint` has the derivatives; observations beyond the limit cost as much as those at it."""
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
    """Places of each key frame's points in the map, -1 where it has none, and how often each of the map's is seen."""
    places = [world.places(k.ids) for k in world.keys]
    every = np.concatenate(places)
    return places, np.bincount(every[every >= 0], minlength=len(world.ids))


def _shift(world: StereoMap, prior: Prior) -> Array:
    """Of poses and pair since the prior's linearisation."""
    poses = [k.left_from_world for k in world.keys]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    return prior.shifted(rotations, translations, world.extra)


@dataclass(frozen=True, eq=False)
class _Observed:
    """What a key frame observed of points that are seen twice."""

    point: NDArray[np.int64]
    """(O,) ascending."""
    by_unknown: Array
    """(O, 3, MOVES + PAIR) how x, y and the right x follow the key frame's unknowns, and the pair's."""
    by_point: Array
    """(O, 3, 3) how they follow the point in the world."""
    error: Array
    """(O, 3) where they were seen, minus where they are."""

    @staticmethod
    def of(
        setup: Setup, world: StereoMap, key: KeyFrame, place: NDArray[np.int64], count: NDArray[np.int64]
    ) -> _Observed:
        """Where its points have places (N,) in the map, whose points are seen (M,) times; without those beyond the
        limit."""
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
    """(N, 3, PAIR) how x, y and the right x follow what is wrong with the pair, where a perfect one would see `exact`
    (N, 3); 0 where the right x is unknown."""
    late = drift(near, key.rate[None], world.extra[LAG], setup.baseline_m)
    out, square = np.zeros((len(exact), 3, PAIR)), (exact[:, :2] ** 2).sum(axis=1)
    out[:, :2, BOTH_K1], out[:, :2, BOTH_K2] = square[:, None] * exact[:, :2], square[:, None] ** 2 * exact[:, :2]
    out[:, 2, :COLUMNS] = by_column(exact[:, [2, 1]], exact[:, 0] - exact[:, 2], late)
    return out


@dataclass(frozen=True, eq=False)
class Joint:
    """Normal equations of key frames (MOVES each) and pair, the points eliminated, by tracks that are off by the loss's
    scale; what gives the points back is beside them."""

    hessian: Array
    """(D, D)."""
    right: Array
    """(D,)."""
    used: NDArray[np.int64]
    """(U,) places of the points in the map."""
    inverse: Array
    """(U, 3, 3) of their own blocks."""
    side: Array
    """(U, 3)."""
    rows: Array
    """(U, 3, D) what they share with the others."""

    @staticmethod
    def of(setup: Setup, world: StereoMap, believed: list[MotionPrior], damping: float = 0.0) -> Joint:
        """`believed` of each key frame; `damping` raises the points' diagonal entries. Of points that one key frame
        sees, nothing."""
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
        """(6 C + E, 6 C + E) and (6 C + E,) of poses and pair, without the motions, and so many of the first poses."""
        pose = np.append((np.arange(len(self.right) - PAIR) % MOVES) < POSE, np.ones(PAIR, bool))
        pose[: first_poses * MOVES] = False
        h, g = self.hessian, self.right
        # Each motion has units of its own, and so have poses: scaled, none loses digits to another.
        scale = 1 / np.sqrt(h.diagonal())
        scaled = scale[:, None] * h * scale
        gain = np.linalg.solve(scaled[np.ix_(~pose, ~pose)], scaled[np.ix_(~pose, pose)]).T
        rest = scaled[np.ix_(pose, pose)] - gain @ scaled[np.ix_(~pose, pose)]
        back = 1 / scale[pose]
        return back[:, None] * (rest + rest.T) / 2 * back, g[pose] - back * (gain @ (scale * g)[~pose])


def _stepped(setup: Setup, world: StereoMap, believed: list[MotionPrior], damping: float) -> StereoMap:
    """One damped step; corrections of the pair that are held are no unknowns of it."""
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
    """Adds what is known of the motions, and what has left the window says of poses and pair."""
    variance = variance_factor(world, setup.noise)  # of the tracks, which count as off by the loss's scale here
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
