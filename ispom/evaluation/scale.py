"""The scale of a trajectory without metric scale: its drift along the path, and a placement for drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Rig, Trajectory

CHORDS = 40
"""Number of chords of equal true path length."""
WINDOWS = 10
"""Number of windows, each with the median of CHORDS / WINDOWS chords, which is robust to noise and shake."""


@dataclass(frozen=True)
class StepScale:
    """Estimated over true length along the path, relative to its start (Fig. 8, line B: it shrinks)."""

    windows: tuple[float, ...]
    """Scale in ten windows of equal true length along the path, relative to the first one."""

    first: float
    """The ratio in the first window: units of the estimate per unit of the ground truth."""
    middles_ns: tuple[int, ...]
    """Start time of each window's middle chord."""

    @property
    def end_over_start(self) -> float:
        return self.windows[-1]


def step_scale(estimate: Trajectory, truth: Trajectory) -> StepScale | None:
    """Compares 40 chords of equal true path length; the median of each window's four is robust to noise and shake.

    Both hold associated positions of the same camera. None where the path is too short for that, or the estimate
    does not move at its beginning.
    """
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(truth.translations, axis=0), axis=1))])
    if len(truth) <= CHORDS or travelled[-1] == 0:
        return None
    ends = np.unique(np.searchsorted(travelled, np.linspace(0, travelled[-1], CHORDS + 1)).clip(0, len(truth) - 1))
    own, true = (np.linalg.norm(np.diff(t.translations[ends], axis=0), axis=1) for t in (estimate, truth))
    ratios, starts_ns = own[true > 0] / true[true > 0], truth.times_ns[ends[:-1]][true > 0]
    if len(ratios) < WINDOWS:
        return None
    windows = np.array_split(np.arange(len(ratios)), WINDOWS)
    medians = np.array([np.median(ratios[window]) for window in windows])
    if medians[0] <= 0:
        return None
    middles_ns = tuple(int(starts_ns[window[len(window) // 2]]) for window in windows)
    return StepScale(tuple((medians / medians[0]).tolist()), float(medians[0]), middles_ns)


def first_segment_placement(
    video: Trajectory, stereo: Trajectory, rig: Rig, scale: float | None = None
) -> Similarity | None:
    """Returns stereo_world_from_video_world from the first stereo segment that the video poses span.

    `video` is world_from_FRAME in its own unit, `stereo` world_from_rig in metres. The pose at the segment's start
    coincides, the distance to its end gives the scale unless it is known; nothing later is used, so that drift shows.
    None while no segment is spanned, or where it has no length.
    """
    if len(video) < 2:
        return None
    inside = (stereo.times_ns >= video.times_ns[0]) & (stereo.times_ns <= video.times_ns[-1])
    ends = np.flatnonzero(inside)[:2]
    if len(ends) < 2:
        return None
    metric = stereo.select(ends).moved(right=rig.rig_from(video.frame))
    own = interpolate(video, metric.times_ns, "bspline")
    metric_length, own_length = metric.length, own.length
    if own_length < 1e-9 or metric_length < 1e-9:
        return None
    scale = metric_length / own_length if scale is None else scale
    own_start = own.pose(0)
    moved = metric.pose(0) @ Pose(own_start.rotation, scale * own_start.translation).inverse()
    return Similarity(scale, moved)
