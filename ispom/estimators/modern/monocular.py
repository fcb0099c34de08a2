"""Monocular, modern: guided tracking, a pose for every frame against a map, windowed bundle adjustment with a prior."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.chain import Chain, in_order
from ispom.estimators.keyframes import Frame
from ispom.estimators.modern import mono_start
from ispom.estimators.modern.lens import FOCAL_SIGMA, RADIAL_SIGMA, Lens, corrected
from ispom.estimators.modern.mono_keyframe import Limits, extended, key_frame_tests
from ispom.estimators.modern.mono_locate import carried, locate, speed_of, turned
from ispom.estimators.modern.mono_map import Map, key_covariance, problem, shortened
from ispom.estimators.modern.mono_start import Start
from ispom.estimators.modern.mono_tracks import (
    Followed,
    Live,
    as_tracks,
    follow,
    guessed,
    projected,
    realigned,
    renewed,
)
from ispom.frontends.buckets import detect_spread
from ispom.geometry import Array, Pose
from ispom.settings import Range
from ispom.solvers.motion_only import adjust_motion
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
MIN_LOCATED = 15
"""Fewer points that agree with a pose are a loss."""


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
    noise_px: Annotated[float, Range(0.05, 5)] = 0.5
    """Deviation of a tracked place; the loss of the adjustments is as wide, tracks off by several of it are dropped."""

    self_calibration: bool = True
    """Correct the camera's focal length and radial distortion a little, by what its images say."""

    def build(self, rig: Rig) -> ModernMonocular:
        return ModernMonocular(rig, self)


@dataclass(frozen=True, eq=False)
class ModernMonocularState:
    live: Live = Live()
    start: Start | None = None
    """While there is no map."""
    map: Map | None = None
    recent: tuple[tuple[int, Pose], ...] = ()
    """The last two poses, for the motion model."""
    missed: int = 0
    """Frames since the last pose."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) of the last key frame's pose."""
    settled: Chain[tuple[int, Pose]] | None = None
    """Poses that nothing will revise."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one frame led to; the rest of the Step follows from it."""

    followed: Followed
    status: Status
    pose: Pose | None = None
    map: Map | None = None
    start: Start | None = None
    key_frame: bool = False
    decisions: tuple[Decision, ...] = ()
    residual_px: NDArray[np.float32] | None = None
    covariance: Array | None = None
    key_covariance: Array | None = None
    scale: float | None = None
    settled: tuple[tuple[int, Pose], ...] = ()
    missed: int = 0
    compared: NDArray[np.bool_] | None = None
    """Which tracks were found by the patch of their origin."""


