"""State of the modern monocular estimator between frames, and the outcome of a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.tracks import LiveTracks, OutlierTracks, TrackingResult
from ispom.estimators.modern.monocular.worlds import Worlds
from ispom.estimators.modern.rolling import RollingTracks
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.solvers.multiview.rotation import TURN_LOSS, dominant_rotation
from ispom.solvers.window.prior import LENS
from ispom.types import Decision, Image, Status, Tracks

NEWEST_FRAMES, MAX_FRAMES = 40, 120
"""Number of the newest frames, which are all stored, and largest number of frames; older ones are thinned out."""
MIN_POINTS = 40
"""Least number of points of a map: it must last until the next keyframe, with a third of them lost."""
MIN_SHARED = 8
"""Least number of points that determine a rotation, or transfer the scale of an old map to a new one."""


@dataclass(frozen=True, eq=False)
class Start:
    """Frames since the reference, which has the pose `base`."""

    frames: tuple[TrackedFrame, ...] = ()
    """The first is the reference. Each has its held pose: its own rotation, the position of the reference."""
    base: Pose = Pose()
    depth: float | None = None
    """Median depth of the scene before the loss, which the new map gets, too: its unit is free, and with the same depth
    both maps can be shown together. None without a map before: the first baseline is the unit then."""
    points: ScenePoints = ScenePoints()
    """Points of the map before the loss: surviving tracks transfer the scale."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """Prior standard deviations of the lens corrections."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) covariance of the base in the world before the loss; zero if the base is the world."""
    coasting: Callable[[int], Pose] | None = None
    """Predicts the pose, by time, from the motion before the loss, while nothing is observed."""
    joined: bool = True
    """Whether tracks connect the rotation of the reference to the frames before, and points of the map before a loss
    the scale; otherwise a new segment begins there."""
    lost: Map | None = None
    """The map before the loss, without its keyframes and points: frames may still be relocalised in its keyframes."""
    rolling_tracks: tuple[RollingTracks, ...] = ()
    """Tracks of the frames except the last one; none for a global shutter."""
    earlier: tuple[TrackedFrame, ...] = ()
    """Frames before the reference, of restarted initialisations: too few of their points survived for a map, but the
    map may localise them."""
    passed: PersistentList[tuple[int, Pose]] = PersistentList()
    """Held poses of frames that are no longer stored; they are interpolated once there is a map."""
    taken_back: bool = False
    """Whether a map of this initialisation was wrong and taken back."""
    before_loss: ModernMonocularState | None = None
    """The state before the loss, with which the next frames are tried, too; None without a loss, or long after it."""

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Start:
        """Adds tracks that start in the reference, while that is the only frame."""
        return replace(self, frames=(self.frames[0].with_new(ids, x),))

    def with_rolling_tracks(self, last: RollingTracks) -> Start:
        """Adds the tracks of the last frame, and removes those of frames that are no longer stored."""
        kept = {f.time_ns for f in self.frames}
        return replace(self, rolling_tracks=tuple(t for t in (*self.rolling_tracks, last) if t.time_ns in kept))

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> Start:
        """Replaces the coordinates (M, 2) of tracks (M,) in the frame at this time, if there is one."""

        def placed(frames: tuple[TrackedFrame, ...]) -> tuple[TrackedFrame, ...]:
            return tuple(f.with_updated_coordinates(ids, x) if f.time_ns == time_ns else f for f in frames)

        return replace(self, earlier=placed(self.earlier), frames=placed(self.frames))

    @property
    def requires_full_parallax(self) -> bool:
        """Whether no map is made with less parallax, though points leave the image: the one before was wrong. If all of
        them leave, the next reference has the usual limits, as a turning camera might never have a map."""
        return self.taken_back and not self.earlier

    @property
    def held(self) -> tuple[tuple[int, Pose], ...]:
        """The held poses of all frames, unordered; none after a loss if the camera may have moved: its position is then
        unknown."""
        if self.moves:
            return ()
        return (*self.passed, *held_poses((*self.earlier, *self.frames)))

    @property
    def moves(self) -> bool:
        """Whether the camera was lost in motion, so that no position can be held."""
        return self.depth is not None and not self.joined

    def limited(self) -> Start:
        """Removes a frame if there are too many: of the older ones, that with the nearest neighbours in time."""
        frames, reference = (*self.earlier, *self.frames), len(self.earlier)
        if len(frames) <= MAX_FRAMES:
            return self
        times_ns = np.array([f.time_ns for f in frames])
        apart_ns = times_ns[2 : 1 - NEWEST_FRAMES] - times_ns[: -1 - NEWEST_FRAMES]
        inner = np.arange(1, len(apart_ns) + 1)
        gone = int(inner[np.argmin(np.where(inner == reference, np.iinfo(np.int64).max, apart_ns))])
        passed = self.passed.extended(held_poses((frames[gone],)))
        kept, first = (*frames[:gone], *frames[gone + 1 :]), reference - (gone < reference)
        return replace(self, earlier=kept[:first], frames=kept[first:], passed=passed)

    def restarted(self, frame: TrackedFrame, width: float) -> tuple[Start, tuple[tuple[int, Pose], ...]]:
        """Makes this frame the reference; keeps the rotation so far.

        Also returns the held poses of the frames before it, if no observation connects it to them. `width` of the
        robust loss, normalised.
        """
        last = self.frames[-1]
        ids = np.intersect1d(last.ids, frame.ids, assume_unique=True)
        base = last.world_from_camera or self.base
        # Frames without observations have no pose that could be connected.
        shared = len(ids) >= MIN_SHARED or len(last.ids) < MIN_SHARED
        same_unit = self.lost is None or self.points.count(frame.ids) >= MIN_SHARED
        if len(ids) >= MIN_SHARED:
            turn = dominant_rotation(last.at(ids), frame.at(ids), TURN_LOSS * width)
            base = Pose(base.rotation @ turn.T, base.translation)
        elif self.coasting is not None and len(self.frames) == 1:
            base = self.coasting(frame.time_ns)
        frames = (replace(frame, world_from_camera=base),)
        new = replace(self, frames=frames, base=base, joined=self.joined and shared and same_unit)
        if not shared:
            return replace(new, earlier=(), passed=PersistentList()), self.held
        return replace(new, earlier=(*self.earlier, *self.frames)).limited(), ()


