"""Monocular (section 6.1): track, choose key frames, solve triples of them, hand on the unit, fill in the rest.

Where this differs from the print: a pose is resected by AP3P in RANSAC and refined with a Cauchy loss, instead of by
decomposing a projection matrix; frames between key frames are refined one by one with the points held, instead of by
bundle adjustment; each frame also gets a pose at once, from the last triple's points. What never sees a key frame again
keeps the pose that it got at once after MAX_WAITING frames.

At rest the print has no answer: points tracked from image to image drift, their displacement makes a key frame after
some seconds, and the triple of three images from one place has any direction and nearly any length. The unit is lost,
and where too few points agree the method starts anew, without a pose until it moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ispom.estimators.paper import checks
from ispom.estimators.paper.monocular.conclude import as_step, corners_for, next_state
from ispom.estimators.paper.monocular.frames_between import fill_between
from ispom.estimators.paper.monocular.key_frame_selection import key_frame_tests
from ispom.estimators.paper.monocular.local_bundle import adjust_window
from ispom.estimators.paper.monocular.resection import resected
from ispom.estimators.paper.monocular.scale_transfer import transfer_scale
from ispom.estimators.paper.monocular.state import MonocularState, Revision
from ispom.estimators.paper.monocular.tracks import follow
from ispom.estimators.paper.monocular.triples import triple_of
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.features.front_ends import CORNERS, front_end, front_ends
from ispom.features.interfaces import FrontEnd
from ispom.settings import Choices, Range
from ispom.solvers.multiview.triple import ScaleTransfer
from ispom.solvers.trajectory.interpolation import Interpolation
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Exposure, Rig, Step, Trajectory, VideoFrame, as_grey

KEY_FRAMES = 3
"""Kept without bundle adjustment: a triple."""


@dataclass(frozen=True)
class MonocularConfig:
    """Settings of the monocular estimator (section 6.1)."""

    scale_transfer: ScaleTransfer = "norm"
    """How a triple of key frames takes over the unit: norm as printed (shrinks on bends), vector |T13 - T12|,
    depth the ratio of shared points' depths, unit every step 1 long (line C)."""
    local_bundle: bool = False
    """Local bundle adjustment after each key frame (line D)."""
    bundle_key_frames: Annotated[int, Range(3, 15)] = 7
    """Key frames adjusted together."""
    interpolation: Interpolation = "bspline"
    """First guess of positions between key frames; rotations are interpolated spherically."""
    features: Annotated[str, Choices(front_ends)] = CORNERS.name
    """What finds and tracks points: corners (the strongest, as published), klt, patches, sift, orb, or a package's."""
    max_tracks: Annotated[int, Range(50, 2000)] = 400
    """Points tracked at a time."""
    min_parallax_deg: Annotated[float, Range(0.05, 20)] = 0.5
    """Median displacement since the last key frame, its rotation taken away, that makes the next one."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.6
    """A key frame is taken early, before a smaller share of the last one's points is left."""
    min_common: Annotated[int, Range(12, 1000)] = 30
    """With fewer points common to three key frames no triple is solved: lost, and a new start."""
    max_error_px: Annotated[float, Range(0.2, 10)] = 1.5
    """Largest distance from the epipolar line, and largest reprojection error."""
    min_angle_deg: Annotated[float, Range(0, 10)] = 0.8
    """Points seen under a smaller angle from key frames 1 and 3 are not resected from."""

    def build(self, rig: Rig) -> Monocular:
        return Monocular(rig, self)


@dataclass(frozen=True, eq=False)
class Monocular:
    """Every frame, no metric scale, drifts. World: the video camera at the first key frame; unit: the first |T13|."""

    rig: Rig
    config: MonocularConfig

    def start(self) -> MonocularState:
        return MonocularState()

    def finish(self, state: MonocularState) -> Trajectory:
        return Trajectory.of([*state.settled, *state.window.poses()], "video")

    def step(self, state: MonocularState, exposure: Exposure) -> tuple[MonocularState, Step]:
        """One frame, as the steps of section 6.1."""
        assert isinstance(exposure, VideoFrame)
        watch, config, camera = Stopwatch(), self.config, self.rig.camera("video")
        grey = as_grey(exposure.image)
        followed = follow(self._front_end.tracker, state, grey)
        frame = followed.frame(camera, exposure.time_ns)
        watch.lap("track")
        located = resected(state.window, frame, self._limit)
        frame = replace(frame, world_from_camera=located.pose)
        watch.lap("locate")
        is_key, tests = key_frame_tests(state.window, frame, config.min_parallax_deg, config.min_share, self._limit)
        revision = Revision(state.window.with_frame(frame), state.scale, tests)
        if is_key:
            revision = self._key_frame(state, frame, tests)
        watch.lap("key frame")
        before, followed = followed, followed.without_outliers(located, revision, camera)
        if located.resection is not None or revision.triple is not None:
            revision = revision.telling(
                checks.OUTLIERS.of(before.alive.sum() - followed.alive.sum(), before.alive.sum())
            )
        fresh = corners_for(
            self._front_end.detector, revision.window, grey, followed, exposure.time_ns, config.max_tracks
        )
        kept = config.bundle_key_frames if config.local_bundle else KEY_FRAMES
        after, settled = next_state(state, grey, followed, fresh, revision, camera, kept)
        watch.lap("new points")
        return after, as_step(exposure, after, followed, fresh, revision, settled, watch.seconds)

    @property
    def _front_end(self) -> FrontEnd:
        return front_end(self.config.features)

    @property
    def _limit(self) -> float:
        """max_error_px in normalised units."""
        return self.config.max_error_px / self.rig.camera("video").fx

    def _key_frame(self, state: MonocularState, frame: TrackedFrame, tests: tuple[Decision, ...]) -> Revision:
        """Solve the triple that ends with this frame, scale it, place it, and fill in the frames between."""
        window, config = state.window, self.config
        if len(window.keys) < 2:
            return Revision(window.with_key(frame), state.scale, tests)
        first, second = window.keys[-2:]
        ids = np.intersect1d(np.intersect1d(first.ids, second.ids), frame.ids)
        triple, made = triple_of(first, second, frame, ids, self._limit, np.deg2rad(config.min_angle_deg))
        if triple is None:
            return self._without_triple(state, frame, len(ids), (*tests, *made))
        step, scale, transferred = transfer_scale(triple, ids, window, state.scale, config.scale_transfer)
        window = window.with_triple(triple, ids, frame, scale)
        bundled: tuple[Decision, ...] = ()
        if config.local_bundle:
            window, bundled = adjust_window(window, self._limit)
            step = step.measured(window.keys)
        window = fill_between(window, config.interpolation, 2 * self._limit)
        return Revision(window, step, (*tests, *made, *transferred, *bundled), triple, ids, scale)

    def _without_triple(
        self, state: MonocularState, frame: TrackedFrame, common: int, decisions: tuple[Decision, ...]
    ) -> Revision:
        """No triple here: try the next frame instead, or, with too few points left, begin again from the last pose."""
        if common >= self.config.min_common:
            return Revision(state.window.with_frame(frame), state.scale, decisions)
        then = "a new segment starts from the last pose, with the last step length"
        restart = checks.TRIPLE_POINTS.of(common, self.config.min_common, then)
        return Revision(state.window.restarted(frame), state.scale, (*decisions, restart), lost=True)
