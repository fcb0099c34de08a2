"""Shortens the monocular window: marginalises the oldest keyframe into a prior, or drops the most redundant one. Makes
the priors of windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.map import (
    Map,
    RelativeFrame,
    bundle_problem,
    camera_poses,
)
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.geometry import Array, Pose
from ispom.solvers.window.adjustment import Window, marginalise
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich
from ispom.types import Decision

DYING_SHARE = 0.3
"""Share of its points still tracked, below which the oldest keyframe is marginalised: it adds no new constraints."""
MAX_RELATIVE_FRAMES = 100
"""Largest number of frames between keyframes whose poses still move with their keyframe, once a keyframe is taken;
older ones are final. Without a new keyframe, as at rest, they may become twice as many."""
NEWEST_KEYFRAMES = 3
"""Number of the newest keyframes that always stay: they constrain the motion and the youngest points."""
FIXED_SHARE = 1e-3
"""Standard deviation of the first keyframe's pose where it is the world, relative to a track's noise: small, but large
enough for the numerics."""


def shorten_window(local_map: Map, alive: NDArray[np.int64], count: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Keeps at most `count` keyframes; returns the map and the poses that are final.

    The oldest keyframe is marginalised if hardly any of its points is still tracked; otherwise the most redundant one
    is removed (Engel et al. 2018, section 3.1): a map stays while it is visible.
    """
    settled: list[tuple[int, Pose]] = []
    while len(local_map.keys) > count:
        share = np.isin(local_map.keys[0].ids, alive, assume_unique=True).mean() if len(local_map.keys[0].ids) else 0.0
        j = 0 if share < DYING_SHARE else _redundant(local_map)
        if j == 0:
            prior, used = _oldest_into_prior(local_map, alive)
            local_map = replace(local_map.without(used), prior=prior)
        else:
            local_map = replace(local_map, prior=_prior_without(local_map, j))
        local_map, done = _without_key(local_map, j)
        settled += done
    local_map, done = settle_old_frames(local_map, MAX_RELATIVE_FRAMES)
    settled += done
    seen = np.unique(np.concatenate([k.ids for k in local_map.keys]))
    return replace(local_map, points=local_map.points.only(seen)), settled


