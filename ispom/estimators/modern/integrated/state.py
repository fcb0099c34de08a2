"""What the modern integration remembers from exposure to exposure."""

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
    """Between two video frames."""
    metric: tuple[tuple[int, Pose], ...] = ()
    """The stereo estimator's poses in the window."""
    metric_covariance: Array | None = None
    """(6, 6) of the newest of them."""
    lens: tuple[Array, Array | None] | None = None
    """What the monocular method last found to be wrong with the video camera, and its covariance, as in JointWindow."""
    passed: int = 0
    """Pairs passed over since the last one that was taken."""
    apart: bool = False
    """Whether the stereo method began a new segment at one of these."""
    begun_ns: PersistentList[int] = PersistentList()
    """The pairs at which new segments began."""
    settled: PersistentList[tuple[int, Pose, bool]] = PersistentList()
    """Time, world_from_rig in the window's own world, whether of the video, of all exposures that have left it."""
