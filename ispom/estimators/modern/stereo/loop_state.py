"""What the stereo estimator remembers for loops, beside its odometry."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList


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
