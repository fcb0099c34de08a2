"""Steps 1 to 3 of section 6.3 for one segment: from one stereo exposure to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper import checks
from ispom.estimators.paper.integrated.state import IntegratedState
from ispom.solvers.trajectory.interpolation import Interpolation, interpolate
from ispom.solvers.trajectory.segment import Segment, fit_rotations, fit_segment
from ispom.types import Decision, SegmentFit, Trajectory

DOUBTFUL_DEG = 10.0
"""The paper has no thresholds for how far a segment may be bent; this one only marks doubtful ones."""
DOUBTFUL_CHANGE = 20.0
"""[%] The same for how far its scale may be from the last segment's."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A segment's poses, and how they came about."""

    poses: Trajectory
    """world_from_video at the asked times, metric."""
    decisions: tuple[Decision, ...]
    fit: SegmentFit | None = None
    """None where the video's poses cannot be used: those of stereo are interpolated."""


def fitted(
    state: IntegratedState,
    metric: Trajectory,
    ends: tuple[int, int],
    times: NDArray[np.int64],
    interpolation: Interpolation,
    min_segment_m: float,
) -> Fitted:
    """At the times, with why.

    `metric`: world_from_video at the stereo exposures. Where the video's poses cannot be used those are interpolated.
    """
    fallback = interpolate(metric, times, "bspline")
    if unusable := _unusable(state, ends, times):
        return Fitted(fallback, (checks.VIDEO_COVERAGE.of(0, 1, f"{unusable}: stereo poses interpolated"),))
    covered = checks.VIDEO_COVERAGE.of(1, 1)
    start, end = metric.at(ends[0]), metric.at(ends[1])
    assert start is not None and end is not None
    own = interpolate(state.video, np.array(ends, np.int64), interpolation)  # step 1
    video = state.video.select(np.isin(state.video.times_ns, times))
    segment = fit_segment(video, own.pose(0), own.pose(1), start, end, ends, min_segment_m)  # steps 2 and 3
    length = float(np.linalg.norm(end.translation - start.translation))
    moved = checks.SEGMENT_LENGTH.of(length, min_segment_m, passed=segment is not None)
    around = SegmentFit(
        ends, _around(state.video, ends), own, Trajectory.of([(ends[0], start), (ends[1], end)], "video")
    )
    if segment is not None:
        fit = replace(around, scale=segment.scale, turn_rad=segment.turn_rad, residual_rad=segment.residual_rad)
        return Fitted(segment.poses, (covered, moved, *_bends(segment, state.scale)), fit)
    rotations, residual_rad = fit_rotations(video, own.pose(0), own.pose(1), start, end, ends)
    still = Trajectory(times, rotations, fallback.translations, "video")
    moved = replace(moved, consequence="positions come from the stereo poses alone")
    return Fitted(still, (covered, moved), replace(around, residual_rad=residual_rad))


def _around(video: Trajectory, ends: tuple[int, int]) -> Trajectory:
    """The poses inside a segment, and those that bracket its ends."""
    first = max(int(np.searchsorted(video.times_ns, ends[0], side="right")) - 1, 0)
    last = int(np.searchsorted(video.times_ns, ends[1]))
    return video.select(np.arange(first, min(last + 1, len(video))))


def _unusable(state: IntegratedState, ends: tuple[int, int], times: NDArray[np.int64]) -> str:
    """Why the video's poses cannot be used; empty where they can."""
    video = state.video
    if not len(video) or video.times_ns[0] > ends[0] or video.times_ns[-1] < ends[1]:
        return "no video poses on both sides"
    if not np.isin(times, video.times_ns).all():
        return "video frames without a pose"
    if any(video.times_ns[0] < t <= ends[1] for t in state.restarts_ns):
        return "a new monocular segment began inside"
    return ""


def _bends(segment: Segment, last_scale: float | None) -> tuple[Decision, ...]:
    """How far the video segment had to be bent, and its scale beside the last segment's."""
    turn, residual = np.degrees(segment.turn_rad), np.degrees(segment.residual_rad)
    change = () if last_scale is None else (100 * abs(segment.scale / last_scale - 1),)
    return (
        checks.SCALE_RATIO.of(segment.scale, 0.0),
        *(checks.SCALE_CHANGE.of(percent, DOUBTFUL_CHANGE) for percent in change),
        checks.SEGMENT_TURN.of(turn, DOUBTFUL_DEG),
        checks.END_ORIENTATION.of(residual, DOUBTFUL_DEG),
    )
