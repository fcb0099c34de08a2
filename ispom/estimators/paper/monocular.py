"""Position and orientation from a single camera: section 6.1 of Li, Liu and Yuan (2013).

The steps, in the order of the paper and of this file:

1. Features are tracked through all video frames; frames with a large displacement and enough points are keyframes.
2. For three keyframes C1, C2, C3 (Fig. 3) the matches of images 1 and 3 give R13 and T13, with |T13| = 1.
3. Forward intersection: the common points are triangulated from cameras 1 and 3.
4. Resection: the pose of camera 2 follows from those points and image 2 (R12, T12); T12 + T23 = T13.
5. Scale transfer (Fig. 4): |T23| of one triple is |T12| of the next one.
6. The frames between keyframes are interpolated and refined; local bundle adjustment is optional (6.4, line D).

Differences from the print: poses come from AP3P in RANSAC, refined with a robust loss, not from decomposing a
projection matrix; frames between keyframes are refined one by one with fixed points, not by bundle adjustment; each
frame also gets a pose at once, from the points of the last triple. A frame that no keyframe follows within MAX_WAITING
frames keeps it.

At rest the print has no answer. Tracking drift looks like displacement and makes a keyframe after some seconds, and
three images from one place determine neither direction nor length. The scale is lost; where too few points are inliers,
the method starts a new segment and has no pose until the camera moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import TRANSFER, VIDEO, Method, require_frame
from ispom.estimators.adjustment import optimised
from ispom.estimators.paper import checks
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame, parallax_deg
from ispom.features.front_ends import CORNERS, front_end, front_ends
from ispom.features.interfaces import Detector, FrontEnd, Tracker
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Choices, Range, WorthTrying, checked
from ispom.solvers.bundle import adjust
from ispom.solvers.localisation import Policy, PoseFit, in_own_unit, locate, refine_pose
from ispom.solvers.multiview.triple import ScaleTransfer, Triple, depth_ratio, solve_triple, step_length
from ispom.solvers.trajectory.interpolation import Interpolation, interpolate
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Camera,
    Decision,
    Frame,
    Image,
    Landmarks,
    Measurement,
    Rig,
    Status,
    Step,
    Tracks,
    TrackStatus,
    Trajectory,
    as_grey,
    colours_at,
)

KEYFRAMES = 3
"""Keyframes kept without bundle adjustment: one triple."""
MIN_PARALLAX_SHARE = 0.25
"""A frame with less than this share of the required parallax is no keyframe, however few points are left."""
MAX_WAITING = 300
"""Frames after the last keyframe whose poses may still change: 10 s at 30 Hz."""
MAX_STARTS = 9
"""Start times that are remembered. Those inside one segment of the integration matter, where one is too many."""
MIN_PNP_POINTS = 10
"""With fewer known points a frame gets no pose of its own."""
MIN_EPIPOLAR_SHARE = 0.5
"""Least share of epipolar inliers: with fewer the relative pose explains a minority of the points."""
MIN_RESECTED = 12
"""Least number of inliers of camera 2: twice what the resection itself needs."""
DOUBTFUL_SCATTER = 20.0
"""[%] Scatter of the depth ratios above which the scale is called unreliable. The paper has no such threshold."""
MIN_LENGTH_SHARE = 0.05
"""|T13| - |T12| below this share of |T13 - T12| (negative on a sharp bend) would make the scale vanish."""
MIN_T12 = 1e-6
"""Lower bound of |T12| where |T13| = 1: no division by zero where the first two keyframes coincide."""
BUNDLE_ITERATIONS = 10
"""Largest number of iterations of a bundle adjustment."""
FIXED_KEYFRAMES = 2
"""Keyframes that fix the gauge and the scale of a bundle adjustment."""
MIN_BUNDLE_POINTS = 10
"""With fewer points a bundle adjustment hardly improves the poses."""
CORNER_DISTANCE_PX = 8.0
"""Least distance of a new corner from other points: two thirds of a tracking window."""


@dataclass(frozen=True)
class MonocularConfig:
    """Settings of the monocular estimator (section 6.1)."""

    scale_transfer: ScaleTransfer = "norm"
    """How a triple of keyframes takes over the scale: norm as printed (shrinks on bends), vector |T13 - T12|,
    depth the ratio of shared points' depths, unit every step 1 long (line C)."""
    local_bundle: bool = False
    """Local bundle adjustment after each keyframe (line D)."""
    bundle_key_frames: Annotated[int, Range(3, 15)] = 7
    """Keyframes adjusted together."""
    interpolation: Interpolation = "bspline"
    """Initial positions between keyframes; rotations are interpolated spherically."""
    features: Annotated[str, Choices(front_ends), WorthTrying(values=("klt", "orb", "sift"))] = CORNERS.name
    """Finds and tracks points: corners (the strongest, as published), klt, sift, surf, orb, or any other front end."""
    max_tracks: Annotated[int, Range(50, 2000), WorthTrying((2, 0.5))] = 400
    """Points tracked at a time."""
    min_parallax_deg: Annotated[float, Range(0.05, 20), WorthTrying((2, 0.5))] = 0.5
    """Median displacement since the last keyframe, without that of its rotation, that makes the next one."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.6
    """Least share of the last keyframe's points that must be left; a keyframe is taken early, before fewer are left."""
    min_common: Annotated[int, Range(12, 1000)] = 30
    """Least number of points common to three keyframes. With fewer no triple is solved: the camera is lost, and a new
    segment starts."""
    max_error_px: Annotated[float, Range(0.2, 10), WorthTrying((2,))] = 1.5
    """Largest distance from the epipolar line, and largest reprojection error."""
    min_angle_deg: Annotated[float, Range(0, 10)] = 0.8
    """Points with a smaller parallax between keyframes 1 and 3 are not used for resection."""

    def build(self, rig: Rig) -> Monocular:
        return Monocular(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Monocular:
    """Gives each video frame a pose, without metric scale and with drift.

    World: the video camera at the first keyframe. Unit: the first |T13|.
    """

    rig: Rig
    config: MonocularConfig

    def start(self) -> MonocularState:
        return MonocularState()

    def finish(self, state: MonocularState) -> Trajectory:
        return Trajectory.of([*state.settled, *state.window.poses()], "video")

    def step(self, state: MonocularState, exposure: Measurement) -> tuple[MonocularState, Step]:
        """Processes one video frame. Raises InputError for a stereo frame."""
        exposure = require_frame(exposure, VIDEO, rig=self.rig)
        watch, config, camera = Stopwatch(), self.config, self.rig.camera("video")
        grey = as_grey(exposure.image)

        tracked = track_features(self._front_end.tracker, state, grey)
        frame = tracked.as_frame(camera, exposure.time_ns)
        watch.lap("track")

        localised = localise(state.window, frame, self._max_error)
        frame = replace(frame, world_from_camera=localised.pose)
        watch.lap("locate")

        is_key, tests = is_keyframe(
            state.window, frame, config.min_parallax_deg, config.min_share, max_error=self._max_error
        )
        if is_key:
            update = self._add_keyframe(state, frame, tests)
        else:
            update = WindowUpdate(state.window.with_frame(frame), state.step_scale, tests)
        watch.lap("key frame")

        n_tracked = tracked.alive.sum()
        tracked = tracked.without_outliers(localised, update, camera)
        if localised.resection is not None or update.triple is not None:
            outliers = checks.OUTLIERS.of(n_tracked - tracked.alive.sum(), n_tracked)
            update = replace(update, decisions=(*update.decisions, outliers))
        new_uv = detect_new_corners(
            self._front_end.detector, update.window, grey, tracked, exposure.time_ns, config.max_tracks
        )
        n_kept = config.bundle_key_frames if config.local_bundle else KEYFRAMES
        after, settled = next_state(state, grey, tracked, new_uv, update, camera, n_kept)
        watch.lap("new points")
        return after, as_step(exposure, after, tracked, new_uv, update, settled, watch.seconds)

    @property
    def _front_end(self) -> FrontEnd:
        return front_end(self.config.features)

    @property
    def _max_error(self) -> float:
        """max_error_px in normalised image coordinates."""
        return self.config.max_error_px / self.rig.camera("video").fx

    def _add_keyframe(self, state: MonocularState, frame: TrackedFrame, tests: tuple[Decision, ...]) -> WindowUpdate:
        """Solves the triple that ends with this frame (steps 2 to 4), scales it (5), and fills the gaps (6)."""
        window, config = state.window, self.config
        if len(window.keys) < 2:
            return WindowUpdate(window.with_keyframe(frame), state.step_scale, tests)
        first, second = window.keys[-2:]
        ids = np.intersect1d(np.intersect1d(first.ids, second.ids), frame.ids)
        triple, solved = triple_of(first, second, frame, ids, self._max_error, np.deg2rad(config.min_angle_deg))
        if triple is None:
            return self._without_triple(state, frame, len(ids), (*tests, *solved))
        step, scale, transferred = transfer_scale(triple, ids, window, state.step_scale, config.scale_transfer)
        window = window.with_triple(triple, ids, frame, scale)
        bundled: tuple[Decision, ...] = ()
        if config.local_bundle:
            window, bundled = adjust_window(window, self._max_error)
            step = step.with_length_from(window.keys)
        window = fill_between(window, config.interpolation, 2 * self._max_error)
        return WindowUpdate(
            window=window,
            step_scale=step,
            decisions=(*tests, *solved, *transferred, *bundled),
            triple=triple,
            ids=ids,
            scale=scale,
        )

    def _without_triple(
        self, state: MonocularState, frame: TrackedFrame, n_common: int, decisions: tuple[Decision, ...]
    ) -> WindowUpdate:
        """Waits for the next frame, or starts a new segment from the last pose where too few points are left."""
        if n_common >= self.config.min_common:
            return WindowUpdate(state.window.with_frame(frame), state.step_scale, decisions)
        then = "a new segment starts from the last pose, with the last step length"
        restart = checks.TRIPLE_POINTS.of(n_common, self.config.min_common, then)
        return WindowUpdate(state.window.restarted(frame), state.step_scale, (*decisions, restart), lost=True)


# State: what is kept from frame to frame


@dataclass(frozen=True)
class StepScale:
    """The length of the last step of a triple, which the next triple takes over."""

    length: float
    """|T23| by the chosen formula, in the world's unit: the next triple's |T12|."""
    bias: float = 1.0
    """Ratio of that length to |T13 - T12|."""

    def with_length_from(self, keys: tuple[TrackedFrame, ...]) -> StepScale:
        """Takes the length from the last two of the adjusted keyframes, and keeps the bias of the formula."""
        second, third = keys[-2].world_from_camera, keys[-1].world_from_camera
        if second is None or third is None:
            raise ValueError("the last two keyframes have no pose")
        return replace(self, length=self.bias * float(np.linalg.norm(third.translation - second.translation)))


@dataclass(frozen=True, eq=False)
class KeyframeWindow:
    """The last keyframes, all frames since the oldest of them, and their points."""

    keys: tuple[TrackedFrame, ...] = ()
    frames: tuple[TrackedFrame, ...] = ()
    """In order of time, keyframes included."""
    landmarks: ScenePoints = ScenePoints()
    base: Pose = Pose()
    """world_from_camera of the first keyframe of the segment."""
    fresh: bool = True
    """No triple has been solved in this segment yet."""
    starts_ns: tuple[int, ...] = ()
    """Start times of all segments but the first; segments have nothing but the last pose in common."""

    @property
    def final_until_ns(self) -> int | None:
        """Poses before this time change no more (hardly, with bundle adjustment). None before a triple is solved."""
        return self.keys[-2].time_ns if len(self.keys) >= 3 else None

    def is_key(self, time_ns: int) -> bool:
        """Returns whether the newest keyframe has this time."""
        return bool(self.keys) and self.keys[-1].time_ns == time_ns

    def poses(self) -> list[tuple[int, Pose]]:
        """Returns (time_ns, world_from_camera) of all frames that have a pose."""
        return [(f.time_ns, f.world_from_camera) for f in self.frames if f.world_from_camera is not None]

    def predicted_pose(self) -> Pose | None:
        """Returns world_from_camera of the next frame at constant velocity; None before a triple is solved."""
        known = [f.world_from_camera for f in self.frames if f.world_from_camera is not None][-2:]
        if self.fresh or not known:
            return None
        return known[-1] @ known[0].inverse() @ known[-1]

    def with_frame(self, frame: TrackedFrame) -> KeyframeWindow:
        return replace(self, frames=(*self.frames, frame))

    def with_keyframe(self, frame: TrackedFrame) -> KeyframeWindow:
        """Adds a keyframe without a triple: one of the first two of a segment."""
        if not self.keys:
            frame = replace(frame, world_from_camera=self.base)
        return replace(self, keys=(*self.keys, frame), frames=(*self.frames, frame))

    def with_triple(self, triple: Triple, ids: NDArray[np.int64], third: TrackedFrame, scale: float) -> KeyframeWindow:
        """Adds keyframe 3 and the triple's points (N,) to the world; keyframe 2 gets its pose from the triple.

        `scale`: world units per unit of the triple.
        """
        world_from_first = self._world_from_first()
        second = world_from_first @ triple.second_from_first.inverse().scaled(scale)
        third = replace(third, world_from_camera=world_from_first @ triple.third_from_first.inverse().scaled(scale))
        window = self.with_poses({self.keys[-1].time_ns: second})
        good = triple.resected
        points = ScenePoints(ids[good], world_from_first.apply(scale * triple.xyz_in_first[good]))
        return replace(
            window,
            keys=(*window.keys, third),
            frames=(*window.frames, third),
            fresh=False,
            landmarks=window.landmarks.merged(points),
        )

    def depths_in_first(self, index: NDArray[np.int64]) -> Array:
        """Returns the depths (M,) of landmarks, by index (M,), from the first camera of the triple being solved."""
        return self._world_from_first().inverse().apply(self.landmarks.xyz[index])[:, 2]

    def _world_from_first(self) -> Pose:
        pose = self.keys[-2].world_from_camera
        if pose is None:
            raise ValueError("the first keyframe of a triple has no pose")
        return pose

    def with_new_points(self, ids: NDArray[np.int64], x: Array) -> KeyframeWindow:
        """Adds points (M,), (M, 2) that were detected in the last keyframe to it."""
        key = self.keys[-1].with_new(ids, x)
        return replace(self, keys=(*self.keys[:-1], key), frames=(*self.frames[:-1], key))

    def with_poses(self, poses: dict[int, Pose]) -> KeyframeWindow:
        """Replaces the poses of some frames; `poses` is world_from_camera by time_ns."""

        def updated(frame: TrackedFrame) -> TrackedFrame:
            pose = poses.get(frame.time_ns)
            return frame if pose is None else replace(frame, world_from_camera=pose)

        return replace(self, keys=tuple(map(updated, self.keys)), frames=tuple(map(updated, self.frames)))

    def restarted(self, frame: TrackedFrame) -> KeyframeWindow:
        """Starts a new segment with this frame as its first keyframe, at the last known pose."""
        known = self.poses()
        base = known[-1][1] if known else self.base
        starts_ns = (*self.starts_ns[1 - MAX_STARTS :], frame.time_ns)
        return KeyframeWindow(frames=self.frames, base=base, starts_ns=starts_ns).with_keyframe(frame)

    def settle(self, count: int) -> tuple[KeyframeWindow, list[tuple[int, Pose]]]:
        """Keeps the last `count` keyframes; returns the final poses of the frames before them, too.

        All but the newest MAX_WAITING frames after the last keyframe become final as well: at rest, or where nothing
        can be tracked, no keyframe follows. They keep the poses that they got at once, if any.
        """
        keys = self.keys[-count:]
        if not keys:
            return self, []
        start, last = keys[0].time_ns, keys[-1].time_ns
        waiting = [f.time_ns for f in self.frames if f.time_ns > last]
        given_up = set(waiting[:-MAX_WAITING])
        is_kept = [f.time_ns >= start and f.time_ns not in given_up for f in self.frames]
        settled = [
            (f.time_ns, f.world_from_camera)
            for f, keep in zip(self.frames, is_kept, strict=True)
            if not keep and f.world_from_camera is not None
        ]
        frames = tuple(f for f, keep in zip(self.frames, is_kept, strict=True) if keep)
        observed = np.unique(np.concatenate([k.ids for k in keys]))
        return replace(self, keys=keys, frames=frames, landmarks=self.landmarks.only(observed)), settled


@dataclass(frozen=True, eq=False)
class MonocularState:
    """What is kept from frame to frame."""

    grey: Image | None = None
    """The previous image."""
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) of the points alive in it, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px]."""
    next_id: int = 0
    window: KeyframeWindow = KeyframeWindow()
    step_scale: StepScale | None = None
    """The scale for the next triple."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Final poses, (time_ns, world_from_camera)."""


