"""The state of the modern stereo estimator between frames, and the outcome of one frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import KeyframeDatabase
from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.pair import TrackingResult
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.types import Decision, Status, Tracks


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

    after: ModernStereoState
    status: Status
    sighting: TrackingResult
    decisions: tuple[Decision, ...]
    before: ModernStereoState | None = None
    """The state whose points were tracked; None if the frame has no pose."""
    fresh: int = 0
    """Number of new points: the last ones in the state after the frame."""
    key_frame: bool = False
    restarted: bool = False
    """Whether the pose is only predicted: no observation links it to earlier frames."""
    other_motion: Tracks | None = None
    """Tracks that a second rigid motion explains; None if there is none."""