def held_poses(frames: tuple[TrackedFrame, ...]) -> tuple[tuple[int, Pose], ...]:
    """Returns the held poses of frames with enough observations for a rotation."""
    return tuple((f.time_ns, f.world_from_camera) for f in frames if f.world_from_camera and len(f.ids) >= MIN_SHARED)


@dataclass(frozen=True, eq=False)
class LostFrame:
    """A frame without a pose, which may be localised later."""

    time_ns: int
    grey: Image
    segment: int
    """The segment in which it was lost."""
    tries: int = 0
    """How many times it was tried again."""


@dataclass(frozen=True, eq=False)
class BeforeMap:
    """The state before a map replaced it or was added to it, so that the map can be discarded."""

    start: Start
    settled: PersistentList[tuple[int, Pose]]
    database: KeyframeDatabase
    loops: Loops


@dataclass(frozen=True, eq=False)
class ModernMonocularState:
    live: LiveTracks = LiveTracks()
    rolling_tracks: tuple[RollingTracks, ...] = ()
    """Tracks of the frame before that of `live`, and of the frames of the first map; none for a global shutter."""
    start: Start | None = None
    """The initialisation, while there is no map."""
    map: Map | None = None
    recent: tuple[tuple[int, Pose], ...] = ()
    """The last two poses, for the motion model."""
    missed: int = 0
    """Number of frames since the last pose."""
    last_localised: Keyframe | None = None
    """The last localised image, described for the comparison with frames since."""
    uncertainty: MapUncertainty | None = None
    """Uncertainty of the map, since the last keyframe."""
    depth_sigmas: tuple[float, ...] = ()
    """`uncertainty.depth_sigma` at the last keyframes, as many as the window has, since the unit was defined: by a
    first map, by recognised keyframes, or at the begin of a segment."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) covariance of the last pose."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Poses that are final."""
    database: KeyframeDatabase = KeyframeDatabase()
    """Keyframes for relocalisation."""
    segments: int = 1
    """Number of segments so far."""
    segment: int = 0
    """The segment in whose world the last pose is."""
    worlds: Worlds = Worlds()
    """Joins of segments with earlier ones; everything else here is in the world of the segment."""
    loops: Loops = Loops()
    """Loop closures and their corrections; everything else here is odometry without them."""
    outlier_tracks: OutlierTracks = OutlierTracks()
    """Outliers of the last poses, tracked further; they do not affect the pose."""
    agreeing: tuple[tuple[float, bool], ...] = ()
    """For the last frames localised in the map: share of its points that agreed with it, and whether it is a keyframe;
    see `agreement`."""
    before_map: BeforeMap | None = None
    """While the map is young and may be taken back."""
    lost_frames: tuple[LostFrame, ...] = ()
    """Lost frames that are tried again at later keyframes, the last ones first."""

    def without_tracks(self, ids: NDArray[np.int64]) -> ModernMonocularState:
        """Returns the state without these tracks (M,), see estimator.LeavesOut."""
        live, ids = self.live.only(~np.isin(self.live.ids, ids)), np.sort(ids)
        if self.map is None:
            return replace(self, live=live)
        keys = tuple(key.without(ids) for key in self.map.keys)
        return replace(self, live=live, map=replace(self.map.without(ids), keys=keys))

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> ModernMonocularState:
        """Replaces the coordinates (M, 2) of tracks (M,) in the frame at this time, if it is stored."""
        if self.map is not None:
            return replace(self, map=self.map.with_updated_coordinates(time_ns, ids, x))
        return self if self.start is None else replace(self, start=self.start.with_updated_coordinates(time_ns, ids, x))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of one frame, from which its Step is built."""

    tracked: TrackingResult
    status: Status
    pose: Pose | None = None
    map: Map | None = None
    start: Start | None = None
    key_frame: bool = False
    restarted: bool = False
    """Whether a segment begins here: no observation connects position, rotation or scale to the frames before."""
    segment_from_ns: int | None = None
    """Time of the segment's first frame, if it is an earlier one."""
    segment: int | None = None
    """The earlier segment in whose world the frame was relocalised; None if it stays in its own."""
    decisions: tuple[Decision, ...] = ()
    residual_px: NDArray[np.float32] | None = None
    """(N,) residuals of the tracks [px]; NaN for those not used."""
    inliers: NDArray[np.bool_] | None = None
    """(N,) the tracks that the pose used, as the check `pose_points` counts them; None without a pose in a map."""
    covariance: Array | None = None
    uncertainty: MapUncertainty | None = None
    """Uncertainty of a map that is new, or was optimised."""
    scale: float | None = None
    settled: tuple[tuple[int, Pose], ...] = ()
    missed: int = 0
    compared: NDArray[np.bool_] | None = None
    """(N,) which tracks were aligned with the patch of their origin; None without a map, when origins do not change."""
    outlier_tracks: OutlierTracks = OutlierTracks()
    other_motion: Tracks | None = None
    """The outlier tracks that one other motion explains; None if no motion was searched."""