@dataclass(frozen=True, eq=False)
class WindowUpdate:
    """The changes that a frame made to the window of keyframes."""

    window: KeyframeWindow
    step_scale: StepScale | None
    decisions: tuple[Decision, ...]
    triple: Triple | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) of the triple's points."""
    scale: float | None = None
    """World units per unit of the triple."""
    lost: bool = False


# Step 1: tracking ("Feature points are tracked in the whole video frames")


@dataclass(frozen=True, eq=False)
class TrackedFeatures:
    """The points of the previous image in the new one."""

    ids: NDArray[np.int64]
    uv_prev: NDArray[np.float32]
    """(N, 2) [px] in the previous image."""
    uv: NDArray[np.float32]
    """(N, 2) [px] in the new one."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    residual_px: NDArray[np.float32]
    """(N,) reprojection errors; NaN for points that were not used for the pose."""

    @property
    def alive(self) -> NDArray[np.bool_]:
        return self.status == TrackStatus.ALIVE

    def as_frame(self, camera: Camera, time_ns: int) -> TrackedFrame:
        """Returns the points alive, in normalised coordinates."""
        return TrackedFrame(time_ns, self.ids[self.alive], camera.normalise(self.uv[self.alive]))

    def without_outliers(self, localised: Localised, update: WindowUpdate, camera: Camera) -> TrackedFeatures:
        """Ends the tracks that are outliers of the frame's pose or of the triple's relative pose."""
        status, residual, alive = self.status.copy(), self.residual_px.copy(), np.flatnonzero(self.alive)
        if (pose := localised.resection) is not None:
            residual[alive[localised.points]] = pose.distances * camera.fx
            status[alive[localised.points[~pose.inliers]]] = TrackStatus.REPROJECTION
        if update.triple is not None:
            status[np.isin(self.ids, update.ids[~update.triple.epipolar])] = TrackStatus.EPIPOLAR
        return replace(self, status=status, residual_px=residual)

    def as_tracks(self, new_uv: NDArray[np.float32], next_id: int) -> Tracks:
        """Returns all tracks and the new ones (M, 2) [px]; an ended track has its last known position."""
        nan = np.full((len(new_uv), 2), np.nan, np.float32)
        is_tracked = self.alive[:, None] | (self.status >= TrackStatus.EPIPOLAR)[:, None]
        return Tracks.of(
            np.concatenate([self.ids, next_id + np.arange(len(new_uv), dtype=np.int64)]),
            np.concatenate([np.where(is_tracked, self.uv, self.uv_prev), new_uv]),
            uv_prev=np.concatenate([self.uv_prev, nan]),
            status=np.concatenate([self.status, np.full(len(new_uv), TrackStatus.NEW, np.uint8)]),
            residual_px=np.concatenate([self.residual_px, nan[:, 0]]),
        )


def track_features(tracker: Tracker, state: MonocularState, grey: Image) -> TrackedFeatures:
    """Tracks the points of the previous image into the new one; returns no points for the first image."""
    uv, status = np.zeros((0, 2), np.float32), np.zeros(0, np.uint8)
    if state.grey is not None:
        uv, status = tracker.track(state.grey, grey, state.uv)
    return TrackedFeatures(state.ids, state.uv, uv, status, np.full(len(status), np.nan, np.float32))


def detect_new_corners(
    detector: Detector, window: KeyframeWindow, grey: Image, tracked: TrackedFeatures, time_ns: int, max_tracks: int
) -> NDArray[np.float32]:
    """Returns new corners (M, 2) [px], away from the tracked points, at a keyframe; none elsewhere."""
    if not window.is_key(time_ns):
        return np.zeros((0, 2), np.float32)
    alive = tracked.uv[tracked.alive]
    return detector.detect(grey, max_tracks, alive, CORNER_DISTANCE_PX)


# A pose for every frame at once: resection from the points of the last triple (not in the paper)


@dataclass(frozen=True, eq=False)
class Localised:
    """The pose of a frame, and the points that were used for it."""

    resection: PoseFit | None
    points: NDArray[np.int64]
    """(K,) index in the frame."""

    @property
    def pose(self) -> Pose | None:
        """world_from_camera."""
        return None if self.resection is None else self.resection.camera_from_world.inverse()


def localise(window: KeyframeWindow, frame: TrackedFrame, max_error: float) -> Localised:
    """Refines the predicted pose, or estimates it by RANSAC where that has few inliers.

    Inliers are within twice `max_error` (normalised). There is no pose before the first triple, or with too few points.
    """
    index = window.landmarks.places(frame.ids)
    known = np.flatnonzero(index >= 0)
    predicted = window.predicted_pose()
    if predicted is None or len(known) < MIN_PNP_POINTS:
        return Localised(None, known)
    xyz, x = window.landmarks.xyz[index[known]], frame.x[known]
    policy = Policy(max_error, 2 * max_error, 2 * max_error)
    best = in_own_unit(xyz, predicted.inverse(), lambda near, guess: locate(near, x, guess, policy))
    return Localised(best, known)


# Step 1: keyframes "which have large displacement but still have enough feature points"


def is_keyframe(
    window: KeyframeWindow, frame: TrackedFrame, min_parallax_deg: float, min_share: float, *, max_error: float
) -> tuple[bool, tuple[Decision, ...]]:
    """Returns whether the frame is a keyframe, and why. `max_error`: largest tracking error, normalised."""
    if not window.keys:
        return True, ()
    last = window.keys[-1]
    parallax = parallax_deg(last, frame, max_error)
    share = last.common(frame) / max(len(last.ids), 1)
    has_moved = checks.PARALLAX.of(parallax, min_parallax_deg)
    is_few, is_usable = share < min_share, parallax >= MIN_PARALLAX_SHARE * min_parallax_deg
    why = "too little parallax for a keyframe" if is_few and not is_usable else ""
    early = checks.POINTS_LEFT.of(share, min_share, why, is_few and is_usable)
    waiting = sum(f.time_ns > last.time_ns for f in window.frames)
    given_up = checks.WAITING_FRAMES.of(waiting + 1, MAX_WAITING, "the oldest keep their first poses")
    tests = (has_moved, early) if given_up.passed else (has_moved, early, given_up)
    return has_moved.passed or early.passed, tests


# Steps 2 to 4: a triple of keyframes (Fig. 3)


def triple_of(
    first: TrackedFrame,
    second: TrackedFrame,
    third: TrackedFrame,
    ids: NDArray[np.int64],
    max_error: float,
    min_angle_rad: float,
) -> tuple[Triple | None, tuple[Decision, ...]]:
    """Solves R13 and T13, the points, and R12 and T12 from the points (N,) that the three frames share.

    Returns None where too few of them are inliers. `max_error` is normalised.
    """
    triple = solve_triple(first.at(ids), second.at(ids), third.at(ids), max_error, min_angle_rad)
    epipolar = 0.0 if triple is None else float(triple.epipolar.mean())
    resected = 0 if triple is None else int(triple.resected.sum())
    decisions = (
        checks.EPIPOLAR_SHARE.of(epipolar, MIN_EPIPOLAR_SHARE, "" if triple else "no pose"),
        checks.RESECTED_POINTS.of(resected, MIN_RESECTED),
    )
    return (triple if all(d.passed for d in decisions) else None), decisions


# Step 5: scale transfer (Fig. 4)


def transfer_scale(
    triple: Triple, ids: NDArray[np.int64], window: KeyframeWindow, last: StepScale | None, transfer: ScaleTransfer
) -> tuple[StepScale, float, tuple[Decision, ...]]:
    """Returns the scale for the next triple, the world units per unit of this triple, and the decisions.

    As printed ("norm"), |T23| = |T13| - |T12|. That holds only for collinear centres: by the triangle inequality each
    bend makes the next triple too small, and the path of Fig. 8 (line B) converges to a point. "vector" uses
    |T13 - T12|, the identity that the paper states one line earlier.
    """
    t12 = float(np.linalg.norm(triple.t12))
    true_length, length = step_length(triple, "vector"), step_length(triple, transfer)
    because, shared = "", None if window.fresh else _shared_depths(triple, ids, window)
    if length <= MIN_LENGTH_SHARE * true_length:
        because = f"|T13| - |T12| = {length:.3f} cannot be a length here: |T13 - T12| used"
        length = true_length
    if last is None:
        scale, because = 1.0, "first triple, whose |T13| is the unit"
    elif transfer == "unit":
        scale = 1 / max(t12, MIN_T12)
    else:
        scale = last.length / max(t12, MIN_T12)  # |T12| of this triple is |T23| of the last one
        if transfer == "depth" and shared is not None:
            scale, because = shared.scale_or(scale)
    decision = checks.SCALE_TRANSFER.of(scale, 0.0, f"{transfer}; {because}" if because else transfer)
    return StepScale(scale * length, length / true_length), scale, (decision, *_scatter(shared, scale))


@dataclass(frozen=True)
class SharedDepths:
    """The scale by the depths of the points that this triple shares with the one before."""

    ratio: float
    """Median, in world units per unit of this triple; NaN with too few points."""
    deviation: float
    """Robust standard deviation of the logarithm of one point's ratio."""
    count: int

    def scale_or(self, fallback: float) -> tuple[float, str]:
        """Returns the scale, or `fallback` with too few points, and the reason."""
        if not np.isfinite(self.ratio):
            return fallback, f"only {self.count} shared points: |T23| used"
        return self.ratio, f"{self.count} shared points, scatter {100 * self.deviation:.1f} %"


