"""The stereo estimator's window: keyframes with observations, points, and the prior from marginalisation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.modern.stereo.packing import pack
from ispom.estimators.modern.stereo.shutter import pair_at_middle
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.robust import Noise
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.window import WindowProblem
from ispom.solvers.right_camera import PAIR, lens_of_both
from ispom.solvers.window.adjustment import Adjusted, Window, adjust, marginalise
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import POSE, Prior, Sandwich, anchored
from ispom.types import Camera

KEPT_FRAMES = 2
"""Number of newest keyframes whose observations of a point stay when its older ones are marginalised."""
HELD_SIGMA = 1e-6
"""Standard deviation [m, rad] that fixes the window's first pose after a loss, like `prior.anchored`."""


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """A keyframe of the window with its observations."""

    time_ns: int
    left_from_world: Pose
    ids: NDArray[np.int64]
    """(N,) ids of the observed points, ascending."""
    seen: Array
    """(N, 3) normalised x, y in the left image, x in the right one or NaN."""
    motion: Array
    """(12,) motion of left_from_world, see rolling.steady; its change is known for a rolling shutter only."""
    slants: Array
    """(N, 2) slants of the points' surfaces, see features.slanted; 0 where unknown."""
    late_s: Array | None = None
    """(N,) exposure time of each observation's row, relative to the middle row, at which the pose is; None for a global
    shutter."""

    @property
    def rate(self) -> Array:
        """Returns the rate (6,) of left_from_world, a left twist (rho [m/s], phi [rad/s]) per second."""
        return self.motion[:6]

    def only(self, keep: NDArray[np.bool_]) -> KeyFrame:
        """Returns the keyframe with the points of the mask `keep` (N,) only."""
        late_s = None if self.late_s is None else self.late_s[keep]
        return replace(self, ids=self.ids[keep], seen=self.seen[keep], slants=self.slants[keep], late_s=late_s)

    def at_middle(self, baseline_m: float) -> Array:
        """Returns the observations (N, 3) at the time of the middle row."""
        return pair_at_middle(self.seen, self.late_s, self.motion, baseline_m)


@dataclass(frozen=True, eq=False)
class Start:
    """The pose at which a new segment started after a loss; all its poses share the error of this one.

    It is not in the window's prior, where rounding would hide it next to the information of a hundred points.
    """

    left_from_world: Pose
    covariance: Array
    """(6, 6) covariance of the pose, as a left twist."""


