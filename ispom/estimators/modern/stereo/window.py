"""The stereo estimator's window: key frames with what they saw, the points, and the prior for what has left."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.modern.stereo.packing import pack
from ispom.estimators.modern.stereo.shutter import Shutter
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.robust import Noise
from ispom.solvers.right_camera import PAIR, lens_of_both
from ispom.solvers.window.adjustment import Adjusted, Window, adjust, marginalise
from ispom.solvers.window.groups import Groups
from ispom.solvers.window.prior import POSE, Prior, Sandwich, anchored
from ispom.types import Camera

KEPT_FRAMES = 2
"""A point's observations in the newest key frames stay when the older ones are marginalised: its track goes on."""
HELD_SIGMA = 1e-6
"""[m, rad] With it a window's first pose is held after a loss, as `prior.anchored` does at the beginning."""


@dataclass(frozen=True, eq=False)
class KeyFrame:
    time_ns: int
    left_from_world: Pose
    ids: NDArray[np.int64]
    """(N,) of the points seen, ascending."""
    seen: Array
    """(N, 3) normalised x, y in the left image, x in the right one or NaN."""
    motion: Array
    """(12,) of left_from_world, as of rolling.mean_rates; its change is known of a rolling shutter only."""
    slants: Array
    """(N, 2) of the points' surfaces, see features.slanted; 0 where unknown."""
    shutter: Shutter = Shutter()

    @property
    def rate(self) -> Array:
        """(6,) of left_from_world's change (rho [m/s], phi [rad/s]; left)."""
        return self.motion[:6]

    def only(self, keep: NDArray[np.bool_]) -> KeyFrame:
        """With these of its points (N,)."""
        return replace(self, ids=self.ids[keep], seen=self.seen[keep], slants=self.slants[keep])

    def at_middle(self, baseline_m: float) -> Array:
        """(N, 3) `seen` as it was with the middle row."""
        return self.shutter.at_middle(self.seen, self.motion, baseline_m)


@dataclass(frozen=True, eq=False)
class Start:
    """Where the window began anew, after a loss: all its poses share the error of this one.

    It is no prior of the window: beside what a hundred points say of each other it would drown in rounding.
    """

    left_from_world: Pose
    covariance: Array
    """(6, 6) of its left twist."""