def _shared_depths(triple: Triple, ids: NDArray[np.int64], window: KeyframeWindow) -> SharedDepths:
    index = window.landmarks.places(ids)
    shared = (index >= 0) & triple.resected
    known = window.depths_in_first(index[shared])
    ratio, deviation = depth_ratio(known, triple.xyz_in_first[shared][:, 2])
    return SharedDepths(ratio, deviation, int(shared.sum()))


def _scatter(shared: SharedDepths | None, scale: float) -> tuple[Decision, ...]:
    """Checks whether the depth ratios of the shared points are consistent, whichever formula gave the scale."""
    if shared is None or not np.isfinite(shared.ratio):
        return ()
    comparison = f"{shared.count} ratios suggest ×{shared.ratio:.3g}, used ×{scale:.3g}"
    return (checks.SCALE_SPREAD.of(100 * shared.deviation, DOUBTFUL_SCATTER, comparison),)


# Step 6: "other frames by interpolation and bundle adjustment"


def fill_between(window: KeyframeWindow, kind: Interpolation, max_error: float) -> KeyframeWindow:
    """Interpolates the frames between the last three keyframes, then refines each on the points that it observes.

    The refinement is motion-only: it recovers the camera shake that an interpolation cannot know. Inliers are within
    `max_error` (normalised).
    """
    keys = Trajectory.of([(k.time_ns, k.world_from_camera) for k in window.keys if k.world_from_camera is not None])
    start, key_times = window.keys[-3].time_ns, {k.time_ns for k in window.keys}
    between = [f for f in window.frames if f.time_ns > start and f.time_ns not in key_times]
    if not between:
        return window
    initial = interpolate(keys, np.array([f.time_ns for f in between], np.int64), kind)
    poses = {}
    for i, frame in enumerate(between):
        index = window.landmarks.places(frame.ids)
        known = index >= 0
        refined = in_own_unit(
            window.landmarks.xyz[index[known]],
            initial.pose(i).inverse(),
            lambda near, guess, x=frame.x[known]: refine_pose(near, x, guess, max_error),
        )
        poses[frame.time_ns] = initial.pose(i) if refined is None else refined.camera_from_world.inverse()
    return window.with_poses(poses)


