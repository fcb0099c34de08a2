"""What the paper's integration remembers from exposure to exposure."""

from __future__ import annotations

from dataclasses import dataclass, field

from ispom.estimators.frame_interval import FrameInterval
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.types import Trajectory

MARGIN_NS, MARGIN_FRAMES = 200_000_000, 2
"""Video poses this long, and at least so many intervals, before a segment are kept: it is interpolated at its start."""


@dataclass(frozen=True, eq=False)
class IntegratedState:
    metric: tuple[tuple[int, Pose], ...] = ()
    """(time_ns, world_from_rig) of the stereo poses from the one before the open segment on."""
    opened_ns: int | None = None
    """Where the open segment begins."""
    video: Trajectory = field(default_factory=lambda: Trajectory.empty("video"))
    """Video poses, own world and unit, from shortly before the open segment on."""
    final_until_ns: int | None = None
    """Video poses before this time will not be revised any more."""
    restarts_ns: tuple[int, ...] = ()
    """When the video's world began anew, from shortly before the open segment on."""
    frames_ns: tuple[int, ...] = ()
    """Video exposures from the open segment on, with a pose or without."""
    interval: FrameInterval = FrameInterval()
    """Of the video."""
    scale: float | None = None
    """Metres per unit in the last closed segment."""
    poses: PersistentList[Trajectory] = PersistentList()
    """world_from_rig at the video exposures of the closed segments."""

    @property
    def margin_ns(self) -> int:
        """How long before a segment video poses are kept."""
        return max(MARGIN_NS, MARGIN_FRAMES * (self.interval.median_ns or 0))