@dataclass(frozen=True, eq=False)
class StereoMap:
    """Key frames, points and calibration: all that a pair is located against."""

    keys: tuple[KeyFrame, ...] = ()
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) of the points with a place, ascending."""
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) in the world [m]."""
    extra: Array = field(default_factory=lambda: np.zeros(PAIR))
    """(E,) what is wrong with the pair (see right_camera.TERMS)."""
    prior: Prior | None = None
    covariance: Array | None = None
    """(6 C + E, 6 C + E) of the key frames' left twists and the extras, relative to the start, were errors
    independent and as large as the loss says: what the adjustment goes by. None before a second key frame."""
    newest: Array | None = None
    """(6, 6) covariance of the newest key frame's left twist, relative to the start, by what tracks turn out to be
    off by (see groups.Groups)."""
    start: Start | None = None
    """None where the first key frame is the world."""
    noise: TrackNoise = TrackNoise()
    """What the windows' residuals said of the tracks."""

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) index of each id among the points, -1 where unknown."""
        return places(self.ids, ids)

    def left(self, camera: Camera) -> Lens:
        """The left camera without what was found to be wrong with it."""
        return Lens(camera, lens_of_both(self.extra))

    def with_points(self, ids: NDArray[np.int64], xyz: Array) -> StereoMap:
        """With new points; ids not in the map yet."""
        every = np.concatenate([self.ids, ids])
        order = np.argsort(every, kind="stable")
        return replace(self, ids=every[order], xyz=np.concatenate([self.xyz, xyz])[order])

    def only(self, ids: NDArray[np.int64]) -> StereoMap:
        """Without the points that neither a key frame nor these ids know any more."""
        needed = np.zeros(len(self.ids) + 1, bool)  # the last one for what is unknown
        needed[self.places(np.concatenate([ids, *(k.ids for k in self.keys)]))] = True
        return replace(self, ids=self.ids[needed[:-1]], xyz=self.xyz[needed[:-1]])


def with_key(
    state: StereoMap, key: KeyFrame, extra_sigma: Array, settling_s: float, predicted: Array | None = None
) -> StereoMap:
    """The map with one more key frame; the first one is the world, or has the covariance `predicted` (6, 6) in it.

    Since the last one the pair may have changed: within `settling_s` as much as was open before any data.
    """
    keys, prior, covariance, newest, start = state.keys, state.prior, state.covariance, state.newest, state.start
    if not keys:
        prior = anchored(key.left_from_world.rotation, key.left_from_world.translation, extra_sigma)
        if predicted is not None:
            start = Start(key.left_from_world, predicted)
            covariance = np.diag(
                np.concatenate([np.full(POSE, HELD_SIGMA**2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** 2])
            )
            if state.covariance is not None:
                covariance[POSE:, POSE:] = state.covariance[-PAIR:, -PAIR:]
            hessian, newest = np.linalg.inv(covariance), covariance[:POSE, :POSE]
            prior = replace(prior, extra=state.extra, hessian=hessian, sandwich=Sandwich(hessian, hessian))
    else:
        assert prior is not None
        prior = prior.aged(float(np.exp((keys[-1].time_ns - key.time_ns) * 1e-9 / settling_s)), extra_sigma)
        if len(keys) == 1:
            # Nothing was before the first one: it moved as the second does.
            keys = (replace(keys[0], motion=key.motion),)
    return replace(state, keys=(*keys, key), prior=prior, covariance=covariance, newest=newest, start=start)


def emptied(state: StereoMap) -> StereoMap:
    """Without key frames and points; what was found out about the pair stays."""
    covariance = None if state.covariance is None else state.covariance[-PAIR:, -PAIR:]
    return StereoMap(extra=state.extra, covariance=covariance, noise=state.noise)


def known_of_pair(state: StereoMap, extra_sigma: Array) -> Array:
    """(E, E) covariance of `extra`."""
    return np.diag(extra_sigma**2) if state.covariance is None else state.covariance[-PAIR:, -PAIR:]


def adjusted(
    state: StereoMap, baseline: float, extra_sigma: Array, scale: float, threshold: float, iterations: int
) -> tuple[StereoMap, Adjusted | None]:
    """Bundle adjustment of the window; observations farther than `threshold` from their points are dropped then.

    How sure it is then is told where all rows are exposed together (else see rolling_window.py).
    """
    window, used, origin = _packed(state, baseline, extra_sigma)
    if len(state.keys) < 2 or not len(window.cameras):
        return state, None
    result = adjust(window, scale, iterations)
    window = result.window
    keys = [
        replace(key, left_from_world=Pose(r, t))
        for key, r, t in zip(state.keys, _proper(window.rotations), window.translations, strict=True)
    ]
    bad = result.distances > threshold
    for c in np.flatnonzero(np.bincount(window.cameras[bad])):
        keep = np.ones(len(keys[c].ids), bool)
        keep[origin[bad & (window.cameras == c)]] = False
        keys[c] = keys[c].only(keep)
    xyz = state.xyz.copy()
    xyz[used] = window.points
    noise = state.noise.after(result, scale)
    made = replace(state, keys=tuple(keys), xyz=xyz, extra=window.extra, noise=noise)
    if state.keys[-1].shutter.rolls:
        return made, result
    groups = Groups.of(window, state.ids[used], scale)
    return replace(made, covariance=groups.covariance, newest=groups.newest()), result


def parted(state: StereoMap) -> tuple[tuple[KeyFrame, ...], tuple[KeyFrame, ...]]:
    """What all key frames saw of the points that leave with the oldest, and the others with the rest of what they saw;
    tracks that go on keep their newest places."""
    oldest, newest = state.keys[0], len(state.keys) - KEPT_FRAMES
    gone = [
        places(oldest.ids, k.ids) >= 0 if i < newest else np.zeros(len(k.ids), bool) for i, k in enumerate(state.keys)
    ]
    past = tuple(k.only(m) for k, m in zip(state.keys, gone, strict=True))
    rest = (k.only(~m) for k, m in zip(state.keys[1:newest], gone[1:], strict=False))
    return past, (*rest, *state.keys[newest:])


def without_oldest(state: StereoMap, baseline: float, extra_sigma: Array, scale: float) -> StereoMap:
    """The oldest key frame and its points become a prior on the others."""
    (past, keys), known = parted(state), state.covariance
    assert known is not None
    window, used, _ = _packed(replace(state, keys=past), baseline, extra_sigma)
    lasting = np.concatenate([k.ids for k in keys])

    def of_part(part: Window) -> Sandwich:
        return Groups.of(part, state.ids[used], scale).sandwich(lasting, known)

    prior = marginalise(window, np.ones(len(window.points), bool), scale, of_part)
    return replace(state, keys=keys, prior=prior)


def _packed(
    state: StereoMap, baseline: float, extra_sigma: Array
) -> tuple[Window, NDArray[np.int64], NDArray[np.int64]]:
    """The window's arrays; which points of the map are in it; and where in its key frame each observation stands."""
    keys, sizes = state.keys, np.array([len(k.ids) for k in state.keys])
    rotations = np.stack([k.left_from_world.rotation for k in keys])
    translations = np.stack([k.left_from_world.translation for k in keys])
    packed = pack(
        state.ids,
        state.xyz,
        np.concatenate([k.ids for k in keys]),
        sizes,
        np.concatenate([k.at_middle(baseline) for k in keys]),
        rotations,
        translations,
        np.stack([k.rate for k in keys]),
        state.extra,
        float(baseline),
    )
    window = Window(
        rotations,
        translations,
        state.xyz[packed.used],
        packed.cameras,
        packed.owners,
        packed.seen,
        baseline,
        state.extra,
        extra_sigma,
        packed.factors,
        state.prior,
    )
    return window, packed.used, packed.origin


def variance_factor(state: StereoMap, noise: Noise) -> float:
    """Returns the factor that makes covariances of those that take the width of the loss for the noise of tracks."""
    return state.noise.variance(noise.sigma) / noise.width**2


def with_pair(state: StereoMap, pair: KeyFrame, baseline: float, extra_sigma: Array, scale: float) -> StereoMap:
    """The map as sure as it is of a located pair that is no key frame: as if it were the newest one.

    What each track says there it mostly says in the window, too: the covariance of the newest key frame and that of the
    way from there, added, would be too small by a tenth to a third.
    """
    known = state.places(pair.ids) >= 0
    state = replace(state, keys=(*state.keys, pair.only(known)))
    window, used, _ = _packed(state, baseline, extra_sigma)
    return replace(state, newest=Groups.of(window, state.ids[used], scale).newest())


def newest_covariance(state: StereoMap) -> Array | None:
    """(6, 6) of the newest key frame's left twist in the world; None before an adjustment."""
    if state.newest is None or not state.keys or state.start is None:
        return state.newest
    way = (state.keys[-1].left_from_world @ state.start.left_from_world.inverse()).adjoint
    return state.newest + way @ state.start.covariance @ way.T


def _proper(rotations: Array) -> Array:
    """The nearest rotations (C, 3, 3): products of many turns lose their last digits."""
    u, _, vt = np.linalg.svd(rotations)
    return u @ vt
