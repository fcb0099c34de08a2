"""Integrated (section 6.3): video poses between two stereo exposures, scaled and turned to fit both.

Where this differs from the print: stereo poses are carried to the video camera, not video poses to the rig, as the
lever arm cannot be applied in a unit that is not known yet; where the video's poses cannot be used, positions between
two pairs are interpolated; of a segment that never ends only the newest MAX_FRAMES video poses are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ispom.estimator import STEREO, VIDEO, require_frame
from ispom.estimators.paper import checks
from ispom.estimators.paper.integrated.segment import Fitted, fitted
from ispom.estimators.paper.integrated.state import IntegratedState
from ispom.geometry import Pose
from ispom.settings import Range
from ispom.solvers.trajectory.interpolation import Interpolation, interpolate
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Landmarks, Measurement, Rig, SegmentFit, Status, Step, Trajectory

MAX_RESTARTS = 8
"""Of the video's world that are remembered: one within a segment is enough to interpolate it."""
MAX_FRAMES = 600
"""Of a segment without an end so many of the newest video poses, and those about its last pair, are kept (20 s at
30 Hz); the others get none."""


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
        self, state: IntegratedState, exposure: Measurement, asked: Mapping[str, Step]
    ) -> tuple[IntegratedState, Step]:
        """One exposure of either kind; closes every segment that has become complete."""
        watch, stereo = Stopwatch(), require_frame(exposure, VIDEO | STEREO).kind in STEREO
        part = asked["stereo" if stereo else "video"]
        revised, segments = [], list[SegmentFit]()
        decisions: list[Decision] = []
        if stereo:
            state = self._with_metric(state, part)
        else:
            state, decisions = self._with_video(state, part)
        while self._complete(state) and (closed := self._close(state)) is not None:
            state, piece, found = closed
            revised += piece.items()
            decisions += found.decisions
            segments += [found.fit] if found.fit is not None else []
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
            segments=tuple(segments),
            provisional=pose is not None and state.scale is None,
        )

    def _with_metric(self, state: IntegratedState, part: Step) -> IntegratedState:
        if part.world_from_frame is None:
            return state
        opened = part.time_ns if state.opened_ns is None else state.opened_ns
        metric = (*state.metric, (part.time_ns, part.world_from_frame))
        frames = tuple(t for t in state.frames_ns if t >= opened)
        return replace(state, metric=metric, opened_ns=opened, frames_ns=frames)

    def _with_video(self, state: IntegratedState, part: Step) -> tuple[IntegratedState, list[Decision]]:
        """With one more frame; of a segment that is longer than MAX_FRAMES its middle is given up."""
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
        kept = [(t, p) for t, p in items if t >= since and (t <= until or t >= recent)]
        begun = (part.time_ns,) if part.restarted else ()
        after = replace(
            state,
            video=Trajectory.of(kept, "video"),
            final_until_ns=part.final_until_ns,
            restarts_ns=(*(t for t in state.restarts_ns if t >= since), *begun)[-MAX_RESTARTS:],
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

    def _close(self, state: IntegratedState) -> tuple[IntegratedState, Trajectory, Fitted] | None:
        """Steps 1 to 3 for the open segment: its poses of the rig, and how; None while it has no end."""
        ends = self._ends(state)
        if ends is None:
            return None
        times = np.array([t for t in state.frames_ns if ends[0] <= t < ends[1]], np.int64)
        metric = Trajectory.of(list(state.metric)).moved(right=self.rig.rig_from_video, frame="video")
        found = fitted(state, metric, ends, times, self.config.interpolation, self.config.min_segment_m)
        scale = found.fit.scale if found.fit is not None else None
        piece = found.poses.moved(right=self.rig.rig_from_video.inverse(), frame="rig")
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
        return after, piece, replace(found, decisions=tuple(replace(d, about=segment) for d in found.decisions))

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
