"""State of the modern integration between frames."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.estimators.frame_interval import FrameInterval
from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList


@dataclass(frozen=True, eq=False)
class ModernIntegratedState:
    window: JointWindow
    interval: FrameInterval = FrameInterval()
    """Interval between two video frames."""
    metric: tuple[tuple[int, Pose], ...] = ()
    """The stereo estimator's poses in the window."""
    metric_covariance: Array | None = None
    """(6, 6) covariance of the newest of them."""
    lens: tuple[Array, Array | None] | None = None
    """Latest lens correction of the video camera by the monocular method, and its covariance, as in JointWindow."""
    passed: int = 0
    """Number of skipped pairs since the last used one."""
    apart: bool = False
    """Whether the stereo method began a new segment at one of these."""
    begun_ns: PersistentList[int] = PersistentList()
    """Times of the pairs at which new segments began."""
    settled: PersistentList[tuple[int, Pose, bool]] = PersistentList()
    """Time, world_from_rig in the window's own world, and whether of the video, of all frames that have left the
    window."""