# Section 6.4, line D of Fig. 8: local bundle adjustment


def adjust_window(window: KeyframeWindow, loss_width: float) -> tuple[KeyframeWindow, tuple[Decision, ...]]:
    """Adjusts the window's keyframes and points together; the first two keyframes fix the gauge and the scale.

    Every other frame moves with the keyframe before it. `loss_width` is normalised. Leaves the window unchanged with
    too few points or keyframes.
    """
    keys = window.keys
    indices = [window.landmarks.places(k.ids) for k in keys]
    n_observed = np.bincount(np.concatenate([i[i >= 0] for i in indices]), minlength=len(window.landmarks.ids))
    chosen = np.flatnonzero(n_observed >= 2)
    slot = np.full(len(window.landmarks.ids) + 1, -1)
    slot[chosen] = np.arange(len(chosen))
    cameras, points, x = [], [], []
    for camera, (key, index) in enumerate(zip(keys, indices, strict=True)):
        use = slot[index] >= 0
        cameras.append(np.full(use.sum(), camera))
        points.append(slot[index[use]])
        x.append(key.x[use])
    poses = tuple(k.world_from_camera.inverse() for k in keys if k.world_from_camera is not None)
    if len(chosen) < MIN_BUNDLE_POINTS or len(poses) <= FIXED_KEYFRAMES or len(poses) < len(keys):
        return window, ()
    bundle = adjust(
        poses,
        xyz_in_world=window.landmarks.xyz[chosen],
        camera_index=np.concatenate(cameras),
        point_index=np.concatenate(points),
        x=np.concatenate(x),
        fixed=FIXED_KEYFRAMES,
        scale=loss_width,
        iterations=BUNDLE_ITERATIONS,
    )
    xyz = window.landmarks.xyz.copy()
    xyz[chosen] = bundle.xyz_in_world
    adjusted = [p.inverse() for p in bundle.cameras_from_world]
    size = f"{len(keys)} key frames, {len(chosen)} points, {len(np.concatenate(points))} observations"
    decision = checks.BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0, size)
    convergence = optimised(bundle.cost_before, bundle.cost_after, bundle.iterations, BUNDLE_ITERATIONS)
    window = replace(_with_keyframe_poses(window, adjusted), landmarks=ScenePoints(window.landmarks.ids, xyz))
    return window, (decision, *convergence)