@dataclass(frozen=True, eq=False)
class StereoMap:
    """The map that frames are localised in: keyframes, points and calibration."""

    keys: tuple[KeyFrame, ...] = ()
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) ids of the points, ascending."""
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) positions in the world [m]."""
    extra: Array = field(default_factory=lambda: np.zeros(PAIR))
    """(E,) corrections of the pair (see right_camera.TERMS)."""
    prior: Prior | None = None
    covariance: Array | None = None
    """(6 C + E, 6 C + E) covariance of the keyframes' left twists and the corrections, relative to the start. It takes
    errors as independent, with the width of the loss. None before a second keyframe."""
    newest: Array | None = None
    """(6, 6) covariance of the newest keyframe's left twist, relative to the start, from the residuals of the tracks
    (see WindowCovariance)."""
    start: Start | None = None
    """None if the first keyframe defines the world."""
    noise: TrackNoise = TrackNoise()
    """Noise of the tracks, estimated from the windows' residuals."""

    def places(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns the index (N,) of each id among the points, -1 if unknown."""
        return places(self.ids, ids)

    def left(self, camera: Camera) -> Lens:
        """Returns the left camera with its estimated corrections."""
        return Lens(camera, lens_of_both(self.extra))

    def with_points(self, ids: NDArray[np.int64], xyz: Array) -> StereoMap:
        """Adds new points, whose ids are not in the map yet."""
        every = np.concatenate([self.ids, ids])
        order = np.argsort(every, kind="stable")
        return replace(self, ids=every[order], xyz=np.concatenate([self.xyz, xyz])[order])

    def only(self, ids: NDArray[np.int64]) -> StereoMap:
        """Removes the points that no keyframe observes and that are not among these ids."""
        needed = np.zeros(len(self.ids) + 1, bool)  # the last entry stands for unknown ids
        needed[self.places(np.concatenate([ids, *(k.ids for k in self.keys)]))] = True
        return replace(self, ids=self.ids[needed[:-1]], xyz=self.xyz[needed[:-1]])


def with_key(
    state: StereoMap, key: KeyFrame, extra_sigma: Array, settling_s: float, predicted: Array | None = None
) -> StereoMap:
    """Adds a keyframe; the first one defines the world, or has the covariance `predicted` (6, 6) in it.

    The prior of the corrections ages: with time constant `settling_s` [s] it returns to `extra_sigma` (E,).
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
        remaining = float(np.exp((keys[-1].time_ns - key.time_ns) * 1e-9 / settling_s))
        prior = required(prior, "the window has no prior").with_process_noise(remaining, extra_sigma)
        if len(keys) == 1:
            # The first keyframe has no predecessor, so it gets the motion of the second one.
            keys = (replace(keys[0], motion=key.motion),)
    return replace(state, keys=(*keys, key), prior=prior, covariance=covariance, newest=newest, start=start)


def emptied(state: StereoMap) -> StereoMap:
    """Returns the map without keyframes and points, but with the corrections of the pair and the noise."""
    covariance = None if state.covariance is None else state.covariance[-PAIR:, -PAIR:]
    return StereoMap(extra=state.extra, covariance=covariance, noise=state.noise)


def known_of_pair(state: StereoMap, extra_sigma: Array) -> Array:
    """Returns the covariance (E, E) of `extra`."""
    return np.diag(extra_sigma**2) if state.covariance is None else state.covariance[-PAIR:, -PAIR:]


def adjusted(
    state: StereoMap, baseline: float, extra_sigma: Array, scale: float, threshold: float, iterations: int
) -> tuple[StereoMap, Adjusted | None]:
    """Optimises the window by bundle adjustment, and drops observations with errors above `threshold` afterwards.

    Covariances are computed for a global shutter only (else see rolling_window.py).
    """
    window, used, origin = packed(state, baseline, extra_sigma)
    if len(state.keys) < 2 or not len(window.cameras):
        return state, None
    start, result = window, adjust(window, scale, iterations)
    window = result.window
    times_ns = tuple(key.time_ns for key in state.keys)
    if state.keys[-1].late_s is None:
        report_problem(lambda: WindowProblem(start, window, scale, state.ids[used], times_ns, "left"))
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
    if state.keys[-1].late_s is not None:
        return made, result
    found = WindowCovariance.of(window, state.ids[used], scale)
    return replace(made, covariance=found.inverse, newest=found.newest), result


def parted(state: StereoMap) -> tuple[tuple[KeyFrame, ...], tuple[KeyFrame, ...]]:
    """Splits the window for marginalisation of its oldest keyframe.

    Returns all keyframes with the observations to marginalise (of the oldest keyframe's points), and the others with
    the rest. Continuing tracks keep their newest observations.
    """
    oldest, newest = state.keys[0], len(state.keys) - KEPT_FRAMES
    gone = [
        places(oldest.ids, k.ids) >= 0 if i < newest else np.zeros(len(k.ids), bool) for i, k in enumerate(state.keys)
    ]
    past = tuple(k.only(m) for k, m in zip(state.keys, gone, strict=True))
    rest = (k.only(~m) for k, m in zip(state.keys[1:newest], gone[1:], strict=False))
    return past, (*rest, *state.keys[newest:])


def without_oldest(state: StereoMap, baseline: float, extra_sigma: Array, scale: float) -> StereoMap:
    """Marginalises the oldest keyframe and its points into a prior on the others."""
    (past, keys), known = parted(state), required(state.covariance, "the window was not optimised")
    window, used, _ = packed(replace(state, keys=past), baseline, extra_sigma)
    continuing = np.concatenate([k.ids for k in keys])

    def of_part(part: Window) -> Sandwich:
        return WindowCovariance.of(part, state.ids[used], scale).marginal(continuing, known)

    prior = marginalise(window, np.ones(len(window.points), bool), scale, of_part)
    return replace(state, keys=keys, prior=prior)


def packed(
    state: StereoMap, baseline: float, extra_sigma: Array
) -> tuple[Window, NDArray[np.int64], NDArray[np.int64]]:
    """Returns the window's arrays, the indices of its points in the map, and of each observation in its keyframe."""
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
    """Returns the factor of covariances that assumed the loss width as the noise of tracks."""
    return state.noise.variance(noise.sigma) / noise.width**2


def with_pair(state: StereoMap, pair: KeyFrame, baseline: float, extra_sigma: Array, scale: float) -> StereoMap:
    """Returns the map with the covariance of a frame that is no keyframe, as if it were the newest one.

    A track's errors in window and frame are correlated: the sum of the covariances of the newest keyframe and of the
    relative pose would be a tenth to a third too small.
    """
    known = state.places(pair.ids) >= 0
    state = replace(state, keys=(*state.keys, pair.only(known)))
    window, used, _ = packed(state, baseline, extra_sigma)
    return replace(state, newest=WindowCovariance.of(window, state.ids[used], scale).newest)


def newest_covariance(state: StereoMap) -> Array | None:
    """Returns the covariance (6, 6) of the newest keyframe's left twist in the world; None before an optimisation."""
    if state.newest is None or not state.keys or state.start is None:
        return state.newest
    way = (state.keys[-1].left_from_world @ state.start.left_from_world.inverse()).adjoint
    return state.newest + way @ state.start.covariance @ way.T


def _proper(rotations: Array) -> Array:
    """Returns the nearest rotations (C, 3, 3), as products of many rotations accumulate rounding errors."""
    u, _, vt = np.linalg.svd(rotations)
    return u @ vt
