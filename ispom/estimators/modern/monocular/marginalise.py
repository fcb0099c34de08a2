"""Removes keyframes from the monocular window: marginalises the oldest into a prior, or drops the most redundant
one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.map import Map, RelativeFrame, bundle_problem
from ispom.geometry import Pose
from ispom.solvers.window.adjustment import Window, marginalise
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import POSE, Prior, Sandwich
from ispom.types import Decision

DYING_SHARE = 0.3
"""Share of its points still tracked, below which the oldest keyframe is marginalised: it adds no new constraints."""
MAX_RELATIVE_FRAMES = 100
"""Largest number of frames between keyframes whose poses still move with their keyframe, once a keyframe is taken;
older ones are final. Without a new keyframe, as at rest, they may become twice as many."""
NEWEST = 3
"""Number of the newest keyframes that always stay: they constrain the motion and the youngest points."""


def shortened(state: Map, alive: NDArray[np.int64], count: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Keeps at most `count` keyframes; returns the map and the poses that are final.

    The oldest keyframe is marginalised if hardly any of its points is still tracked; otherwise the most redundant one
    is removed (Engel et al. 2018, section 3.1): a map stays while it is visible.
    """
    settled: list[tuple[int, Pose]] = []
    while len(state.keys) > count:
        share = np.isin(state.keys[0].ids, alive, assume_unique=True).mean() if len(state.keys[0].ids) else 0.0
        j = 0 if share < DYING_SHARE else _redundant(state)
        if j == 0:
            prior, used = _oldest_into_prior(state, alive)
            state = replace(state.without(used), prior=prior)
        else:
            state = replace(state, prior=_prior_without(state, j))
        state, done = _without_key(state, j)
        settled += done
    state, done = limited(state, MAX_RELATIVE_FRAMES)
    settled += done
    seen = np.unique(np.concatenate([k.ids for k in state.keys]))
    return replace(state, points=state.points.only(seen)), settled


def what_left(before: Map, after: Map, count: int) -> Decision:
    """Reports whether a keyframe left the window of at most `count`, and how; from the maps before and after
    `shortened`."""
    then, gone = "", len(before.points.ids) - len(after.points.ids)
    if after.keys[0].time_ns != before.keys[0].time_ns:
        then = f"the oldest was marginalised, and {gone} points left the map"
    elif len(after.keys) < len(before.keys):
        then = "the most redundant one became an ordinary frame"
    return checks.WINDOW.of(len(before.keys), count, then)


def _redundant(state: Map) -> int:
    """Returns the index of the keyframe nearest to the others and farthest from the newest."""
    centres = np.array([p.translation for p in state.poses])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    typical = np.median(distance[distance > 0]) if (distance > 0).any() else 1.0
    inner = range(1, len(centres) - NEWEST)
    score = [
        np.sqrt(distance[i, -1]) * sum(1 / (1e-3 * typical + distance[i, k]) for k in inner if k != i) for i in inner
    ]
    return 1 + int(np.argmax(score))


def _oldest_into_prior(state: Map, alive: NDArray[np.int64]) -> tuple[Prior, NDArray[np.int64]]:
    """Marginalises the oldest keyframe and those of its points that are no longer tracked; also returns their ids."""
    found = bundle_problem(state)
    by_oldest = np.zeros(len(found.ids), bool)
    by_oldest[found.window.owners[found.window.cameras == 0]] = True
    dead = by_oldest & ~np.isin(found.ids, alive)

    inverse, none = WindowCovariance.of(found.window, found.ids, state.loss).inverse, np.zeros(0, np.int64)

    def of_part(part: Window) -> Sandwich:
        return WindowCovariance.of(part, found.ids[dead], state.loss).marginal(none, inverse)

    prior = marginalise(found.window, dead, state.loss, of_part)
    return prior, found.ids[dead]


def _prior_without(state: Map, j: int) -> Prior | None:
    """Eliminates pose j from the prior; its observations are discarded, as the other keyframes are redundant with
    them."""
    prior = state.prior
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


def _without_key(state: Map, j: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Makes keyframe j an ordinary frame, relative to the keyframe before it; the first keyframe becomes final."""
    key, pose = state.keys[j], state.poses[j]
    mine = [b for b in state.relative_frames if b.key_ns == key.time_ns]
    others = tuple(b for b in state.relative_frames if b.key_ns != key.time_ns)
    keys = state.keys[:j] + state.keys[j + 1 :]
    if j == 0:
        done = [(key.time_ns, pose), *((b.time_ns, pose @ b.key_from_camera) for b in mine)]
        return replace(state, keys=keys, relative_frames=others), done
    before, before_ns = state.poses[j - 1].inverse() @ pose, state.keys[j - 1].time_ns
    moved = (RelativeFrame(b.time_ns, before_ns, before @ b.key_from_camera) for b in mine)
    own = RelativeFrame(key.time_ns, before_ns, before)
    return replace(state, keys=keys, relative_frames=(*others, own, *moved)), []


def limited(state: Map, most: int = 2 * MAX_RELATIVE_FRAMES) -> tuple[Map, list[tuple[int, Pose]]]:
    """Keeps MAX_RELATIVE_FRAMES frames between keyframes if there are more than `most`; returns the map and the final
    poses of the oldest ones. A map may stay visible for long."""
    if len(state.relative_frames) <= most:
        return state, []
    extra = len(state.relative_frames) - MAX_RELATIVE_FRAMES
    order = sorted(state.relative_frames, key=lambda b: b.time_ns)
    of_key = {k.time_ns: p for k, p in zip(state.keys, state.poses, strict=True)}
    done = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in order[:extra]]
    return replace(state, relative_frames=tuple(order[extra:])), done
