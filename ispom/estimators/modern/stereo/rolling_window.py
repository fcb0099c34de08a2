"""The window where a shutter rolls: how key frames moved while rows were exposed is no more known than tracks say it.

To place key frames their motions are held, once found (`row_motions`). How sure the poses are, and what those that
leave say of the others, follows with the motions as unknowns: held, poses were taken to be six to twenty times as sure
as they are, and what had left the window outweighed what was in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.stereo import window
from ispom.estimators.modern.stereo.motion_priors import motion_priors
from ispom.estimators.modern.stereo.row_motions import Joint
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap, parted, variance_factor
from ispom.geometry import Array
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Adjusted
from ispom.solvers.window.prior import POSE, Prior


def adjusted(setup: Setup, world: StereoMap) -> tuple[StereoMap, Adjusted | None]:
    """See `window.adjusted`."""
    args = setup.baseline_m, setup.extra_sigma, setup.noise.width, setup.limit, setup.iterations
    world, result = window.adjusted(world, *args)
    if result is not None and setup.shutter.rolls:
        known = _covariance(setup, world)
        world = replace(world, covariance=known, newest=_newest(setup, world, known))
    return world, result


def with_pair(setup: Setup, world: StereoMap, pair: KeyFrame) -> StereoMap:
    """See `window.with_pair`."""
    if not setup.shutter.rolls:
        return window.with_pair(world, pair, setup.baseline_m, setup.extra_sigma, setup.noise.width)
    both = replace(world, keys=(*world.keys, pair.only(world.places(pair.ids) >= 0)))
    return replace(world, keys=both.keys, newest=_newest(setup, world, _covariance(setup, both)))


def without_oldest(setup: Setup, world: StereoMap) -> StereoMap:
    """See `window.without_oldest`.

    A motion of a key frame that stays is a new unknown, as far as it was foretold, for each that leaves: it is the same
    one, but one prior on it for all would have to be kept.
    """
    if not setup.shutter.rolls:
        return window.without_oldest(world, setup.baseline_m, setup.extra_sigma, setup.noise.width)
    past, rest = parted(world)
    believed = motion_priors(world.keys, setup.baseline_m)
    hessian, right = Joint.of(setup, replace(world, keys=past), believed).without_motions(first_poses=1)
    poses = [k.left_from_world for k in past[1:]]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    return replace(world, keys=rest, prior=Prior(rotations, translations, world.extra, hessian, -right))


def _covariance(setup: Setup, world: StereoMap) -> Array:
    """See `StereoMap.covariance`."""
    hessian, _ = Joint.of(setup, world, motion_priors(world.keys, setup.baseline_m)).without_motions()
    free = np.append(np.ones(len(hessian) - PAIR, bool), setup.extra_sigma > 0)
    inside, found = np.ix_(free, free), np.zeros_like(hessian)
    scale = 1 / np.sqrt(hessian.diagonal()[free])
    found[inside] = scale[:, None] * np.linalg.inv(scale[:, None] * hessian[inside] * scale) * scale
    return found


def _newest(setup: Setup, world: StereoMap, known: Array) -> Array:
    """(6, 6) of the last pose in it."""
    last = slice(len(known) - PAIR - POSE, len(known) - PAIR)
    return variance_factor(world, setup.noise) * known[last, last]
