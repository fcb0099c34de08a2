"""Monocular (section 6.1): track, choose key frames, solve triples of them, hand on the unit, fill in the rest.

Where this differs from the print: a pose is resected by AP3P in RANSAC and refined with a Cauchy loss, instead of by
decomposing a projection matrix; frames between key frames are refined one by one with the points held, instead of by
bundle adjustment; each frame also gets a pose at once, from the last triple's points. What never sees a key frame again
keeps the pose that it got at once after MOST_WAITING frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper import checks
from ispom.estimators.paper.keyframes import MOST_WAITING, Frame, Window, common_points, parallax_deg
from ispom.estimators.paper.refinement import adjust_window, fill_between
from ispom.estimators.paper.scale import ScaleStep, transfer_scale
from ispom.frontends import corners
from ispom.frontends.klt import Klt
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.solvers.interpolation import Interpolation
from ispom.solvers.resection import Resection, refine_pose, resect
from ispom.solvers.triple import ScaleTransfer, Triple, solve_triple
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Exposure,
    Image,
    Landmarks,
    Rig,
    Status,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
    VideoFrame,
    as_grey,
    colours_at,
)


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
class MonocularState:
    grey: Image | None = None
    """The previous image."""
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) of the points alive in it, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px]."""
    next_id: int = 0
    window: Window = Window()
    scale: ScaleStep | None = None
    """What the next triple takes its unit from."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Poses that nothing will revise."""


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
        watch = Stopwatch()
        grey = as_grey(exposure.image)
        uv, status = self._track(state, grey)
        alive = status == TrackStatus.ALIVE
        frame = Frame(exposure.time_ns, state.ids[alive], self.rig.camera("video").normalise(uv[alive]))
        watch.lap("track")
        resection, points = self._locate(state.window, frame)
        if resection is not None:
            frame = replace(frame, world_from_camera=resection.camera_from_world.inverse())
        watch.lap("locate")
        is_key, decisions = self._choose_key_frame(state.window, frame)
        revision = Revision(state.window.with_frame(frame), state.scale, decisions)
        if is_key:
            revision = self._key_frame(state, frame, decisions)
        watch.lap("key frame")
        return self._conclude(state, exposure, grey, (uv, status), (resection, points), revision, watch)

    def _track(self, state: MonocularState, grey: Image) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        if state.grey is None:
            return np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
        return Klt(levels=4).track(state.grey, grey, state.uv)

    def _locate(self, window: Window, frame: Frame) -> tuple[Resection | None, NDArray[np.int64]]:
        """A pose at once, by resection from the last triple's points; and which of the frame's points took part."""
        place = window.landmarks.places(frame.ids)
        known = np.flatnonzero(place >= 0)
        guess = window.predicted()
        if guess is None or len(known) < 10:
            return None, known
        xyz, x, limit = window.landmarks.xyz[place[known]], frame.x[known], self._limit
        found = refine_pose(xyz, x, guess.inverse(), 2 * limit)
        if found is None or found.inliers.mean() < 0.6:
            again = resect(xyz, x, 2 * limit)
            if again is not None and (found is None or again.inliers.sum() > found.inliers.sum()):
                found = again
        return found, known

    @property
    def _limit(self) -> float:
        """max_error_px in normalised units."""
        return self.config.max_error_px / self.rig.camera("video").fx

    def _choose_key_frame(self, window: Window, frame: Frame) -> tuple[bool, tuple[Decision, ...]]:
        """Large displacement and still enough common points."""
        if not window.keys:
            return True, ()
        displacement = parallax_deg(window.keys[-1], frame, self._limit)
        share = common_points(window.keys[-1:], frame) / max(len(window.keys[-1].ids), 1)
        wanted, least = self.config.min_parallax_deg, self.config.min_share
        moved = checks.PARALLAX.of(displacement, wanted)
        few, tells = share < least, displacement >= wanted / 4
        why = "too little parallax for a key frame" if few and not tells else ""
        early = checks.POINTS_LEFT.of(share, least, why, few and tells)
        waiting = sum(f.time_ns > window.keys[-1].time_ns for f in window.frames)
        given_up = checks.WAITING_FRAMES.of(
            waiting + 1, MOST_WAITING, "the oldest keep the poses that they got at once"
        )
        return moved.passed or early.passed, (moved, early) if given_up.passed else (moved, early, given_up)

    def _key_frame(self, state: MonocularState, frame: Frame, decisions: tuple[Decision, ...]) -> Revision:
        """Solve the triple that ends with this frame, scale it, place it, and fill in the frames between."""
        window = state.window
        if len(window.keys) < 2:
            return Revision(window.with_key(frame), state.scale, decisions)
        first, second = window.keys[-2:]
        ids = np.intersect1d(np.intersect1d(first.ids, second.ids), frame.ids)
        triple, why = self._triple(first, second, frame, ids)
        decisions += why
        if triple is None:
            return self._without_triple(state, frame, len(ids), decisions)
        step, scale, scale_decision = transfer_scale(triple, ids, window, state.scale, self.config.scale_transfer)
        window = window.with_triple(triple, ids, frame, scale)
        bundled: tuple[Decision, ...] = ()
        if self.config.local_bundle:
            window, bundled = adjust_window(window, self._limit)
            step = step.measured(window.keys)
        window = fill_between(window, self.config.interpolation, 2 * self._limit)
        return Revision(window, step, (*decisions, scale_decision, *bundled), triple, ids, scale)

    def _triple(
        self, first: Frame, second: Frame, third: Frame, ids: NDArray[np.int64]
    ) -> tuple[Triple | None, tuple[Decision, ...]]:
        x1, x2, x3 = first.at(ids), second.at(ids), third.at(ids)
        triple = solve_triple(x1, x2, x3, self._limit, np.deg2rad(self.config.min_angle_deg))
        epipolar = 0.0 if triple is None else float(triple.epipolar.mean())
        resected = 0 if triple is None else int(triple.resected.sum())
        made = (
            checks.EPIPOLAR_SHARE.of(epipolar, 0.5, "" if triple else "no pose"),
            checks.RESECTED_POINTS.of(resected, 12),
        )
        return (triple if all(d.passed for d in made) else None), made

    def _without_triple(
        self, state: MonocularState, frame: Frame, common: int, decisions: tuple[Decision, ...]
    ) -> Revision:
        """No triple here: try the next frame instead, or, with too few points left, begin again from the last pose."""
        if common >= self.config.min_common:
            return Revision(state.window.with_frame(frame), state.scale, decisions)
        then = "lost; a new start from the last pose, the step length carried over"
        restart = checks.TRIPLE_POINTS.of(common, self.config.min_common, then)
        return Revision(state.window.restarted(frame), state.scale, (*decisions, restart), lost=True)

    def _conclude(
        self,
        state: MonocularState,
        exposure: VideoFrame,
        grey: Image,
        tracked: tuple[NDArray[np.float32], NDArray[np.uint8]],
        located: tuple[Resection | None, NDArray[np.int64]],
        revision: Revision,
        watch: Stopwatch,
    ) -> tuple[MonocularState, Step]:
        """The next state and the Step: drop what fits badly, look for new points where tracks were lost."""
        (uv, status), (resection, points) = tracked, located
        camera, window = self.rig.camera("video"), revision.window
        residual = np.full(len(status), np.nan, np.float32)
        alive = np.flatnonzero(status == TrackStatus.ALIVE)
        if resection is not None:
            residual[alive[points]] = resection.residuals * camera.fx
            status[alive[points[~resection.inliers]]] = TrackStatus.REPROJECTION
        if revision.triple is not None:
            status[np.isin(state.ids, revision.ids[~revision.triple.epipolar])] = TrackStatus.EPIPOLAR
        alive = status == TrackStatus.ALIVE
        fresh = np.zeros((0, 2), np.float32)
        if window.keys and window.keys[-1].time_ns == exposure.time_ns:
            fresh = corners.detect(grey, self.config.max_tracks - int(alive.sum()), uv[alive])
            window = window.with_new_points(state.next_id + np.arange(len(fresh)), camera.normalise(fresh))
        window, settled = window.settle(self.config.bundle_key_frames if self.config.local_bundle else 3)
        new_ids = state.next_id + np.arange(len(fresh), dtype=np.int64)
        after = MonocularState(
            grey,
            np.concatenate([state.ids[alive], new_ids]),
            np.concatenate([uv[alive], fresh]),
            state.next_id + len(fresh),
            window,
            revision.scale,
            state.settled.extended(settled),
        )
        pose = window.frames[-1].world_from_camera if window.frames else None
        inlier_px = residual[np.isfinite(residual) & (status == TrackStatus.ALIVE)]
        tracks = Tracks.of(
            np.concatenate([state.ids, new_ids]),
            np.concatenate(
                [
                    np.where(
                        (status == TrackStatus.ALIVE)[:, None] | (status >= TrackStatus.EPIPOLAR)[:, None], uv, state.uv
                    ),
                    fresh,
                ]
            ),
            uv_prev=np.concatenate([state.uv, np.full((len(fresh), 2), np.nan, np.float32)]),
            status=np.concatenate([status, np.full(len(fresh), TrackStatus.NEW, np.uint8)]),
            residual_px=np.concatenate([residual, np.full(len(fresh), np.nan, np.float32)]),
        )
        watch.lap("new points")
        started = window.landmarks.ids.size > 0
        health = (
            Status.LOST
            if revision.lost or (started and pose is None)
            else (Status.TRACKING if started else Status.INITIALISING)
        )
        step = Step(
            exposure.time_ns,
            health,
            "video",
            pose,
            key_frame=bool(window.keys) and window.keys[-1].time_ns == exposure.time_ns,
            tracks={"video": tracks},
            landmarks=self._landmarks(exposure, after, revision),
            residuals_px=inlier_px,
            revised=Trajectory.of([*settled, *window.poses()], "video")
            if revision.triple is not None
            else Trajectory.empty("video"),
            scale=revision.step_scale,
            seconds=watch.seconds,
            decisions=revision.decisions,
            final_until_ns=window.final_until_ns,
            restarted=window.starts_ns[-1:] == (exposure.time_ns,),
        )
        return after, step

    def _landmarks(self, exposure: VideoFrame, after: MonocularState, revision: Revision) -> Landmarks:
        if revision.triple is None:
            return Landmarks.empty()
        landmarks = revision.window.landmarks
        ids, here, there = np.intersect1d(after.ids, landmarks.ids, return_indices=True)
        return Landmarks(ids, landmarks.xyz[there], colours_at(exposure.image, after.uv[here]))


@dataclass(frozen=True, eq=False)
class Revision:
    """What a frame did to the window of key frames."""

    window: Window
    scale: ScaleStep | None
    decisions: tuple[Decision, ...]
    triple: Triple | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """The points that took part in the triple."""
    step_scale: float | None = None
    lost: bool = False