@dataclass(frozen=True, eq=False)
class ModernMonocular:
    """Every frame, no metric scale. World: the video camera at the first frame; unit: the first baseline of the map."""

    rig: Rig
    config: ModernMonocularConfig
    method: str = "monocular"

    def uses(self, exposure: Exposure) -> bool:
        return isinstance(exposure, VideoFrame)

    def start(self) -> ModernMonocularState:
        return ModernMonocularState()

    def finish(self, state: ModernMonocularState) -> Trajectory:
        current = state.map.trajectory() if state.map is not None else []
        held = mono_start.poses_held(state.start.frames) if state.start is not None else ()
        return Trajectory.of([*in_order(state.settled), *held, *current], "video")

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
        """noise_px in normalised units."""
        return self.config.noise_px / self._camera.fx

    @property
    def _limits(self) -> Limits:
        c = self.config
        return Limits(c.min_parallax_deg, c.min_share, c.max_view_angle_deg, c.max_interval_s, self._sigma)

    @property
    def _extra_sigma(self) -> Array:
        return np.array([FOCAL_SIGMA, RADIAL_SIGMA]) * self.config.self_calibration

    def _predicted(self, state: ModernMonocularState, time_ns: int) -> Pose | None:
        """world_from_camera at the velocity of the last two poses."""
        if state.map is None or not state.recent:
            return None
        last_ns, last = state.recent[-1]
        before_ns, before = state.recent[0]
        if before_ns == last_ns:
            return last
        twist = (before.inverse() @ last).log() * ((time_ns - last_ns) / (last_ns - before_ns))
        return last @ Pose.exp(twist)

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
            key = len(begun.start.frames) == 1
            return Outcome(
                followed,
                Status.INITIALISING,
                begun.held,
                None,
                begun.start,
                key,
                begun.decisions,
                settled=begun.settled,
            )
        covariance = key_covariance(problem(begun.map).window, self._sigma)
        return Outcome(
            followed,
            Status.TRACKING,
            begun.map.poses[-1],
            begun.map,
            None,
            True,
            begun.decisions,
            covariance=covariance,
            key_covariance=covariance,
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
        frame = self._frame(state, time_ns, followed)
        xyz = world.known(frame.ids)
        known = np.flatnonzero(np.isfinite(xyz[:, 0]))
        motion = locate(xyz[known], corrected(frame.x[known], world.extra), guess, 4 * self._sigma)
        compared = np.zeros(len(followed.status), bool)
        if motion is not None:
            first = motion.camera_from_world.inverse()
            followed, compared = self._realign(state, world, grey, followed, scene, first)
            frame = self._frame(state, time_ns, followed)
            xyz = world.known(frame.ids)
            known = np.flatnonzero(np.isfinite(xyz[:, 0]))
            motion = adjust_motion(xyz[known], corrected(frame.x[known], world.extra), first.inverse(), 4 * self._sigma)
        agreeing = 0 if motion is None else int(motion.inliers.sum())
        watch.lap("locate")
        located = Decision("points that agree with the pose", agreeing, MIN_LOCATED, agreeing >= MIN_LOCATED)
        if motion is None or not located.passed:
            return self._lost(state, frame, followed, located)
        alive = np.flatnonzero(followed.status == TrackStatus.ALIVE)
        residual = np.full(len(followed.status), np.nan, np.float32)
        residual[alive[known]] = motion.residuals * self._camera.fx
        followed.status[alive[known[motion.residuals > 6 * self._sigma]]] = TrackStatus.REPROJECTION
        pose = motion.camera_from_world.inverse()
        frame = replace(self._frame(state, time_ns, followed), world_from_camera=pose)
        tests = key_frame_tests(world.keys[-1], frame, self._limits)
        conditional = np.linalg.pinv(motion.information, hermitian=True) * self._sigma**2
        outcome = Outcome(
            followed,
            Status.TRACKING,
            pose,
            world,
            decisions=(located, *tests),
            residual_px=residual,
            compared=compared,
            covariance=carried(state.covariance, world.poses[-1].inverse() @ pose) + conditional,
        )
        if not any(test.passed for test in tests):
            return replace(outcome, map=world.with_between(time_ns, pose))
        outcome = self._key_frame(outcome, world, frame, state.live.ids)
        watch.lap("key frame")
        return outcome

    def _realign(
        self, state: ModernMonocularState, world: Map, grey: Image, followed: Followed, scene: Array, pose: Pose
    ) -> tuple[Followed, NDArray[np.bool_]]:
        """Points of the map that tracking lost or misplaced are looked for where the pose puts them."""
        known = world.known(state.live.ids)
        lens = Lens(self._camera, world.extra)
        expected = projected(lens, known, pose, followed.uv)
        off = np.linalg.norm(expected - followed.uv, axis=1) > 4 * self.config.noise_px
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
            covariance=done.covariance,
            key_covariance=done.covariance,
            scale=done.scale,
            settled=tuple(settled),
        )

    def _lost(self, state: ModernMonocularState, frame: Frame, followed: Followed, why: Decision) -> Outcome:
        """Wait for a frame that the last good one explains; then, or where only the place is lost, start anew."""
        world, (_, last) = state.map, state.recent[-1]
        assert world is not None
        before = Frame(state.recent[-1][0], state.live.ids, self._camera.normalise(state.live.uv), last)
        spot = None if state.missed else turned(before, frame, self._sigma)
        if spot is not None:
            why, held = spot
            return self._anew(world, held, held, frame, followed, why)
        if state.missed < PATIENCE:
            why = replace(why, because="lost; the next frame is compared with the last good one")
            return Outcome(followed, Status.LOST, map=world, decisions=(why,), missed=state.missed + 1)
        return self._anew(world, last, None, frame, followed, why)

    def _anew(
        self, world: Map, base: Pose, held: Pose | None, frame: Frame, followed: Followed, why: Decision
    ) -> Outcome:
        """A new start at `base`, in the old world and as far as possible in its unit."""
        start = Start((replace(frame, world_from_camera=base),), base, speed_of(world), world.points, self._extra_sigma)
        why = replace(why, because="lost; a new map from the last pose")
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
        chain = state.settled
        for item in outcome.settled:
            chain = Chain(item, chain)
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
            state.covariance if outcome.key_covariance is None else outcome.key_covariance,
            chain,
        )
        unknown, revised = np.full(len(followed.status), np.nan, np.float32), outcome.key_covariance is not None
        residual = unknown if outcome.residual_px is None else outcome.residual_px
        watch.lap("new points")
        step = Step(
            self.method,
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
        )
        return after, step

    def _landmarks(self, exposure: VideoFrame, after: ModernMonocularState) -> Landmarks:
        assert after.map is not None
        xyz = after.map.known(after.live.ids)
        known = np.isfinite(xyz[:, 0])
        return Landmarks(after.live.ids[known], xyz[known], colours_at(exposure.image, after.live.uv[known]))
