"""What the modern monocular estimator remembers from frame to frame, and what one frame leads to."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import KeyframeDatabase
from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.outlier_tracks import OutlierTracks
from ispom.estimators.modern.monocular.start import Start
from ispom.estimators.modern.monocular.tracks import Followed, LiveTracks
from ispom.estimators.modern.rolling import Sight
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.types import Decision, Image, Status, Tracks


@dataclass(frozen=True, eq=False)
class ModernMonocularState:
    live: LiveTracks = LiveTracks()
    sights: tuple[Sight, ...] = ()
    """Of the frame before that of `live`, and of all that the map was begun with; none unless the shutter rolls."""
    start: Start | None = None
    """While there is no map."""
    map: Map | None = None
    recent: tuple[tuple[int, Pose], ...] = ()
    """The last two poses, for the motion model."""
    missed: int = 0
    """Frames since the last pose."""
    uncertainty: MapUncertainty | None = None
    """Of the map, since the last key frame."""
    depth_sigmas: tuple[float, ...] = ()
    """`uncertainty.depth_sigma` at the last key frames, as many as the window has."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) of the last pose."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Poses that nothing will revise."""
    database: KeyframeDatabase = KeyframeDatabase()
    """Where a lost frame is looked for."""
    segments: int = 1
    """How many have begun."""
    segment: int = 0
    """The first one that has the world of the last pose."""
    loops: Loops = Loops()
    """Where a way came back, and what follows for the poses; all else here is odometry without it."""
    outlier_tracks: OutlierTracks = OutlierTracks()
    """What the poses of the last images do not explain; it steers nothing."""

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> ModernMonocularState:
        """With tracks (M,) at other coordinates (M, 2) in the frame of that time, where it is kept."""
        if self.map is not None:
            return replace(self, map=self.map.with_updated_coordinates(time_ns, ids, x))
        return self if self.start is None else replace(self, start=self.start.with_updated_coordinates(time_ns, ids, x))


@dataclass(frozen=True, eq=False)
class NewImage:
    """An image with the tracks followed into it, before it is known where it was taken."""

    time_ns: int
    grey: Image
    predicted: Pose | None
    """world_from_camera by the motion model; None without a map."""
    followed: Followed
    scene: Array
    """(N, 3) scene points of the tracks, those without a place at a guessed depth; NaN without a map."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one frame led to; the rest of the Step follows from it."""

    followed: Followed
    status: Status
    pose: Pose | None = None
    map: Map | None = None
    start: Start | None = None
    key_frame: bool = False
    restarted: bool = False
    """A segment begins here: no observation tells where it is, how it is turned, or what its unit is against the
    frames before."""
    segment: int | None = None
    """The earlier segment in whose world the frame was found; None where it stays in its own."""
    decisions: tuple[Decision, ...] = ()
    residual_px: NDArray[np.float32] | None = None
    """(N,) of the tracks followed; NaN where one took no part."""
    covariance: Array | None = None
    uncertainty: MapUncertainty | None = None
    """Of a map that is new, or was adjusted."""
    scale: float | None = None
    settled: tuple[tuple[int, Pose], ...] = ()
    missed: int = 0
    compared: NDArray[np.bool_] | None = None
    """(N,) which tracks were found by the patch of their origin; None while there is no map: then origins stay."""
    outlier_tracks: OutlierTracks = OutlierTracks()
    other_motion: Tracks | None = None
    """Of these, what one other motion explains; None where that was not looked for."""
