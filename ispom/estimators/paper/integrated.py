"""Integrated (section 6.3): video poses between two stereo exposures, scaled and turned to fit both.

Where this differs from the print: stereo poses are carried to the video camera, not video poses to the rig, as the
lever arm cannot be applied in a unit that is not known yet; where the video's poses cannot be used, positions between
two pairs are interpolated; of a segment that never ends only the newest MOST_FRAMES video poses are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.frame_interval import FrameInterval
from ispom.estimators.paper import checks
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.solvers.interpolation import Interpolation, interpolate
from ispom.solvers.segment import Segment, fit_rotations, fit_segment
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Exposure, Landmarks, Rig, Status, Step, StereoPair, Trajectory

MARGIN_NS, MARGIN_FRAMES = 200_000_000, 2
"""Video poses this long, and at least so many intervals, before a segment are kept: it is interpolated at its start."""
MOST_RESTARTS = 8
"""Of the video's world within a segment: one is enough to give its poses up."""
MOST_FRAMES = 600
"""Of a segment without an end the newest video poses, and those about its last pair, are kept; the others get none."""


@dataclass(frozen=True)
class IntegratedConfig:
    """Settings of the integration (section 6.3)."""

    interpolation: Interpolation = "bspline"
    """Of video positions at stereo exposures; rotations are interpolated spherically."""
    min_segment_m: Annotated[float, Range(0, 10)] = 0.02
    """A shorter segment gives no ratio of lengths: its positions come from the stereo poses alone."""

    max_waiting_pairs: Annotated[int, Range(1, 100)] = 12
    """Stereo pairs after a segment's end that its video poses are waited for, as while the video initialises."""

    def build(self, rig: Rig) -> Integrated:
        return Integrated(rig, self)


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


