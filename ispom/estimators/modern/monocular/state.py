"""State of the modern monocular estimator between frames, and the outcome of a frame."""

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
class BeforeMap:
    """What a map replaced or added to, so that it can be taken back."""

    start: Start
    settled: PersistentList[tuple[int, Pose]]
    database: KeyframeDatabase
    loops: Loops


@dataclass(frozen=True, eq=False)
class ModernMonocularState:
    live: LiveTracks = LiveTracks()
    sights: tuple[Sight, ...] = ()
    """Tracks of the frame before that of `live`, and of the frames of the first map; none for a global shutter."""
    start: Start | None = None
    """The initialisation, while there is no map."""
    map: Map | None = None
    recent: tuple[tuple[int, Pose], ...] = ()
    """The last two poses, for the motion model."""
    missed: int = 0
    """Number of frames since the last pose."""
    uncertainty: MapUncertainty | None = None
    """Uncertainty of the map, since the last keyframe."""
    depth_sigmas: tuple[float, ...] = ()
    """`uncertainty.depth_sigma` at the last keyframes, as many as the window has."""
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
    loops: Loops = Loops()
    """Loop closures and their corrections; everything else here is odometry without them."""
    outlier_tracks: OutlierTracks = OutlierTracks()
    """Outliers of the last poses, tracked further; they do not affect the pose."""
    agreeing: tuple[tuple[float, bool], ...] = ()
    """For the last frames localised in the map: share of its points that agreed with it, and whether it is a keyframe;
    see `agreement`."""
    before_map: BeforeMap | None = None
    """While the map is young and may be taken back."""

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
class NewImage:
    """An image with the tracks in it, before it is localised."""

    time_ns: int
    grey: Image
    predicted: Pose | None
    """world_from_camera by the motion model; None without a map."""
    followed: Followed
    scene: Array
    """(N, 3) points of the tracks, those untriangulated at a guessed depth; NaN without a map."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of one frame, from which its Step is built."""

    followed: Followed
    status: Status
    pose: Pose | None = None
    map: Map | None = None
    start: Start | None = None
    key_frame: bool = False
    restarted: bool = False
    """Whether a segment begins here: no observation connects position, rotation or scale to the frames before."""
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
    """Those of the outlier tracks that one other motion explains; None if no motion was searched."""