def _with_keyframe_poses(window: KeyframeWindow, adjusted: list[Pose]) -> KeyframeWindow:
    """Moves the keyframes to their adjusted world_from_camera, and each other frame as the keyframe before it."""
    poses, correction, moved = {}, Pose(), {k.time_ns: p for k, p in zip(window.keys, adjusted, strict=True)}
    for frame in window.frames:
        if frame.world_from_camera is None:
            continue
        if frame.time_ns in moved:
            poses[frame.time_ns] = moved[frame.time_ns]
            correction = moved[frame.time_ns] @ frame.world_from_camera.inverse()
        else:
            poses[frame.time_ns] = correction @ frame.world_from_camera
    return window.with_poses(poses)


# The next state, and the Step that reports the frame


def next_state(
    state: MonocularState,
    grey: Image,
    tracked: TrackedFeatures,
    new_uv: NDArray[np.float32],
    update: WindowUpdate,
    camera: Camera,
    n_keyframes: int,
) -> tuple[MonocularState, list[tuple[int, Pose]]]:
    """Returns the state after the frame, and the poses that became final as only `n_keyframes` keyframes are kept."""
    window, new_ids = update.window, state.next_id + np.arange(len(new_uv), dtype=np.int64)
    if len(new_uv):
        window = window.with_new_points(new_ids, camera.normalise(new_uv))
    window, settled = window.settle(n_keyframes)
    alive = tracked.alive
    after = MonocularState(
        grey=grey,
        ids=np.concatenate([tracked.ids[alive], new_ids]),
        uv=np.concatenate([tracked.uv[alive], new_uv]),
        next_id=state.next_id + len(new_uv),
        window=window,
        step_scale=update.step_scale,
        settled=state.settled.extended(settled),
    )
    return after, settled


