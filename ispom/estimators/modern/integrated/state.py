"""State of the integrated method between frames, and its settings."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ispom.estimators.frame_interval import FrameInterval
from ispom.estimators.modern.integrated.window import JointWindow, RigNoise, Table
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.types import Rig

MIN_POINTS = 8
"""Least number of known points for a resection: with fewer a frame is not localised by points."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Rig and settings; ModernIntegratedConfig describes the settings."""

    rig: Rig
    noise: RigNoise
    window_pairs: int
    max_views: int
    max_points: int
    knot_frames: float
    knot_misfit: float
    iterations: int
    follow_stereo: bool


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
    skipped: int = 0
    """Number of skipped pairs since the last used one."""
    stereo_restarted: bool = False
    """Whether the stereo method began a new segment at one of these."""
    begun_ns: PersistentList[int] = PersistentList()
    """Times of the pairs at which new segments began."""
    settled: PersistentList[tuple[int, Pose, bool]] = PersistentList()
    """All frames that have left the window: time, world_from_rig in the window's own world, and whether the frame is
    one of the video camera."""


def start_new_segment(state: ModernIntegratedState, time_ns: int) -> ModernIntegratedState:
    """Returns the state before a pair at this time that begins a segment: rig and lens estimates stay, poses and points
    do not. Of the views that leave, those with metric poses keep them."""
    window = state.window
    removed = [pose for view in window.views if view.located and view.metric for pose in view.poses()]
    return replace(
        state,
        window=_without_views(window),
        stereo_restarted=False,
        begun_ns=state.begun_ns.appended(time_ns),
        settled=state.settled.extended(removed),
    )


def _without_views(window: JointWindow) -> JointWindow:
    """Removes all views; the rig estimate from them becomes the prior."""
    prior = window.rig_estimates[-1:] if window.rig.free.any() else ()
    return replace(
        window,
        views=(),
        table=Table.empty(),
        rig_estimates=prior,
        truncated=bool(prior),
        knots=(),
        reference=None,
    )
