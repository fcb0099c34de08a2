"""How the key frames moved while the rows of a rolling shutter were exposed: sought for all of the window together.

Against a map alone it cannot be found: points that a wrong motion put aside are put aside alike the next time. What
tells is that the same points are seen in other rows, and where the key frames before and after are. One step of bundle
adjustment of poses, motions and points; the adjustment that follows holds the motions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.last_pair import unforeseen
from ispom.estimators.modern.stereo.shutter import pair_reprojected
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap
from ispom.geometry import Array, Pose

STEPS = 3
MOVES = 12
"""Unknowns of a key frame: the left twists of its pose and of its motion."""
HELD = 1e12
"""Information of the first pose [1/m^2, 1/rad^2]."""
LEAST = 1e-9
"""Added to the information of a point [1/m^2]: far ones say nothing of their depth."""


def with_rates(world: StereoMap, baseline_m: float, sigma: float, limit: float) -> StereoMap:
    """The map with better motions of its key frames; observations of deviation `sigma`, those beyond `limit` left out.

    Both normalised. Nothing changes with a global shutter, or a single key frame.
    """
    if len(world.keys) < 2 or not world.keys[-1].shutter.rolls:
        return world
    believed = [_believed(world.keys, c, baseline_m) for c in range(len(world.keys))]
    for _ in range(STEPS):
        world = _stepped(world, believed, baseline_m, sigma, limit)
    return world


def _believed(keys: tuple[KeyFrame, ...], c: int, baseline_m: float) -> tuple[Array, Array]:
    """(6,) the change of left_from_world at a key frame by where those beside it are, and (6,) its deviations."""
    rates, sigmas, seconds = [], [], []
    for a, b in ((c - 1, c), (c, c + 1)):
        if a >= 0 and b < len(keys):
            way = keys[b].left_from_world @ keys[a].left_from_world.inverse()
            seconds.append((keys[b].time_ns - keys[a].time_ns) * 1e-9)
            rates.append(way.log() / seconds[-1])
            sigmas.append(unforeseen(way, baseline_m) / seconds[-1])
    # The nearer in time a neighbour is, the more it says of the motion here.
    share = np.array(seconds[::-1]) / sum(seconds)
    return share @ np.array(rates), share @ np.array(sigmas) / np.sqrt(len(rates))


def _stepped(
    world: StereoMap, believed: list[tuple[Array, Array]], baseline_m: float, sigma: float, limit: float
) -> StereoMap:
    point, camera, jacobian, by_point, error = _observed(world, baseline_m, limit)
    used, point = np.unique(point, return_inverse=True)
    cameras, count = len(world.keys), len(used)
    weight = 1 / (sigma**2 + (error**2).sum(axis=1))
    weighted = jacobian * weight[:, None, None]
    # Points: own blocks and sides; and what each shares with the key frames, as rows of one matrix.
    own, side = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(own, point, np.einsum("oki,okj,o->oij", by_point, by_point, weight))
    np.add.at(side, point, np.einsum("oki,ok,o->oi", by_point, error, weight))
    mixed = np.zeros((count, cameras, 3, MOVES))
    np.add.at(mixed, (point, camera), np.einsum("oki,okj->oij", by_point, weighted))
    hessian, right = np.zeros((cameras, MOVES, cameras, MOVES)), np.zeros((cameras, MOVES))
    blocks = np.zeros((cameras, MOVES, MOVES))
    np.add.at(blocks, camera, np.einsum("oki,okj->oij", weighted, jacobian))
    np.add.at(right, camera, np.einsum("oki,ok->oi", weighted, error))
    for c, (key, (rate, spread)) in enumerate(zip(world.keys, believed, strict=True)):
        blocks[c, 6:, 6:] += np.diag(spread**-2.0)
        right[c, 6:] += (rate - key.rate) / spread**2
        hessian[c, :, c] = blocks[c]
    hessian[0, range(6), 0, range(6)] += HELD
    n, rows = cameras * MOVES, mixed.transpose(0, 2, 1, 3).reshape(count, 3, -1)
    inverse = np.linalg.inv(own + LEAST * np.eye(3))
    carried = (inverse @ rows).reshape(-1, n)
    flat = rows.reshape(-1, n)
    step = np.linalg.solve(hessian.reshape(n, n) - flat.T @ carried, right.ravel() - carried.T @ side.ravel())
    moved = np.einsum("mij,mj->mi", inverse, side - rows @ step)
    xyz = world.xyz.copy()
    xyz[used] += moved
    keys = tuple(
        replace(k, left_from_world=Pose.exp(s[:6]) @ k.left_from_world, rate=k.rate + s[6:])
        for k, s in zip(world.keys, step.reshape(cameras, MOVES), strict=True)
    )
    return replace(world, keys=keys, xyz=xyz)


def _observed(
    world: StereoMap, baseline_m: float, limit: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array, Array]:
    """Of the observations of points seen twice: point, key frame, how x, y and the right x follow its unknowns
    (O, 3, 12) and the point in the world (O, 3, 3), and where they were seen minus where they are (O, 3)."""
    places = [world.places(k.ids) for k in world.keys]
    every = np.concatenate(places)
    count = np.bincount(every[every >= 0], minlength=len(world.ids))
    found = []
    for c, (key, place) in enumerate(zip(world.keys, places, strict=True)):
        near = key.left_from_world.apply(world.xyz[place])
        good = np.flatnonzero((place >= 0) & (count[place] >= 2) & (near[:, 2] > 1e-6))
        by_twist, by_point, error = pair_reprojected(near[good], key.at_middle(baseline_m)[good], baseline_m)
        inside = (error**2).sum(axis=1) < limit**2
        good, by_twist, by_point, error = good[inside], by_twist[inside], by_point[inside], error[inside]
        by_rate = by_twist * key.shutter.late_s(key.seen[good, 1])[:, None, None]
        jacobian = np.concatenate([by_twist, by_rate], axis=2)
        in_world = by_point @ key.left_from_world.rotation
        found.append((place[good], np.full(len(good), c), jacobian, in_world, error))
    point, camera, jacobian, in_world, error = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return point, camera, jacobian, in_world, error