def as_step(
    exposure: Frame,
    after: MonocularState,
    tracked: TrackedFeatures,
    new_uv: NDArray[np.float32],
    update: WindowUpdate,
    settled: list[tuple[int, Pose]],
    seconds: Mapping[str, float],
) -> Step:
    """Reports the frame that led to the state `after`."""
    window, residual = after.window, tracked.residual_px
    pose = window.frames[-1].world_from_camera if window.frames else None
    revised = [] if update.triple is None else [*settled, *window.poses()]
    return Step(
        exposure.time_ns,
        _status(window, pose, update),
        "video",
        pose,
        key_frame=window.is_key(exposure.time_ns),
        tracks={"video": tracked.as_tracks(new_uv, after.next_id - len(new_uv))},
        landmarks=_landmarks(exposure, after, update),
        residuals_px=residual[np.isfinite(residual) & tracked.alive],
        revised=Trajectory.of(revised, "video"),
        scale=update.scale,
        seconds=seconds,
        decisions=update.decisions,
        final_until_ns=window.final_until_ns,
        restarted=window.starts_ns[-1:] == (exposure.time_ns,),
    )


def _status(window: KeyframeWindow, pose: Pose | None, update: WindowUpdate) -> Status:
    has_map = window.landmarks.ids.size > 0
    if update.lost or (has_map and pose is None):
        return Status.LOST
    return Status.TRACKING if has_map else Status.INITIALISING


def _landmarks(exposure: Frame, after: MonocularState, update: WindowUpdate) -> Landmarks:
    """Returns the window's points that are still tracked, where the frame solved a triple."""
    if update.triple is None:
        return Landmarks.empty()
    landmarks = update.window.landmarks
    ids, here, there = np.intersect1d(after.ids, landmarks.ids, return_indices=True)
    return Landmarks(ids, landmarks.xyz[there], colours_at(exposure.image, after.uv[here]))


METHOD = Method(
    "monocular.paper",
    VIDEO,
    MonocularConfig,
    "own",
    "Li, Liu and Yuan 2013, section 6.1",
    TRANSFER,
    checks=checks.MONOCULAR,
    stages=checks.MONOCULAR_STAGES,
)
