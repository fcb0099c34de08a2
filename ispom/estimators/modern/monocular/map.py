"""The map of the monocular estimator: a window of key frames, the points they see, and what has left it, as a prior."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.paper.keyframes import Frame, Points
from ispom.geometry import Array, Pose
from ispom.solvers.inverse_depth import InverseDepths, intersect
from ispom.solvers.prior import LENS, POSE, Prior
from ispom.solvers.window import Adjusted, Window, adjust, marginalise

DYING_SHARE = 0.3
"""A key frame of whose points a smaller share is still tracked has nothing more to say."""
MOST_BETWEEN = 100
"""Frames between the key frames whose poses may still move."""
NEWEST = 3
"""The last key frames always stay: they carry the motion, and the points that are still young."""


@dataclass(frozen=True, eq=False)
class Between:
    """A frame that is no key frame: it moves along with the key frame before it."""

    time_ns: int
    key_ns: int
    key_from_camera: Pose


@dataclass(frozen=True, eq=False)
class Map:
    keys: tuple[Frame, ...]
    """In order of time, each with its pose and all its tracks, those without a point included."""
    points: Points
    prior: Prior | None
    """Over the first poses of the window; holds the world and the unit."""
    between: tuple[Between, ...] = ()
    extra: Array = field(default_factory=lambda: np.zeros(LENS))
    """Correction of the camera, see lens.py; the key frames' coordinates are without it."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """Its deviations before any data; 0 where it is held."""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """world_from_camera of the key frames."""
        return tuple(k.world_from_camera for k in self.keys if k.world_from_camera is not None)

    def trajectory(self) -> list[tuple[int, Pose]]:
        """All frames of the window."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        others = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in self.between]
        return [*of_key.items(), *others]

    def known(self, ids: NDArray[np.int64]) -> Array:
        """Points (N, 3) of these tracks, NaN where there is none."""
        place = self.points.places(ids)
        if not len(self.points.ids):
            return np.full((len(ids), 3), np.nan)
        return np.where((place >= 0)[:, None], self.points.xyz[place], np.nan)

    def with_between(self, time_ns: int, world_from_camera: Pose) -> Map:
        key_from_camera = self.poses[-1].inverse() @ world_from_camera
        return replace(self, between=(*self.between, Between(time_ns, self.keys[-1].time_ns, key_from_camera)))

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Map:
        """Adds tracks first seen in the last key frame to it."""
        key = self.keys[-1]
        key = replace(key, ids=np.concatenate([key.ids, ids]), x=np.concatenate([key.x, x]))
        return replace(self, keys=(*self.keys[:-1], key))

    def without(self, ids: NDArray[np.int64]) -> Map:
        """Forgets these points."""
        kept = ~np.isin(self.points.ids, ids)
        return replace(self, points=Points(self.points.ids[kept], self.points.xyz[kept]))


@dataclass(frozen=True, eq=False)
class Problem:
    """The window as arrays."""

    window: Window
    ids: NDArray[np.int64]
    """(M,) of its points."""


@dataclass(frozen=True, eq=False)
class Observations:
    """All observations of some tracks (places 0..M-1) by the key frames, sorted by track, then by key frame."""

    cameras: NDArray[np.int64]
    owners: NDArray[np.int64]
    seen: Array
    """(K, 2) normalised."""


def observations(keys: tuple[Frame, ...], ids: NDArray[np.int64]) -> Observations:
    """`ids` (M,) ascending."""
    wanted = Points(ids, np.zeros((len(ids), 3)))
    cameras, owners, seen = [], [], []
    for c, key in enumerate(keys):
        place = wanted.places(key.ids)
        use = place >= 0
        owners.append(place[use])
        cameras.append(np.full(len(owners[-1]), c, np.int64))
        seen.append(key.x[use])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return Observations(np.concatenate(cameras)[order], owner[order], np.concatenate(seen)[order])


def views(poses: tuple[Pose, ...]) -> tuple[Array, Array]:
    """camera_from_world (C, 3, 3) and (C, 3)."""
    inverses = [p.inverse() for p in poses]
    return np.stack([p.rotation for p in inverses]), np.stack([p.translation for p in inverses])


def problem(state: Map) -> Problem:
    """The points that two key frames or more see, with all their observations."""
    seen = observations(state.keys, state.points.ids)
    counts = np.bincount(seen.owners, minlength=len(state.points.ids))
    use = counts >= 2
    slot, kept = np.cumsum(use) - 1, use[seen.owners]
    rotations, translations = views(state.poses)
    return Problem(
        Window(
            rotations,
            translations,
            state.points.xyz[use],
            seen.cameras[kept],
            slot[seen.owners[kept]],
            np.column_stack([seen.seen[kept], np.full(int(kept.sum()), np.nan)]),
            np.zeros(int(kept.sum())),
            extra=state.extra,
            extra_sigma=state.extra_sigma,
            prior=state.prior,
        ),
        state.points.ids[use],
    )


def adjusted(state: Map, sigma: float, iterations: int, tolerance: float = 1e-3) -> tuple[Map, Adjusted, Problem]:
    """The map after windowed bundle adjustment, without the points that end behind a view or off by 4 sigma."""
    before = problem(state)
    found = adjust(before.window, sigma, iterations, tolerance)
    window = found.window
    worst = np.zeros(len(before.ids))
    np.maximum.at(worst, window.owners, found.distances)
    xyz = state.points.xyz.copy()
    place = state.points.places(before.ids)
    xyz[place] = window.points
    keys = tuple(
        replace(k, world_from_camera=Pose(r.T, -r.T @ t))
        for k, r, t in zip(state.keys, window.rotations, window.translations, strict=True)
    )
    kept = np.ones(len(xyz), bool)
    kept[place[worst > 4 * sigma]] = False
    after = replace(state, extra=window.extra, keys=keys, points=Points(state.points.ids[kept], xyz[kept]))
    return after, found, before


def intersected(state: Map, ids: NDArray[np.int64], sigma: float) -> InverseDepths:
    """Points of tracks (M,) ascending, from all key frames that see them."""
    seen = observations(state.keys, ids)
    x = corrected(seen.seen, state.extra)
    return intersect(*views(state.poses), seen.cameras, seen.owners, x, len(ids), sigma)


def shortened(state: Map, alive: NDArray[np.int64], count: int, sigma: float) -> tuple[Map, list[tuple[int, Pose]]]:
    """At most `count` key frames: the map and the poses that nothing will revise any more.

    The oldest goes, into the prior, when hardly any of its points is still tracked; otherwise the one that says
    least that others do not say (Engel et al. 2018, section 3.1): a map stays while it is in view.
    """
    settled: list[tuple[int, Pose]] = []
    while len(state.keys) > count:
        share = np.isin(state.keys[0].ids, alive, assume_unique=True).mean() if len(state.keys[0].ids) else 0.0
        j = 0 if share < DYING_SHARE else _redundant(state)
        if j == 0:
            prior, used = _oldest_into_prior(state, alive, sigma)
            state = replace(state.without(used), prior=prior)
        else:
            state = replace(state, prior=_prior_without(state, j))
        state, done = _without_key(state, j)
        settled += done
    state, done = _rested(state)
    settled += done
    seen = np.unique(np.concatenate([k.ids for k in state.keys]))
    return replace(state, points=state.points.only(seen)), settled


def _redundant(state: Map) -> int:
    """Index of the key frame nearest to the others and farthest from the newest."""
    centres = np.array([p.translation for p in state.poses])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    spread = np.median(distance[distance > 0]) if (distance > 0).any() else 1.0
    inner = range(1, len(centres) - NEWEST)
    score = [
        np.sqrt(distance[i, -1]) * sum(1 / (1e-3 * spread + distance[i, k]) for k in inner if k != i) for i in inner
    ]
    return 1 + int(np.argmax(score))


def _oldest_into_prior(state: Map, alive: NDArray[np.int64], sigma: float) -> tuple[Prior, NDArray[np.int64]]:
    """With the points that it sees and that are tracked no more; their ids: all that they say is now in the prior."""
    found = problem(state)
    by_oldest = np.zeros(len(found.ids), bool)
    by_oldest[found.window.owners[found.window.cameras == 0]] = True
    dead = by_oldest & ~np.isin(found.ids, alive)
    return marginalise(found.window, dead, sigma), found.ids[dead]


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
    )


def _without_key(state: Map, j: int) -> tuple[Map, list[tuple[int, Pose]]]:
    """Key frame j is a frame like others from now on: it moves along with the one before it; the first one rests."""
    key, pose = state.keys[j], state.poses[j]
    mine = [b for b in state.between if b.key_ns == key.time_ns]
    others = tuple(b for b in state.between if b.key_ns != key.time_ns)
    keys = state.keys[:j] + state.keys[j + 1 :]
    if j == 0:
        done = [(key.time_ns, pose), *((b.time_ns, pose @ b.key_from_camera) for b in mine)]
        return replace(state, keys=keys, between=others), done
    before, before_ns = state.poses[j - 1].inverse() @ pose, state.keys[j - 1].time_ns
    moved = (Between(b.time_ns, before_ns, before @ b.key_from_camera) for b in mine)
    return replace(state, keys=keys, between=(*others, Between(key.time_ns, before_ns, before), *moved)), []


def _rested(state: Map) -> tuple[Map, list[tuple[int, Pose]]]:
    """Without the oldest of very many frames between key frames: those of a map that lasts."""
    extra = len(state.between) - MOST_BETWEEN
    if extra <= 0:
        return state, []
    order = sorted(state.between, key=lambda b: b.time_ns)
    of_key = {k.time_ns: p for k, p in zip(state.keys, state.poses, strict=True)}
    done = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in order[:extra]]
    return replace(state, between=tuple(order[extra:])), done


def anchored_prior(poses: tuple[Pose, ...], extra_sigma: Array, first: Array, unit_sigma: float) -> Prior:
    """Makes the first pose the world, and its distance to the last the unit; no correction of the camera yet.

    `first` (6, 6) covariance of the first pose, twist on the right of world_from_camera, and `unit_sigma` deviation of
    the logarithm of the unit: zero but for a map that goes on from another one. `extra_sigma` (2,): of the camera's
    correction. All as widened as the loss is.
    """
    rotations, translations = views(poses)
    size = POSE * len(poses) + LENS
    hessian = np.zeros((size, size))
    apart = poses[-1].translation - poses[0].translation
    unit = float(np.linalg.norm(apart))
    # A right twist of world_from_camera is, but for its sign, the left one of its inverse.
    hessian[:POSE, :POSE] = np.linalg.inv(first + 1e-12 * np.diag([unit**2] * 3 + [1.0] * 3))
    along = -rotations[-1] @ apart / unit  # how a left twist's rho moves the last centre away from the first
    last = slice(POSE * (len(poses) - 1), POSE * len(poses))
    hessian[last, last][:3, :3] += np.outer(along, along) / (unit**2 * (1e-12 + unit_sigma**2))
    hessian[size - LENS :, size - LENS :] = np.diag(np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0)
    return Prior(rotations, translations, np.zeros(LENS), hessian, np.zeros(size))