@dataclass(frozen=True, eq=False)
class Integrated:
    """Metric at video rate. World: the rig at the first stereo pair. Asks a monocular and a stereo method."""

    rig: Rig
    config: IntegratedConfig

    def start(self) -> IntegratedState:
        return IntegratedState()

    def finish(self, state: IntegratedState, asked: Mapping[str, Trajectory]) -> Trajectory:
        """All closed segments, and those still open closed with the video poses known by now."""
        while (closed := self._close(state)) is not None:
            state = closed[0]
        items = [item for piece in state.poses for item in piece.items()]
        ends = dict(state.metric)
        # A video frame at the very time of the last stereo exposure lies inside the stereo span.
        items += [(t, ends[t]) for t in state.frames_ns if t == state.opened_ns]
        return Trajectory.of(items)

    def step(
        self, state: IntegratedState, exposure: Exposure, asked: Mapping[str, Step]
    ) -> tuple[IntegratedState, Step]:
        """One exposure of either kind; closes every segment that has become complete."""
        watch, stereo = Stopwatch(), isinstance(exposure, StereoPair)
        part = asked["stereo" if stereo else "video"]
        revised, decisions = [], []
        if stereo:
            state = self._with_metric(state, part)
        else:
            state, decisions = self._with_video(state, part)
        while self._complete(state) and (closed := self._close(state)) is not None:
            state, piece, why = closed
            revised += piece.items()
            decisions += why
        pose = self._live(state, exposure.time_ns)
        watch.lap("integrate")
        status = Status.TRACKING if pose else Status.INITIALISING if state.scale is None else Status.LOST
        return state, Step(
            exposure.time_ns,
            status,
            "rig",
            pose,
            key_frame=bool(revised),
            landmarks=Landmarks.empty() if stereo else self._landmarks(state, part, pose),
            revised=Trajectory.of(revised),
            scale=state.scale,
            seconds={**{f"{part.method}: {k}": v for k, v in part.seconds.items()}, **watch.seconds},
            decisions=tuple(decisions),
            parts=(part,),
        )

    def _with_metric(self, state: IntegratedState, part: Step) -> IntegratedState:
        if part.world_from_frame is None:
            return state
        opened = part.time_ns if state.opened_ns is None else state.opened_ns
        metric = (*state.metric, (part.time_ns, part.world_from_frame))
        frames = tuple(t for t in state.frames_ns if t >= opened)
        return replace(state, metric=metric, opened_ns=opened, frames_ns=frames)

    def _with_video(self, state: IntegratedState, part: Step) -> tuple[IntegratedState, list[Decision]]:
        """With one more frame; of a segment that is longer than MOST_FRAMES its middle is given up."""
        state = replace(state, interval=state.interval.after(part.time_ns))
        since = (part.time_ns if state.opened_ns is None else state.opened_ns) - state.margin_ns
        frames_ns, decisions = (*(t for t in state.frames_ns if t >= since), part.time_ns), []
        until = recent = since
        if state.metric and len(frames_ns) > MOST_FRAMES:
            until, recent = state.metric[-1][0] + state.margin_ns, frames_ns[-MOST_FRAMES]
            frames_ns = tuple(t for t in frames_ns if t <= until or t >= recent)
            since_pair = sum(t > state.metric[-1][0] for t in frames_ns)
            if recent > until:
                why = "the oldest of them get no pose"
                decisions = [checks.OPEN_FRAMES.of(since_pair, MOST_FRAMES, why, False)]
        items = [*state.video.items(), *part.revised.items()]
        if part.world_from_frame is not None:
            items.append((part.time_ns, part.world_from_frame))
        kept = [(t, p) for t, p in items if t >= since and (t <= until or t >= recent)]
        begun = (part.time_ns,) if part.restarted else ()
        after = replace(
            state,
            video=Trajectory.of(kept, "video"),
            final_until_ns=part.final_until_ns,
            restarts_ns=(*(t for t in state.restarts_ns if t >= since), *begun)[-MOST_RESTARTS:],
            frames_ns=frames_ns,
        )
        return after, decisions

    def _ends(self, state: IntegratedState) -> tuple[int, int] | None:
        """The open segment's span, once its end is known."""
        later = [t for t, _ in state.metric if state.opened_ns is not None and t > state.opened_ns]
        return (state.opened_ns, later[0]) if later and state.opened_ns is not None else None

    def _complete(self, state: IntegratedState) -> bool:
        """Whether the video poses of the open segment are final, or have been waited for long enough."""
        ends = self._ends(state)
        if ends is None:
            return False
        final = state.final_until_ns
        waiting = sum(t > ends[1] for t, _ in state.metric)
        return (final is not None and final >= ends[1]) or waiting >= self.config.max_waiting_pairs

    def _close(self, state: IntegratedState) -> tuple[IntegratedState, Trajectory, tuple[Decision, ...]] | None:
        """Steps 1 to 3 for the open segment; None while it has no end."""
        ends = self._ends(state)
        if ends is None:
            return None
        times = np.array([t for t in state.frames_ns if ends[0] <= t < ends[1]], np.int64)
        metric = Trajectory.of(list(state.metric)).moved(right=self.rig.rig_from_video, frame="video")
        poses, scale, decisions = self._fit(state, metric, ends, times)
        piece = poses.moved(right=self.rig.rig_from_video.inverse(), frame="rig")
        after = replace(
            state,
            opened_ns=ends[1],
            metric=tuple(m for m in state.metric if m[0] >= ends[0]),
            video=state.video.select(state.video.times_ns >= ends[1] - state.margin_ns),
            frames_ns=tuple(t for t in state.frames_ns if t >= ends[1]),
            scale=scale or state.scale,
            poses=state.poses.appended(piece) if len(piece) else state.poses,
        )
        segment = f"{ends[0] * 1e-9:.3f} to {ends[1] * 1e-9:.3f} s"
        return after, piece, tuple(replace(d, about=segment) for d in decisions)

    def _fit(
        self, state: IntegratedState, metric: Trajectory, ends: tuple[int, int], times: NDArray[np.int64]
    ) -> tuple[Trajectory, float | None, tuple[Decision, ...]]:
        """world_from_video at the times, metres per unit (None where undefined), and why."""
        fallback = interpolate(metric, times, "bspline")
        covered, why_not = self._covered(state, ends, times)
        if not covered:
            return fallback, None, (checks.VIDEO_COVERAGE.of(0, 1, why_not),)
        start, end = metric.at(ends[0]), metric.at(ends[1])
        assert start is not None and end is not None
        own = interpolate(state.video, np.array(ends, np.int64), self.config.interpolation)
        video = state.video.select(np.isin(state.video.times_ns, times))
        segment = fit_segment(video, own.pose(0), own.pose(1), start, end, ends, self.config.min_segment_m)
        length, least = float(np.linalg.norm(end.translation - start.translation)), self.config.min_segment_m
        moved = checks.SEGMENT_LENGTH.of(length, least, passed=segment is not None)
        if segment is None:
            rotations, _ = fit_rotations(video, own.pose(0), own.pose(1), start, end, ends)
            still = Trajectory(times, rotations, fallback.translations, "video")
            return (
                still,
                None,
                (replace(moved, consequence="no ratio of lengths: positions from the stereo poses alone"),),
            )
        return segment.poses, segment.scale, (moved, *_bends(segment))

    def _covered(self, state: IntegratedState, ends: tuple[int, int], times: NDArray[np.int64]) -> tuple[bool, str]:
        video = state.video
        if not len(video) or video.times_ns[0] > ends[0] or video.times_ns[-1] < ends[1]:
            return False, "no video poses on both sides: stereo poses interpolated"
        if not np.isin(times, video.times_ns).all():
            return False, "video frames without a pose: stereo poses interpolated"
        restarts = [t for t in state.restarts_ns if video.times_ns[0] < t <= ends[1]]
        if restarts:
            return False, "the monocular estimator started anew inside: stereo poses interpolated"
        return True, ""

    def _live(self, state: IntegratedState, time_ns: int) -> Pose | None:
        """The pose at once: from the last stereo pose on by the video's motion, in the last segment's unit."""
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
        """The video's points, made metric by the last segment's unit."""
        if not len(part.landmarks) or pose is None or state.scale is None:
            return Landmarks.empty()
        assert part.world_from_frame is not None
        in_video = state.scale * part.world_from_frame.inverse().apply(part.landmarks.xyz_in_world)
        return replace(part.landmarks, xyz_in_world=(pose @ self.rig.rig_from_video).apply(in_video))


def _bends(segment: Segment) -> tuple[Decision, ...]:
    """How far the video segment had to be bent; no thresholds in the paper, so 10 degrees only marks the doubtful."""
    turn, residual = np.degrees(segment.turn_rad), np.degrees(segment.residual_rad)
    return (
        checks.SCALE_RATIO.of(segment.scale, 0.0),
        checks.SEGMENT_TURN.of(turn, 10.0),
        checks.END_ORIENTATION.of(residual, 10.0),
    )
