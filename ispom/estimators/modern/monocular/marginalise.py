"""What leaves the monocular estimator's window of key frames: the oldest, into a prior, or the most redundant one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.map import Map, RelativeFrame, bundle_problem
from ispom.estimators.modern.monocular.scatter import Curvature
from ispom.geometry import Pose
from ispom.solvers.window.adjustment import Window, marginalise
from ispom.solvers.window.prior import POSE, Prior, Sandwich
from ispom.types import Decision

DYING_SHARE = 0.3
"""Share of its points still tracked, below which the oldest key frame leaves: it constrains nothing new any more."""
MAX_RELATIVE_FRAMES = 100
"""Frames between key frames whose poses still follow their key frame once a key frame is taken; older ones are final.
Without a key frame, as at rest, they may become twice as many."""
NEWEST = 3
"""The last key frames that always stay: they carry the motion, and the youngest points."""


def shortened(state: Map, alive: NDArray[np.int64], count: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """At most `count` key frames: the map and the poses that nothing will revise any more.

    The oldest goes, into the prior, when hardly any of its points is still tracked; otherwise the one that says
    least that the others do not say (Engel et al. 2018, section 3.1): a map stays while it is in view.
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
    """Whether a key frame had to leave the window of at most `count`, and as what; of the maps around `shortened`."""
    then, gone = "", len(before.points.ids) - len(after.points.ids)
    if after.keys[0].time_ns != before.keys[0].time_ns:
        then = f"the oldest was marginalised, and {gone} points left the map"
    elif len(after.keys) < len(before.keys):
        then = "the most redundant one became an ordinary frame"
    return checks.WINDOW.of(len(before.keys), count, then)


def _redundant(state: Map) -> int:
    """Index of the key frame nearest to the others and farthest from the newest."""
    centres = np.array([p.translation for p in state.poses])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    typical = np.median(distance[distance > 0]) if (distance > 0).any() else 1.0
    inner = range(1, len(centres) - NEWEST)
    score = [
        np.sqrt(distance[i, -1]) * sum(1 / (1e-3 * typical + distance[i, k]) for k in inner if k != i) for i in inner
    ]
    return 1 + int(np.argmax(score))


def _oldest_into_prior(state: Map, alive: NDArray[np.int64]) -> tuple[Prior, NDArray[np.int64]]:
    """With the points that it sees and that are tracked no more; their ids: all that they say is now in the prior."""
    found = bundle_problem(state)
    by_oldest = np.zeros(len(found.ids), bool)
    by_oldest[found.window.owners[found.window.cameras == 0]] = True
    dead = by_oldest & ~np.isin(found.ids, alive)

    def of_part(part: Window) -> Sandwich:
        return Curvature.of(part, state.loss).sandwich(state.noise.shared)

    prior = marginalise(found.window, dead, state.loss, of_part)
    return prior, found.ids[dead]


def _prior_without(state: Map, j: int) -> Prior | None:
    """The prior with pose j eliminated; its observations are given up, as the other key frames say the same."""
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
    """Key frame j is a frame like others from now on: it moves along with the one before it; the first one is final."""
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
    """Where more than `most` frames lie between key frames, the map with MAX_RELATIVE_FRAMES of them, and the poses of
    the oldest beyond, which are final: a map in view may last."""
    if len(state.relative_frames) <= most:
        return state, []
    extra = len(state.relative_frames) - MAX_RELATIVE_FRAMES
    order = sorted(state.relative_frames, key=lambda b: b.time_ns)
    of_key = {k.time_ns: p for k, p in zip(state.keys, state.poses, strict=True)}
    done = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in order[:extra]]
    return replace(state, relative_frames=tuple(order[extra:])), done
