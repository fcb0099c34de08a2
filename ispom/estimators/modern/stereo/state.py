"""What the modern stereo estimator remembers from pair to pair, and what one pair leads to."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    loops: Loops = Loops()
    keys: PersistentList[tuple[int, Pose]] = PersistentList()
    """Time and left_from_world of the key frames that nothing adjusts any more, each once, by time."""

    def with_settled(self, settled: list[tuple[int, Pose]]) -> StereoLoops:
        """With those that have left the window; not with what was told before, of a key frame that was found again."""
        keys = self.keys
        for time_ns, pose in settled:
            last = keys.part(len(keys) - 1, len(keys))
            if not last or last[0][0] < time_ns:
                keys = keys.appended((time_ns, pose))
        return replace(self, keys=keys)

    def key_pose(self, world: StereoMap, time_ns: int) -> Pose:
        """left_from_world of a key frame."""
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
    last: LastPair
    map: StereoMap = StereoMap()
    next_id: int = 0
    lost_pairs: int = 0
    poses: PersistentList[tuple[int, int, Pose]] = PersistentList()
    """Time, the key frame's time, left_from_key of every located pair."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """left_from_world of the key frames that have left the window."""
    database: KeyframeDatabase = KeyframeDatabase()
    """Where a lost pair is looked for."""
    loops: StereoLoops = StereoLoops()
    """Where a way came back, and what follows for the poses; all else here is odometry without it."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one pair led to; the rest of the Step follows from it."""

    after: ModernStereoState
    status: Status
    sighting: TrackingResult
    decisions: tuple[Decision, ...]
    before: ModernStereoState | None = None
    """Whose points were followed; None where the pair has no pose."""
    fresh: int = 0
    """New points: the last ones in the state after it."""
    key_frame: bool = False
    restarted: bool = False
    """Its place is the predicted one: no observation joins it to the pairs before."""
    other_motion: Tracks | None = None
    """What one other motion explains; None where it is not told of one."""
