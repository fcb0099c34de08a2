"""The state of the modern stereo estimator between frames: map, last frame, poses, loops; and one frame's outcome."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.keyframe_database import KeyframeDatabase
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.modern.stereo.level import Level
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, TrackingResult
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.shutter import pair_at_middle
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.numerics.robust import Noise
from ispom.persistent_list import PersistentList
from ispom.solvers.right_camera import PAIR, lens_of_both
from ispom.solvers.window.prior import POSE, Prior, Sandwich, anchored
from ispom.types import Camera, Decision, Status, Tracks

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
class SegmentStart:
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
    start: SegmentStart | None = None
    """None if the first keyframe defines the world."""
    noise: TrackNoise = TrackNoise()
    """Noise of the tracks, estimated from the windows' residuals."""

    def corrected(self, level: Level) -> StereoMap:
        """Returns the map with all corrections of the pair: those of its level ones, and those that levelled them."""
        return replace(self, extra=self.extra + level.terms) if level.terms.any() else self

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

    def with_key(self, setup: Setup, key: KeyFrame, predicted: Array | None = None) -> StereoMap:
        """Adds a keyframe; the first one defines the world, or has the covariance `predicted` (6, 6) in it.

        The prior of the corrections ages: with time constant `settling_s` it returns to `extra_sigma`.
        """
        if not self.keys:
            return self._with_first_key(setup, key, predicted)
        remaining = float(np.exp((self.keys[-1].time_ns - key.time_ns) * 1e-9 / setup.settling_s))
        prior = required(self.prior, "the window has no prior").with_process_noise(remaining, setup.extra_sigma)
        # The first keyframe has no predecessor, so it gets the motion of the second one.
        keys = (replace(self.keys[0], motion=key.motion),) if len(self.keys) == 1 else self.keys
        return replace(self, keys=(*keys, key), prior=prior)

    def _with_first_key(self, setup: Setup, key: KeyFrame, predicted: Array | None) -> StereoMap:
        pose, extra_sigma = key.left_from_world, setup.extra_sigma
        prior = anchored(pose.rotation, pose.translation, extra_sigma)
        if predicted is None:
            return replace(self, keys=(key,), prior=prior)
        covariance = np.diag(
            np.concatenate([np.full(POSE, HELD_SIGMA**2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** 2])
        )
        if self.covariance is not None:
            covariance[POSE:, POSE:] = self.covariance[-PAIR:, -PAIR:]
        hessian = np.linalg.inv(covariance)
        prior = replace(prior, extra=self.extra, hessian=hessian, sandwich=Sandwich(hessian, hessian))
        newest, start = covariance[:POSE, :POSE], SegmentStart(pose, predicted)
        return replace(self, keys=(key,), prior=prior, covariance=covariance, newest=newest, start=start)

    def emptied(self) -> StereoMap:
        """Returns the map without keyframes and points, but with the corrections of the pair and the noise."""
        covariance = None if self.covariance is None else self.covariance[-PAIR:, -PAIR:]
        return StereoMap(extra=self.extra, covariance=covariance, noise=self.noise)

    def extra_covariance(self, extra_sigma: Array) -> Array:
        """Returns the covariance (E, E) of `extra`: `extra_sigma` (E,) before an optimisation."""
        return np.diag(extra_sigma**2) if self.covariance is None else self.covariance[-PAIR:, -PAIR:]

    def variance_factor(self, noise: Noise) -> float:
        """Returns the factor of covariances that assumed the loss width as the noise of tracks."""
        return self.noise.variance(noise.sigma) / noise.width**2

    @property
    def newest_covariance(self) -> Array | None:
        """Returns the covariance (6, 6) of the newest pose (left twist) in the world; None before an optimisation."""
        if self.newest is None or not self.keys or self.start is None:
            return self.newest
        way = (self.keys[-1].left_from_world @ self.start.left_from_world.inverse()).adjoint
        return self.newest + way @ self.start.covariance @ way.T


@dataclass(frozen=True, eq=False)
class StereoLoops:
    """Loop closures, and the final odometry poses of the keyframes."""

    loops: Loops = Loops()
    keys: PersistentList[tuple[int, Pose]] = PersistentList()
    """Times and left_from_world of the keyframes that are no longer optimised, each once, by time."""

    def with_settled(self, settled: list[tuple[int, Pose]]) -> StereoLoops:
        """Adds keyframes that have left the window; skips those already here, which relocalisation may repeat."""
        keys = self.keys
        for time_ns, pose in settled:
            last = keys.part(len(keys) - 1, len(keys))
            if not last or last[0][0] < time_ns:
                keys = keys.appended((time_ns, pose))
        return replace(self, keys=keys)

    def key_pose(self, world: StereoMap, time_ns: int) -> Pose:
        """Returns left_from_world of the keyframe at `time_ns`."""
        for key in world.keys:
            if key.time_ns == time_ns:
                return key.left_from_world
        low, high = 0, len(self.keys)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.keys.part(middle, middle + 1)[0][0] <= time_ns else (low, middle)
        return self.keys.part(low, low + 1)[0][1]


@dataclass(frozen=True, eq=False)
class ModernStereoState:
    """The state of the estimator between frames."""

    last: LastPair
    map: StereoMap = StereoMap()
    next_id: int = 0
    lost_pairs: int = 0
    poses: PersistentList[tuple[int, int, Pose]] = PersistentList()
    """Time, time of the keyframe, and left_from_key of every localised frame."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Times and left_from_world of the keyframes that have left the window."""
    database: KeyframeDatabase = KeyframeDatabase()
    """The keyframes that relocalisation compares with."""
    level: Level = Level()
    """Whether the right images are level, and how they are corrected."""
    loops: StereoLoops = StereoLoops()
    """Loop closures and their corrections of the poses; all other fields are odometry without them."""

    def without_tracks(self, ids: NDArray[np.int64]) -> ModernStereoState:
        """Returns the state without these tracks (M,), see estimator.LeavesOut."""
        points = self.last.points.select(~np.isin(self.last.points.ids, ids))
        keys = tuple(key.only(~np.isin(key.ids, ids)) for key in self.map.keys)
        world = replace(self.map, keys=keys).only(points.ids)
        return replace(self, last=replace(self.last, points=points), map=world)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of one frame, from which its Step is made."""

    state: ModernStereoState
    """The state after the frame."""
    status: Status
    tracked: TrackingResult
    decisions: tuple[Decision, ...]
    tracked_points: PairPoints | None = None
    """The last frame's points that were tracked; None if the frame has no pose."""
    new_points: int = 0
    """Number of new points: the last ones in the state after the frame."""
    keyframe: bool = False
    restarted: bool = False
    """Whether the pose is only predicted: no observation links it to earlier frames."""
    other_motion: Tracks | None = None
    """Tracks that a second rigid motion explains; None if there is none."""
