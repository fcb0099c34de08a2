"""The window of a rolling shutter, with the uncertainty of the keyframes' motions during the exposure.

The optimisation of the poses fixes these motions, once estimated (`row_motions`). Covariances and marginalisation have
them as unknowns: with fixed motions, standard deviations of poses were six to twenty times too small, and the prior
outweighed the observations in the window.
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
    """Marginalises the oldest keyframe, see `window.without_oldest`.

    Each marginalisation treats the remaining keyframes' motions as new unknowns with their own prior. They are the same
    ones, but the window's prior does not contain motions.
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
    """Returns the covariance, see `StereoMap.covariance`."""
    hessian, _ = Joint.of(setup, world, motion_priors(world.keys, setup.baseline_m)).without_motions()
    free = np.append(np.ones(len(hessian) - PAIR, bool), setup.extra_sigma > 0)
    inside, found = np.ix_(free, free), np.zeros_like(hessian)
    scale = 1 / np.sqrt(hessian.diagonal()[free])
    found[inside] = scale[:, None] * np.linalg.inv(scale[:, None] * hessian[inside] * scale) * scale
    return found


def _newest(setup: Setup, world: StereoMap, known: Array) -> Array:
    """Returns the covariance (6, 6) of the newest pose from that of the window."""
    last = slice(len(known) - PAIR - POSE, len(known) - PAIR)
    return variance_factor(world, setup.noise) * known[last, last]
