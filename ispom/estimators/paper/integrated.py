"""Integrated position and orientation: section 6.3 of Li, Liu and Yuan (2013).

Stereo is metric but slow; a single camera is fast but has no scale. C(j) are the stereo poses, C'(t) the video poses.
For each segment between two stereo frames j and j+1 (Figs. 6 and 7):

1. C' is interpolated at the times of both stereo frames: positions linearly or by a B-spline, rotations spherically.
2. The video's positions are scaled by |C(j) C(j+1)| / |C'(j) C'(j+1)|, and rotated about C(j) by the angle and axis
   between the two segment vectors, so that both ends coincide with the stereo positions.
3. The video's orientations are rotated so that the first one equals that of C(j); the rotation by which the last one
   then misses that of C(j+1) is spread over the segment.

Differences from the print: the stereo poses are carried to the video camera, not the video's poses to the rig, as the
lever arm cannot be applied while the scale is unknown. Where the video's poses cannot be used, the positions between
two pairs are interpolated. Of a segment that never ends only the newest MAX_FRAMES video poses are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import PER_UNIT, STEREO, VIDEO, Method, require_frame
from ispom.estimators.frame_interval import FrameInterval
from ispom.estimators.paper import checks
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range, checked
from ispom.solvers.trajectory.interpolation import Interpolation, interpolate
from ispom.solvers.trajectory.segment import Segment, fit_rotations, fit_segment
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Landmarks, Measurement, Rig, SegmentFit, Status, Step, Trajectory

MAX_RESTARTS = 8
"""Restarts of the video method that are remembered: one within a segment suffices to interpolate it."""
MAX_FRAMES = 600
"""Newest video poses of a segment without an end, in addition to those around its last pair (20 s at 30 Hz)."""
MARGIN_NS, MARGIN_FRAMES = 200_000_000, 2
"""Video poses are kept for this time, and at least this many frame intervals, before a segment: its start is
interpolated between them."""
DOUBTFUL_DEG = 10.0
"""Rotations of a segment above this are called doubtful. The paper has no such threshold."""
DOUBTFUL_CHANGE = 20.0
"""[%] Changes of scale from segment to segment above this are called unreliable. The paper has no such threshold."""


@dataclass(frozen=True)
class IntegratedConfig:
    """Settings of the integration (section 6.3)."""

    interpolation: Interpolation = "bspline"
    """How video positions are interpolated at the times of stereo frames. Rotations are interpolated spherically."""
    min_segment_m: Annotated[float, Range(0, 10)] = 0.02
    """A shorter segment gives no ratio of lengths: its positions come from the stereo poses alone."""

    max_waiting_pairs: Annotated[int, Range(1, 100)] = 12
    """Stereo pairs after a segment's end for which it waits for its video poses, as while the video initialises."""

    def build(self, rig: Rig) -> Integrated:
        return Integrated(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Integrated:
    """Gives each video frame a metric pose. World: the rig at the first stereo pair.

    Depends on a monocular method (role "video") and a stereo method (role "stereo").
    """

    rig: Rig
    config: IntegratedConfig

    def start(self) -> IntegratedState:
        return IntegratedState()

    def finish(self, state: IntegratedState, inputs: Mapping[str, Trajectory]) -> Trajectory:
        """Closes all segments that are still open with the video poses known by now; returns all poses of the rig."""
        while (closed := self._close(state)) is not None:
            state = closed[0]
        items = [item for piece in state.poses for item in piece.items()]
        ends = dict(state.metric)
        # A video frame at the very time of the last stereo frame lies inside the stereo span.
        items += [(t, ends[t]) for t in state.frames_ns if t == state.opened_ns]
        return Trajectory.of(items)

    def step(
        self, state: IntegratedState, exposure: Measurement, inputs: Mapping[str, Step]
    ) -> tuple[IntegratedState, Step]:
        """Processes one frame of either kind, and closes every segment that has become complete."""
        watch, is_stereo = Stopwatch(), require_frame(exposure, VIDEO | STEREO, rig=self.rig).kind in STEREO
        part = inputs["stereo" if is_stereo else "video"]
        revised, segments = [], list[SegmentFit]()
        decisions: list[Decision] = []
        if is_stereo:
            state = self._with_stereo_pose(state, part)
        else:
            state, decisions = self._with_video_pose(state, part)
        while self._is_complete(state) and (closed := self._close(state)) is not None:
            state, poses, fitted = closed
            revised += poses.items()
            decisions += fitted.decisions
            segments += [fitted.fit] if fitted.fit is not None else []
        pose = self._live_pose(state, exposure.time_ns)
        watch.lap("integrate")
        status = Status.TRACKING if pose else Status.INITIALISING if state.scale is None else Status.LOST
        return state, Step(
            exposure.time_ns,
            status,
            "rig",
            pose,
            key_frame=bool(revised),
            landmarks=Landmarks.empty() if is_stereo else self._landmarks(state, part, pose),
            revised=Trajectory.of(revised),
            scale=state.scale,
            seconds={**{f"{part.method}: {k}": v for k, v in part.seconds.items()}, **watch.seconds},
            decisions=tuple(decisions),
            parts=(part,),
            segments=tuple(segments),
            provisional=pose is not None and state.scale is None,
        )

    def _with_stereo_pose(self, state: IntegratedState, part: Step) -> IntegratedState:
        if part.world_from_frame is None:
            return state
        opened = part.time_ns if state.opened_ns is None else state.opened_ns
        metric = (*state.metric, (part.time_ns, part.world_from_frame))
        frames = tuple(t for t in state.frames_ns if t >= opened)
        return replace(state, metric=metric, opened_ns=opened, frames_ns=frames)

    def _with_video_pose(self, state: IntegratedState, part: Step) -> tuple[IntegratedState, list[Decision]]:
        """Adds one video frame; drops the middle of a segment that is longer than MAX_FRAMES."""
        state = replace(state, interval=state.interval.after(part.time_ns))
        since = (part.time_ns if state.opened_ns is None else state.opened_ns) - state.margin_ns
        frames_ns, decisions = (*(t for t in state.frames_ns if t >= since), part.time_ns), []
        until = recent = since
        if state.metric and len(frames_ns) > MAX_FRAMES:
            until, recent = state.metric[-1][0] + state.margin_ns, frames_ns[-MAX_FRAMES]
            frames_ns = tuple(t for t in frames_ns if t <= until or t >= recent)
            since_pair = sum(t > state.metric[-1][0] for t in frames_ns)
            if recent > until:
                why = "the oldest of them get no pose"
                decisions = [checks.OPEN_FRAMES.of(since_pair, MAX_FRAMES, why, False)]
        items = [*state.video.items(), *part.revised.items()]
        if part.world_from_frame is not None:
            items.append((part.time_ns, part.world_from_frame))
        poses = [(t, p) for t, p in items if t >= since and (t <= until or t >= recent)]
        restarts = (part.time_ns,) if part.restarted else ()
        after = replace(
            state,
            video=Trajectory.of(poses, "video"),
            final_until_ns=part.final_until_ns,
            restarts_ns=(*(t for t in state.restarts_ns if t >= since), *restarts)[-MAX_RESTARTS:],
            frames_ns=frames_ns,
        )
        return after, decisions

    def _span(self, state: IntegratedState) -> tuple[int, int] | None:
        """Returns start and end time of the open segment; None while it has no end."""
        later = [t for t, _ in state.metric if state.opened_ns is not None and t > state.opened_ns]
        return (state.opened_ns, later[0]) if later and state.opened_ns is not None else None

    def _is_complete(self, state: IntegratedState) -> bool:
        """Returns whether the video poses of the open segment are final, or have been waited for long enough."""
        span = self._span(state)
        if span is None:
            return False
        final = state.final_until_ns
        waiting = sum(t > span[1] for t, _ in state.metric)
        return (final is not None and final >= span[1]) or waiting >= self.config.max_waiting_pairs

    def _close(self, state: IntegratedState) -> tuple[IntegratedState, Trajectory, FittedSegment] | None:
        """Fits the open segment (steps 1 to 3); returns its poses of the rig and the fit. None while it has no end."""
        span = self._span(state)
        if span is None:
            return None
        times = np.array([t for t in state.frames_ns if span[0] <= t < span[1]], np.int64)
        metric = Trajectory.of(list(state.metric)).moved(right=self.rig.rig_from_video, frame="video")
        fitted = fit_video_to_stereo(state, metric, span, times, self.config.interpolation, self.config.min_segment_m)
        scale = fitted.fit.scale if fitted.fit is not None else None
        poses = fitted.poses.moved(right=self.rig.rig_from_video.inverse(), frame="rig")
        after = replace(
            state,
            opened_ns=span[1],
            metric=tuple(m for m in state.metric if m[0] >= span[0]),
            video=state.video.select(state.video.times_ns >= span[1] - state.margin_ns),
            frames_ns=tuple(t for t in state.frames_ns if t >= span[1]),
            scale=scale or state.scale,
            poses=state.poses.appended(poses) if len(poses) else state.poses,
        )
        about = f"{span[0] * 1e-9:.3f} to {span[1] * 1e-9:.3f} s"
        return after, poses, replace(fitted, decisions=tuple(replace(d, about=about) for d in fitted.decisions))

    def _live_pose(self, state: IntegratedState, time_ns: int) -> Pose | None:
        """Returns the last stereo pose, moved on by the video's motion in the scale of the last segment."""
        if not state.metric:
            return None
        last_ns, last = state.metric[-1]
        if last_ns == time_ns:
            return last
        now, video = state.video.at(time_ns), state.video
        if state.scale is None or now is None or video.times_ns[0] > last_ns:
            return None
        own = interpolate(video, np.array([last_ns], np.int64), self.config.interpolation).pose(0)
        motion = (own.inverse() @ now).scaled(state.scale)
        return last @ self.rig.rig_from_video @ motion @ self.rig.rig_from_video.inverse()

    def _landmarks(self, state: IntegratedState, part: Step, pose: Pose | None) -> Landmarks:
        """Returns the video's points, made metric by the scale of the last segment."""
        video = part.world_from_frame
        if not len(part.landmarks) or pose is None or state.scale is None or video is None:
            return Landmarks.empty()
        in_video = state.scale * video.inverse().apply(part.landmarks.xyz_in_world)
        return replace(part.landmarks, xyz_in_world=(pose @ self.rig.rig_from_video).apply(in_video))


# State: what is kept from frame to frame


@dataclass(frozen=True, eq=False)
class IntegratedState:
    """What is kept from frame to frame."""

    metric: tuple[tuple[int, Pose], ...] = ()
    """(time_ns, world_from_rig) of the stereo poses, beginning with the last one before the open segment."""
    opened_ns: int | None = None
    """Start time of the open segment."""
    video: Trajectory = field(default_factory=lambda: Trajectory.empty("video"))
    """Video poses in their own world and unit, from shortly before the open segment on."""
    final_until_ns: int | None = None
    """Video poses before this time will not be revised any more."""
    restarts_ns: tuple[int, ...] = ()
    """Start times of the video method's segments, from shortly before the open segment on."""
    frames_ns: tuple[int, ...] = ()
    """Times of the video frames from the open segment on, with a pose or without."""
    interval: FrameInterval = FrameInterval()
    """Interval between video frames."""
    scale: float | None = None
    """Metres per unit of the video in the last closed segment."""
    poses: PersistentList[Trajectory] = PersistentList()
    """world_from_rig at the video frames of the closed segments."""

    @property
    def margin_ns(self) -> int:
        """Returns the time before a segment for which video poses are kept."""
        return max(MARGIN_NS, MARGIN_FRAMES * (self.interval.median_ns or 0))


# Steps 1 to 3 for one segment


@dataclass(frozen=True, eq=False)
class FittedSegment:
    """The metric poses of one segment, and how they were obtained."""

    poses: Trajectory
    """world_from_video at the video frames, metric."""
    decisions: tuple[Decision, ...]
    fit: SegmentFit | None = None
    """None where the video's poses cannot be used and the stereo poses were interpolated."""


def fit_video_to_stereo(
    state: IntegratedState,
    metric: Trajectory,
    span_ns: tuple[int, int],
    times_ns: NDArray[np.int64],
    interpolation: Interpolation,
    min_segment_m: float,
) -> FittedSegment:
    """Fits the video's poses at `times_ns` (N,) to the stereo poses at both ends of the span.

    `metric`: world_from_video at the stereo frames. They are interpolated where the video's poses cannot be used.
    Raises ValueError where there is no stereo pose at an end.
    """
    fallback = interpolate(metric, times_ns, "bspline")
    if unusable := _why_unusable(state, span_ns, times_ns):
        return FittedSegment(fallback, (checks.VIDEO_COVERAGE.of(0, 1, f"{unusable}: stereo poses interpolated"),))
    covered = checks.VIDEO_COVERAGE.of(1, 1)
    start, end = metric.at(span_ns[0]), metric.at(span_ns[1])
    if start is None or end is None:
        raise ValueError(f"no stereo pose at {span_ns[0]} ns or {span_ns[1]} ns")
    own = interpolate(state.video, np.array(span_ns, np.int64), interpolation)  # step 1
    video = state.video.select(np.isin(state.video.times_ns, times_ns))
    segment = fit_segment(video, own.pose(0), own.pose(1), start, end, span_ns, min_segment_m)  # steps 2 and 3
    length_m = float(np.linalg.norm(end.translation - start.translation))
    has_moved = checks.SEGMENT_LENGTH.of(length_m, min_segment_m, passed=segment is not None)
    ends = Trajectory.of([(span_ns[0], start), (span_ns[1], end)], "video")
    fit = SegmentFit(span_ns, _bracketing(state.video, span_ns), own, ends)
    if segment is not None:
        fit = replace(fit, scale=segment.scale, turn_rad=segment.turn_rad, residual_rad=segment.residual_rad)
        return FittedSegment(segment.poses, (covered, has_moved, *_checks_of(segment, state.scale)), fit)
    rotations, residual_rad = fit_rotations(video, own.pose(0), own.pose(1), start, end, span_ns)  # step 3 alone
    at_rest = Trajectory(times_ns, rotations, fallback.translations, "video")
    has_moved = replace(has_moved, consequence="positions come from the stereo poses alone")
    return FittedSegment(at_rest, (covered, has_moved), replace(fit, residual_rad=residual_rad))


def _bracketing(video: Trajectory, span_ns: tuple[int, int]) -> Trajectory:
    """Returns the poses inside a segment, and those that bracket its ends."""
    first = max(int(np.searchsorted(video.times_ns, span_ns[0], side="right")) - 1, 0)
    last = int(np.searchsorted(video.times_ns, span_ns[1]))
    return video.select(np.arange(first, min(last + 1, len(video))))


def _why_unusable(state: IntegratedState, span_ns: tuple[int, int], times_ns: NDArray[np.int64]) -> str:
    """Returns why the video's poses cannot be used; an empty text where they can."""
    video = state.video
    if not len(video) or video.times_ns[0] > span_ns[0] or video.times_ns[-1] < span_ns[1]:
        return "no video poses on both sides"
    if not np.isin(times_ns, video.times_ns).all():
        return "video frames without a pose"
    if any(video.times_ns[0] < t <= span_ns[1] for t in state.restarts_ns):
        return "a new monocular segment began inside"
    return ""


def _checks_of(segment: Segment, last_scale: float | None) -> tuple[Decision, ...]:
    """Checks the rotations of the segment, and its scale against that of the last one."""
    rotation, residual = np.degrees(segment.turn_rad), np.degrees(segment.residual_rad)
    change = () if last_scale is None else (100 * abs(segment.scale / last_scale - 1),)
    return (
        checks.SCALE_RATIO.of(segment.scale, 0.0),
        *(checks.SCALE_CHANGE.of(percent, DOUBTFUL_CHANGE) for percent in change),
        checks.SEGMENT_TURN.of(rotation, DOUBTFUL_DEG),
        checks.END_ORIENTATION.of(residual, DOUBTFUL_DEG),
    )


METHOD = Method(
    "integrated.paper",
    VIDEO | STEREO,
    IntegratedConfig,
    "metric",
    "Li, Liu and Yuan 2013, section 6.3",
    PER_UNIT,
    {"video": "monocular.paper", "stereo": "stereo.paper"},
    checks.INTEGRATED,
    checks.INTEGRATED_STAGES,
)
