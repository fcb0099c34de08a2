"""Monocular, modern: guided tracking, a pose for every frame against a map, windowed bundle adjustment with a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import FOCAL_SIGMA, RADIAL_SIGMA, Lens, corrected
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular import start as mono_start
from ispom.estimators.modern.monocular.covariance import LOSS, Spread
from ispom.estimators.modern.monocular.key_frame import Limits, extended, key_frame_tests
from ispom.estimators.modern.monocular.localise import (
    MIN_LOCATED,
    Sight,
    coasted,
    coasted_covariance,
    locate,
    speed_of,
    strays,
    turned,
)
from ispom.estimators.modern.monocular.map import Map, problem, shortened
from ispom.estimators.modern.monocular.start import Start
from ispom.estimators.modern.monocular.state import ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import (
    Followed,
    as_tracks,
    displaced,
    follow,
    guessed,
    projected,
    realigned,
    renewed,
    shows_something,
)
from ispom.estimators.paper.keyframes import Frame
from ispom.frontends.buckets import detect_spread
from ispom.geometry import Array, Pose
from ispom.settings import Range
from ispom.solvers import motion_only
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Camera,
    Decision,
    Exposure,
    Image,
    Landmarks,
    Rig,
    Status,
    Step,
    TrackStatus,
    Trajectory,
    VideoFrame,
    as_grey,
    colours_at,
)

PATIENCE = 5
"""So many frames are compared with the last good one before a loss leads to a new start."""


@dataclass(frozen=True)
class ModernMonocularConfig:
    """Settings of the modern monocular estimator."""

    max_tracks: Annotated[int, Range(50, 2000)] = 500
    """Points tracked at a time."""
    key_frames: Annotated[int, Range(4, 20)] = 10
    """Key frames adjusted together; what leaves them goes on as a prior."""
    min_parallax_deg: Annotated[float, Range(0.05, 20)] = 2.5
    """Median displacement since the last key frame, its rotation taken away, that makes the next one."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.3
    """A key frame is taken before a smaller share of the last one's points is left."""
    max_view_angle_deg: Annotated[float, Range(1, 90)] = 10.0
    """A key frame is taken when the camera has turned by this since the last one."""
    max_interval_s: Annotated[float, Range(0.05, 60)] = 1.0
    """A key frame is taken after this time, where a quarter of the parallax is there."""
    start_parallax_deg: Annotated[float, Range(0.1, 20)] = 1.0
    """Median displacement, rotation taken away, from which the first map is attempted."""
    point_parallax_deg: Annotated[float, Range(0.05, 20)] = 0.4
    """Points seen under a smaller angle get no place in the map yet."""
    noise_px: Annotated[float, Range(0.05, 5)] = 0.34
    """Deviation of a tracked place after some key frames; what is off by several of it is dropped."""
    self_calibration: bool = True
    """Correct the camera's focal length and radial distortion a little, by what its images say."""

    def build(self, rig: Rig) -> ModernMonocular:
        return ModernMonocular(rig, self)