def newest_keyframes(local_map: Map, count: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Keeps the newest keyframes, whose first is the world and whose distance is the unit from now on, and the points
    that they observe; returns the map and the poses that are final."""
    settled: list[tuple[int, Pose]] = []
    while len(local_map.keys) > count:
        local_map, done = _without_key(local_map, 0)
        settled += done
    seen = np.unique(np.concatenate([k.ids for k in local_map.keys]))
    prior = anchored_prior(local_map.poses, local_map.extra_sigma, np.zeros((POSE, POSE)), 0.0)
    return replace(local_map, points=local_map.points.only(seen), prior=prior), settled


def report_removed(before: Map, after: Map, count: int) -> Decision:
    """Reports whether a keyframe left the window of at most `count`, and how; from the maps before and after
    `shortened`."""
    then, gone = "", len(before.points.ids) - len(after.points.ids)
    if after.keys[0].time_ns != before.keys[0].time_ns:
        then = f"the oldest was marginalised, and {gone} points left the map"
    elif len(after.keys) < len(before.keys):
        then = "the most redundant one became an ordinary frame"
    return checks.WINDOW.of(len(before.keys), count, then)


def _redundant(local_map: Map) -> int:
    """Returns the index of the keyframe nearest to the others and farthest from the newest."""
    centres = np.array([p.translation for p in local_map.poses])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    typical = np.median(distance[distance > 0]) if (distance > 0).any() else 1.0
    inner = range(1, len(centres) - NEWEST_KEYFRAMES)
    score = [
        np.sqrt(distance[i, -1]) * sum(1 / (1e-3 * typical + distance[i, k]) for k in inner if k != i) for i in inner
    ]
    return 1 + int(np.argmax(score))


def _oldest_into_prior(local_map: Map, alive: NDArray[np.int64]) -> tuple[Prior, NDArray[np.int64]]:
    """Marginalises the oldest keyframe and those of its points that are no longer tracked; also returns their ids."""
    found = bundle_problem(local_map)
    by_oldest = np.zeros(len(found.ids), bool)
    by_oldest[found.window.owners[found.window.cameras == 0]] = True
    dead = by_oldest & ~np.isin(found.ids, alive)

    inverse, none = WindowCovariance.of(found.window, found.ids, local_map.loss).inverse, np.zeros(0, np.int64)

    def of_part(part: Window) -> Sandwich:
        return WindowCovariance.of(part, found.ids[dead], local_map.loss).marginal(none, inverse)

    prior = marginalise(found.window, dead, local_map.loss, of_part)
    return prior, found.ids[dead]


def _prior_without(local_map: Map, j: int) -> Prior | None:
    """Eliminates pose j from the prior; its observations are discarded, as the other keyframes are redundant with
    them."""
    prior = local_map.prior
    if prior is None or j >= len(prior.rotations):
        return prior
    gone = np.zeros(len(prior.gradient), bool)
    gone[POSE * j : POSE * (j + 1)] = True
    h, g = prior.hessian, prior.gradient
    gain = h[np.ix_(~gone, gone)] @ np.linalg.pinv(h[np.ix_(gone, gone)], rcond=1e-12, hermitian=True)
    rest = h[np.ix_(~gone, ~gone)] - gain @ h[np.ix_(gone, ~gone)]
    return replace(
        prior,
        rotations=np.delete(prior.rotations, j, axis=0),
        translations=np.delete(prior.translations, j, axis=0),
        hessian=(rest + rest.T) / 2,
        gradient=g[~gone] - gain @ g[gone],
        sandwich=None if prior.sandwich is None else prior.sandwich.without(gain, gone),
    )


def _without_key(local_map: Map, j: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Makes keyframe j an ordinary frame, relative to the keyframe before it; the first keyframe becomes final."""
    key, pose = local_map.keys[j], local_map.poses[j]
    mine = [b for b in local_map.relative_frames if b.key_ns == key.time_ns]
    others = tuple(b for b in local_map.relative_frames if b.key_ns != key.time_ns)
    keys = local_map.keys[:j] + local_map.keys[j + 1 :]
    if j == 0:
        done = [(key.time_ns, pose), *((b.time_ns, pose @ b.key_from_camera) for b in mine)]
        return replace(local_map, keys=keys, relative_frames=others), done
    before, before_ns = local_map.poses[j - 1].inverse() @ pose, local_map.keys[j - 1].time_ns
    moved = (RelativeFrame(b.time_ns, before_ns, before @ b.key_from_camera) for b in mine)
    own = RelativeFrame(key.time_ns, before_ns, before)
    return replace(local_map, keys=keys, relative_frames=(*others, own, *moved)), []


def settle_old_frames(local_map: Map, most: int = 2 * MAX_RELATIVE_FRAMES) -> tuple[Map, list[tuple[int, Pose]]]:
    """Keeps MAX_RELATIVE_FRAMES frames between keyframes if there are more than `most`; returns the map and the final
    poses of the oldest ones. A map may stay visible for long."""
    if len(local_map.relative_frames) <= most:
        return local_map, []
    extra = len(local_map.relative_frames) - MAX_RELATIVE_FRAMES
    order = sorted(local_map.relative_frames, key=lambda b: b.time_ns)
    of_key = {k.time_ns: p for k, p in zip(local_map.keys, local_map.poses, strict=True)}
    done = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in order[:extra]]
    return replace(local_map, relative_frames=tuple(order[extra:])), done


def anchored_prior(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, unit_sigma: float) -> Prior:
    """Returns a prior that makes the first pose the world and its distance to the last the unit, without lens
    correction.

    `first` (6, 6) is the covariance of the first pose, right twist of world_from_camera, and `unit_sigma` the standard
    deviation of ln scale: both are zero except for a map that continues another one. `extra_sigma` (2,) is that of the
    lens correction. All are scaled by the loss width over the noise.
    """
    rotations, translations = camera_poses(poses)
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


def prior_of_keyframes(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, sigma: float, depth: float) -> Prior:
    """Returns a prior that fixes keyframes relative to each other, as optimised before: they define the scale.

    Args:
        poses: world_from_camera of each.
        extra_sigma: (2,) prior standard deviations of the lens correction; 0 fixes it.
        first: (6, 6) covariance of the first pose, left twist of camera_from_world.
        sigma: of a track, normalised: that of each rotation [rad] relative to the first, and, times `depth`, position.
        depth: of the points that they observe.
    """
    rotations, translations = camera_poses(poses)
    size = POSE * len(poses) + LENS
    hessian = np.zeros((size, size))
    hessian[:POSE, :POSE] = np.linalg.inv(
        first + sigma**2 * np.diag([(FIXED_SHARE * depth) ** 2] * 3 + [FIXED_SHARE**2] * 3)
    )
    information = np.diag([(sigma * depth) ** -2.0] * 3 + [sigma**-2.0] * 3)
    for i, pose in enumerate(poses[1:], 1):
        moved = np.zeros((POSE, size))
        moved[:, POSE * i : POSE * (i + 1)] = np.eye(POSE)
        moved[:, :POSE] = -(pose.inverse() @ poses[0]).adjoint
        hessian += moved.T @ information @ moved
    hessian[size - LENS :, size - LENS :] = np.diag(np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0)
    sandwich = Sandwich(hessian, hessian / LOSS**2)
    return Prior(rotations, translations, np.zeros(LENS), hessian, np.zeros(size), sandwich=sandwich)