@dataclass(frozen=True, eq=False)
class ModernMonocular:
    """Every frame, no metric scale. World: the video camera at the first frame; unit: the first baseline of the map."""

    rig: Rig
    config: ModernMonocularConfig

    def start(self) -> ModernMonocularState:
        return ModernMonocularState()

    def finish(self, state: ModernMonocularState) -> Trajectory:
        current = state.map.trajectory() if state.map is not None else []
        held = mono_start.poses_held(state.start.frames) if state.start is not None else ()
        return Trajectory.of([*state.settled, *held, *current], "video")

    def step(self, state: ModernMonocularState, exposure: Exposure) -> tuple[ModernMonocularState, Step]:
        """One frame: follow, locate, and at a key frame extend and adjust the map."""
        assert isinstance(exposure, VideoFrame)
        watch, grey = Stopwatch(), as_grey(exposure.image)
        guess = self._predicted(state, exposure.time_ns)
        followed, scene = self._follow(state, grey, guess)
        watch.lap("track")
        if state.map is None or guess is None:
            outcome = self._begin(state, exposure.time_ns, followed)
            watch.lap("start")
        else:
            outcome = self._advance(state, state.map, exposure.time_ns, grey, followed, scene, guess, watch)
        return self._conclude(state, exposure, grey, outcome, watch)

    @property
    def _camera(self) -> Camera:
        return self.rig.camera("video")

    @property
    def _sigma(self) -> float:
        """Width of the loss, in normalised units."""
        return LOSS * self.config.noise_px / self._camera.fx

    @property
    def _limits(self) -> Limits:
        c = self.config
        return Limits(c.min_parallax_deg, c.min_share, c.max_view_angle_deg, c.max_interval_s, self._sigma)

    @property
    def _extra_sigma(self) -> Array:
        """Of the camera's correction, as widened as the loss is."""
        return LOSS * np.array([FOCAL_SIGMA, RADIAL_SIGMA]) * self.config.self_calibration

    def _predicted(self, state: ModernMonocularState, time_ns: int) -> Pose | None:
        """world_from_camera at the velocity of the last two poses."""
        if state.map is None or not state.recent:
            return None
        return coasted(state.recent, time_ns)

    def _follow(self, state: ModernMonocularState, grey: Image, guess: Pose | None) -> tuple[Followed, Array]:
        """The tracks in the new image, and their scene points (N, 3), those without a place at a guessed depth."""
        live = state.live
        if state.map is None or guess is None:
            return follow(live, grey, None), np.full((len(live.ids), 3), np.nan)
        lens = Lens(self._camera, state.map.extra)
        scene = guessed(lens, live.uv, state.map.known(live.ids), state.recent[-1][1])
        return follow(live, grey, projected(lens, scene, guess, live.uv)), scene

    def _frame(self, state: ModernMonocularState, time_ns: int, followed: Followed) -> Frame:
        alive = followed.status == TrackStatus.ALIVE
        return Frame(time_ns, state.live.ids[alive], self._camera.normalise(followed.uv[alive]))

    def _begin(self, state: ModernMonocularState, time_ns: int, followed: Followed) -> Outcome:
        """No map yet."""
        frame = self._frame(state, time_ns, followed)
        angle = np.radians(self.config.start_parallax_deg)
        begun = mono_start.advance(
            state.start or Start(extra_sigma=self._extra_sigma), frame, self._sigma, float(angle)
        )
        if begun.map is None:
            given = (begun.held, None, begun.start, len(begun.start.frames) == 1, begun.decisions)
            return Outcome(followed, Status.INITIALISING, *given, settled=begun.settled)
        found = problem(begun.map)
        spread = Spread.of(found.window, found.ids, self._sigma)
        return Outcome(
            followed,
            Status.TRACKING,
            begun.map.poses[-1],
            begun.map,
            None,
            True,
            begun.decisions,
            covariance=spread.pose,
            spread=spread,
            settled=begun.settled,
        )

    def _advance(
        self,
        state: ModernMonocularState,
        world: Map,
        time_ns: int,
        grey: Image,
        followed: Followed,
        scene: Array,
        guess: Pose,
        watch: Stopwatch,
    ) -> Outcome:
        """Locate the frame against the map; make it a key frame where a test says so."""
        sight = self._located(state, world, grey, followed, scene, guess)
        if not sight.agreeing and (jumped := displaced(state.live, grey)) is not None:
            sight = self._located(state, world, grey, follow(state.live, grey, jumped), scene, guess)
        watch.lap("locate")
        followed, motion = sight.followed, sight.motion
        count = 0 if motion is None else int(motion.inliers.sum())
        located = checks.POSE_POINTS.of(count, MIN_LOCATED, passed=sight.agreeing)
        if motion is None or not located.passed:
            return self._lost(state, self._frame(state, time_ns, followed), grey, followed, located)
        place = np.searchsorted(state.live.ids, sight.ids)
        residual = np.full(len(followed.status), np.nan, np.float32)
        residual[place] = np.minimum(motion.distances * self._camera.fx, 1e4)
        followed.status[place[motion.distances > 6 * self._sigma]] = TrackStatus.REPROJECTION
        frame = replace(self._frame(state, time_ns, followed), world_from_camera=motion.camera_from_world.inverse())
        stray = strays(world.keys[-1], frame, frame.ids[~np.isin(frame.ids, world.points.ids)], 8 * self._sigma)
        followed.status[np.searchsorted(state.live.ids, stray)] = TrackStatus.EPIPOLAR
        frame = frame.without(stray)
        tests = key_frame_tests(world, frame, self._limits)
        assert state.spread is not None and frame.world_from_camera is not None
        outcome = Outcome(
            followed,
            Status.TRACKING,
            frame.world_from_camera,
            world,
            decisions=(located, *tests),
            residual_px=residual,
            compared=sight.compared,
            covariance=state.spread.of_pose(sight.ids, sight.xyz, motion, self._sigma),
        )
        if not any(test.passed for test in tests):
            return replace(outcome, map=world.with_between(time_ns, frame.world_from_camera))
        outcome = self._key_frame(outcome, world, frame, state.live.ids)
        watch.lap("key frame")
        return outcome

    def _located(
        self, state: ModernMonocularState, world: Map, grey: Image, followed: Followed, scene: Array, guess: Pose
    ) -> Sight:
        """The pose that the tracks give once their patches of origin are found again."""
        _, xyz, x = self._seen(state, world, followed)
        motion, compared = locate(xyz, x, guess, 4 * self._sigma), np.zeros(len(followed.status), bool)
        if motion is not None:
            first = motion.camera_from_world.inverse()
            followed, compared = self._realign(state, world, grey, followed, scene, first)
        ids, xyz, x = self._seen(state, world, followed)
        if motion is not None:
            motion = motion_only.fit_pose(xyz, x, motion.camera_from_world, 2 * self._sigma, 4 * self._sigma)
        return Sight(followed, compared, motion, ids, xyz)

    def _seen(
        self, state: ModernMonocularState, world: Map, followed: Followed
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Points of the map (N,), (N, 3), and where they are seen (N, 2), normalised and corrected."""
        alive = followed.status == TrackStatus.ALIVE
        xyz = world.known(state.live.ids[alive])
        known = np.isfinite(xyz[:, 0])
        x = corrected(self._camera.normalise(followed.uv[alive][known]), world.extra)
        return state.live.ids[alive][known], xyz[known], x

    def _realign(
        self, state: ModernMonocularState, world: Map, grey: Image, followed: Followed, scene: Array, pose: Pose
    ) -> tuple[Followed, NDArray[np.bool_]]:
        """Points of the map that tracking lost or misplaced are looked for where the pose puts them."""
        known = world.known(state.live.ids)
        lens = Lens(self._camera, world.extra)
        expected = projected(lens, known, pose, followed.uv)
        off = np.linalg.norm(expected - followed.uv, axis=1) > 4 * LOSS * self.config.noise_px
        lost = followed.status != TrackStatus.ALIVE
        expected = np.where((off | lost)[:, None], expected, followed.uv)
        origins = {k.time_ns: p for k, p in zip(world.keys, world.poses, strict=True)}
        return realigned(lens, state.live, grey, followed, expected, scene, pose, origins)

    def _key_frame(self, outcome: Outcome, world: Map, frame: Frame, all_ids: NDArray[np.int64]) -> Outcome:
        """New points, bundle adjustment, and what leaves the window."""
        config, followed = self.config, outcome.followed
        done = extended(world, frame, np.radians(config.point_parallax_deg), self._sigma)
        dropped = np.isin(all_ids, done.dropped) & (followed.status == TrackStatus.ALIVE)
        followed.status[dropped] = TrackStatus.REPROJECTION
        alive = all_ids[followed.status == TrackStatus.ALIVE]
        world, settled = shortened(done.map, alive, config.key_frames, self._sigma)
        return replace(
            outcome,
            pose=world.poses[-1],
            map=world,
            key_frame=True,
            decisions=(*outcome.decisions, *done.decisions),
            covariance=done.spread.pose,
            spread=done.spread,
            scale=done.scale,
            settled=tuple(settled),
        )

    def _lost(
        self, state: ModernMonocularState, frame: Frame, grey: Image, followed: Followed, why: Decision
    ) -> Outcome:
        """Wait for a frame that the last good one explains; then, or where only the place is lost, start anew."""
        last_ns, last = state.recent[-1]
        before = Frame(last_ns, state.live.ids, self._camera.normalise(state.live.uv), last)
        spot = None if state.missed else turned(before, frame, self._sigma)
        if spot is not None:
            why, held = spot
            return self._anew(state, held, held, frame, followed, why)
        # From a dark or covered lens no map can start.
        if state.missed < PATIENCE or not shows_something(grey, state.live.grey):
            why = replace(why, consequence="lost; the next frame is compared with the last good one")
            return Outcome(followed, Status.LOST, map=state.map, decisions=(why,), missed=state.missed + 1)
        return self._anew(state, coasted(state.recent, frame.time_ns), None, frame, followed, why)

    def _anew(
        self,
        state: ModernMonocularState,
        base: Pose,
        held: Pose | None,
        frame: Frame,
        followed: Followed,
        why: Decision,
    ) -> Outcome:
        """A new start at `base`, in the old world and as far as possible in its unit."""
        world, frame = state.map, replace(frame, world_from_camera=base)
        assert world is not None
        coasting = None if held is not None else partial(coasted, state.recent)
        covariance = coasted_covariance(state.covariance, state.recent[-1][1].inverse() @ base)
        start = Start((frame,), base, speed_of(world), world.points, self._extra_sigma, covariance, coasting)
        why = replace(why, consequence="lost; a new map from the last pose")
        return Outcome(followed, Status.LOST, held, start=start, decisions=(why,), settled=tuple(world.trajectory()))

    def _conclude(
        self, state: ModernMonocularState, exposure: VideoFrame, grey: Image, outcome: Outcome, watch: Stopwatch
    ) -> tuple[ModernMonocularState, Step]:
        """The next state and the Step; fresh corners at a key frame."""
        followed, world, start = outcome.followed, outcome.map, outcome.start
        alive = followed.status == TrackStatus.ALIVE
        fresh = np.zeros((0, 2), np.float32)
        if outcome.key_frame or (start is not None and len(start.frames) == 1):
            fresh = detect_spread(grey, self.config.max_tracks, followed.uv[alive], 0.011 * self._camera.width)
            ids, x = state.live.next_id + np.arange(len(fresh), dtype=np.int64), self._camera.normalise(fresh)
            if world is not None:
                world = world.with_new_tracks(ids, x)
            elif start is not None:
                start = start.with_new_tracks(ids, x)
        waiting = outcome.missed > 0
        # Without a map the origins stay.
        compared = np.ones(len(followed.status), bool) if outcome.compared is None else outcome.compared
        pose = outcome.pose
        moved = [(exposure.time_ns, pose)] if pose is not None else []
        if state.map is None and world is not None:
            moved = sorted(world.trajectory(), key=lambda item: item[0])
        after = ModernMonocularState(
            state.live if waiting else renewed(state.live, followed, grey, fresh, exposure.time_ns, compared),
            start,
            world,
            tuple([*state.recent, *moved][-2:]),
            outcome.missed,
            state.spread if outcome.spread is None else outcome.spread,
            state.covariance if outcome.covariance is None else outcome.covariance,
            state.settled.extended(outcome.settled),
        )
        unknown, revised = np.full(len(followed.status), np.nan, np.float32), outcome.spread is not None
        residual = unknown if outcome.residual_px is None else outcome.residual_px
        watch.lap("new points")
        step = Step(
            exposure.time_ns,
            outcome.status,
            "video",
            pose,
            outcome.covariance,
            outcome.key_frame,
            {"video": as_tracks(state.live, followed, residual, fresh)},
            self._landmarks(exposure, after) if revised else Landmarks.empty(),
            residual[np.isfinite(residual) & (followed.status == TrackStatus.ALIVE)],
            Trajectory.of([*outcome.settled, *(world.trajectory() if world is not None else ())], "video")
            if revised
            else Trajectory.empty("video"),
            outcome.scale,
            watch.seconds,
            outcome.decisions,
            scale_sigma=None if outcome.spread is None else outcome.spread.unit,
            calibration={} if world is None else {"lens": world.extra},
        )
        return after, step

    def _landmarks(self, exposure: VideoFrame, after: ModernMonocularState) -> Landmarks:
        assert after.map is not None
        xyz = after.map.known(after.live.ids)
        known = np.isfinite(xyz[:, 0])
        return Landmarks(after.live.ids[known], xyz[known], colours_at(exposure.image, after.live.uv[known]))
