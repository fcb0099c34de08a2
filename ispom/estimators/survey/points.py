"""Motion of one camera from points, with any feature: the "points" of the paper's Table 3 (Harris, SUSAN, SIFT, SURF).

The steps, in the order of this file:

1. Corners (harris, susan, shi_tomasi) are tracked from frame to frame by Lucas-Kanade; blobs and FAST corners (sift,
   surf, orb) are described, and matched with those of the last keyframe.
2. Two views: five-point relative pose of keyframes 1 and 3 by RANSAC. Three views: the points intersected from them
   must fit keyframe 2 (Hartley and Zisserman 2004; Nister 2004). The unit is the distance of keyframes 1 and 3.
3. Resection: each later frame is located from the points that it sees.
4. A frame with parallax, or few points, is a keyframe: tracks that three keyframes agree on become points.
5. Refinement: bundle adjustment of the last keyframes and their points; the two oldest are fixed.

One camera has no scale, and nothing here holds it: it drifts. Where the camera only turns, no new points can be
intersected, and it gets lost. After a loss a new segment starts from the last pose; its unit is the last distance of
keyframes. The scene is taken to be rigid; no place is recognised.

Errors after Sim(3) alignment, as for all methods of one camera (`--methods points --points.features NAME`): KITTI 06,
51 frames, 60 m; sim:city, the first 272 video frames. Frames without a pose are those before the first map.
Of surf in sim:city only the first 136 frames were measured, of orb 268; sift there before its detector found points of
low contrast.

| features   | KITTI 06: t_err | ATE    | inliers | sim:city: t_err | ATE   | without a pose |
| ---------- | --------------- | ------ | ------- | --------------- | ----- | -------------- |
| harris     | 0.9 %           | 0.07 m | 285     | 0.2 %           | 9 mm  | 17             |
| susan      | 1.0 %           | 0.09 m | 177     | 0.2 %           | 7 mm  | 39             |
| shi_tomasi | 0.7 %           | 0.04 m | 273     | 0.2 %           | 9 mm  | 18             |
| sift       | 0.9 %           | 0.06 m | 88      | 0.3 %           | 10 mm | 17             |
| surf       | 1.1 %           | 0.08 m | 83      | 0.3 % (half)    | 7 mm  | 23             |
| orb        | 1.2 %           | 0.08 m | 60      | 0.2 %           | 8 mm  | 7              |

Matching takes 0.3 s (orb) to 1.5 s (surf) of a core for an image of KITTI, tracking 0.05 s. On the first 200 frames of
KITTI 00, with two bends, harris drifts in scale by 12 % (t_err 5.1 %, `monocular` 2.2 %); 15 keyframes instead of 8 do
not change that (5.5 %).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
from ispom.estimators.adjustment import BUNDLE_COST
from ispom.estimators.paper.monocular import TrackedFeatures
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame, parallax_deg
from ispom.features.descriptors import DescriptorTracker
from ispom.features.front_ends import HARRIS, front_end, front_ends
from ispom.features.interfaces import FrontEnd
from ispom.geometry import Array, Pose
from ispom.numerics.places import common, places
from ispom.numerics.robust import Noise
from ispom.settings import Choices, Range, WorthTrying, checked
from ispom.solvers.bundle import adjust
from ispom.solvers.localisation import Policy, locate
from ispom.solvers.multiview.inverse_depth import intersect
from ispom.solvers.multiview.triple import solve_triple
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Camera,
    Check,
    Decision,
    Frame,
    Image,
    Landmarks,
    Rig,
    TrackStatus,
    as_grey,
    by_key,
    colours_at,
)

VIEWS = 3
"""Keyframes that must agree on a point."""
SIGNIFICANCE = 3.0
"""Least ratio of a new point's inverse depth and its standard deviation."""
FIXED_KEYFRAMES = 2
"""Number of keyframes that are fixed in a bundle adjustment: they define position, rotation and unit."""
ITERATIONS = 10
"""Most iterations of a bundle adjustment."""
THIN = 4
"""Multiple of `min_inliers` below which the inliers are few: each frame is a keyframe then, as the map needs points."""
LOSS_FACTOR = 3.0
"""Width of the loss over the standard deviation of a feature's position: 0.5 px at 1.5 px."""
MIN_DISTANCE_PX = 4.0
"""Least distance of a new feature from the others: FAST corners, of which only a part is found again, form clusters."""
MIN_ANGLE_RAD = np.radians(0.5)
"""Least parallax of a point of the first map."""
EARLY_SHARE = 0.5
"""Share of the required parallax that is enough before the first map if many points were lost. Near points, which move
most, leave the image first, and the parallax of the others may never get larger."""
MIN_BUNDLE_POINTS = 10
"""Least number of points for a bundle adjustment; with fewer it hardly improves the poses."""
MIN_INLIER_SHARE = 0.3
"""Least share of the points in view that must be inliers; with less a pose may be that of a moving object, or wrong."""
MIN_DEPTH_SHARE = 0.1
"""Least predicted depth, relative to the unit, of a point that is searched for: others may be passed."""
MIN_EPIPOLAR_SHARE = 0.5
"""Least share of inliers of a relative pose; with less it explains a minority of the points."""
NONE = np.zeros(0, np.int64), np.zeros((0, 2), np.float32)
"""Ids and places of no features."""

EPIPOLAR = Check(
    "points_epipolar", "share of inliers of two views", "requirement", "First map possible?",
    passes="{value:.0%} of the points fit the relative pose of keyframes 1 and 3 ({threshold:.0%} needed).",
    fails="Initialising: {value:.0%} of the points fit the relative pose of two views ({threshold:.0%} needed).",
)  # fmt: skip
THREE_VIEWS = Check(
    "points_three_views", "points that fit three views", "requirement", "First map possible?", topic="map",
    passes="First map: {value} points fit three views ({threshold} needed).",
    fails="Initialising: {value} points fit three views ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "points_inliers", "inliers of the resection", "requirement", "Located?", topic="pose",
    passes="Located: {value} points fit the pose ({threshold} needed).",
    fails="Lost: {value} points fit one pose ({threshold} needed).",
)  # fmt: skip
PARALLAX = Check(
    "points_parallax", "median displacement since the last keyframe, without rotation", "trigger", "New keyframe?",
    unit="deg",
    passes="New keyframe: the points moved by {value:.2f} degrees ({threshold} needed).",
    fails="The points moved by {value:.2f} degrees since the last keyframe ({threshold} make one).",
)  # fmt: skip
FEW = Check(
    "points_left", "inliers of the resection, for a keyframe", "trigger", "New keyframe?", "<",
    passes="New keyframe: only {value} points fit the pose (limit {threshold:.0f}).",
    fails="{value} points fit the pose: the keyframe stays (limit {threshold:.0f}).",
)  # fmt: skip
CHECKS = by_key(EPIPOLAR, THREE_VIEWS, INLIERS, PARALLAX, FEW, BUNDLE_COST)
STAGES = {
    "track": "Finds the features of the last frame in this one: by tracking, or by matching descriptors.",
    "pose": "Locates the frame: by resection from points, or by the first three keyframes.",
    "keyframe": "Makes a keyframe: intersects new points, and adjusts the last keyframes with all their points.",
    "detect": "Detects new features where there are few.",
}


@dataclass(frozen=True)
class PointsConfig:
    """Settings of the points method."""

    features: Annotated[str, Choices(front_ends), WorthTrying(values=("klt", "orb", "sift"))] = HARRIS.name
    """Features: harris, susan, shi_tomasi (tracked corners), sift, surf, orb (matched), or any other front end."""
    max_points: Annotated[int, Range(50, 3000), WorthTrying((2, 0.5))] = 1000
    """Features followed at a time."""
    max_error_px: Annotated[float, Range(0.2, 10), WorthTrying((2,))] = 1.5
    """Largest distance from an epipolar line, and half of the largest reprojection error, of an inlier [px]."""
    min_inliers: Annotated[int, Range(8, 500)] = 15
    """Least number of points that fit the pose; with fewer a frame is not located."""
    min_parallax_deg: Annotated[float, Range(0.05, 20), WorthTrying((0.5,))] = 1.0
    """Median displacement of the points since the last keyframe, without rotation, that makes the next one [deg]."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.7
    """Fewer inliers, relative to the points of the map in the last keyframe, also make a keyframe."""
    keyframes: Annotated[int, Range(3, 20), WorthTrying((2,))] = 8
    """Keyframes adjusted together."""
    max_lost_frames: Annotated[int, Range(0, 100)] = 5
    """Frames that may fail before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Points:
        return Points(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Memory:
    """The features that are searched for next, the last keyframes, and their points."""

    grey: Image | None = None
    """The image of the features: the last frame for trackers, the last keyframe for descriptors."""
    ids: NDArray[np.int64] = field(default_factory=lambda: NONE[0])
    """(N,) ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: NONE[1])
    """(N, 2) [px]."""
    shown: tuple[NDArray[np.int64], NDArray[np.float32]] = NONE
    """Ids, ascending, and places [px] of the features seen in the last frame."""
    next_id: int = 0
    keyframes: tuple[TrackedFrame, ...] = ()
    points: ScenePoints = ScenePoints()
    """Empty before the first map of a segment."""
    time_ns: int = 0
    """Of the last located frame."""
    world_from_camera: Pose = Pose()
    """Pose of the last located frame; the origin before the first one."""
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    unit: float = 1.0
    """Distance of keyframes 1 and 3 of the next segment."""
    segments: int = 0
    lost_frames: int = 0


@dataclass(frozen=True, eq=False)
class Found:
    """The result of one frame."""

    keyframes: tuple[TrackedFrame, ...]
    points: ScenePoints
    decisions: tuple[Decision, ...] = ()
    pose: Pose | None = None
    """world_from_camera."""
    is_keyframe: bool = False
    ids: NDArray[np.int64] = field(default_factory=lambda: NONE[0])
    """(K,) of the points that took part in the pose, ascending."""
    distances: Array = field(default_factory=lambda: np.zeros(0))
    """(K,) their reprojection errors, normalised."""
    is_new_map: bool = False


@dataclass(frozen=True, eq=False)
class Points(OneKind[Memory]):
    """Gives each video frame a pose in a unit of its own. World: the video camera at the first keyframe."""

    rig: Rig
    config: PointsConfig
    kind = "video"
    frame = "video"

    def begin(self) -> Memory:
        return Memory()

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        grey, camera, front = as_grey(frame.image), self.rig.camera("video"), front_end(self.config.features)
        tracked = track_features(front, camera, memory, grey, frame.time_ns)
        here = tracked.as_frame(camera, frame.time_ns)
        watch.lap("track")
        found = self._located(memory, here) if len(memory.points.ids) else self._first_map(memory, here)
        watch.lap("pose")
        if found.is_keyframe and found.pose is not None:
            found = self._with_keyframe(found, replace(here, world_from_camera=found.pose))
        watch.lap("keyframe")

        residual, status = tracked.residual_px.copy(), tracked.status.copy()
        used = places(tracked.ids, found.ids)
        residual[used] = camera.fx * found.distances
        status[used[found.distances > self._limit]] = TrackStatus.REPROJECTION
        tracked = replace(tracked, status=status, residual_px=residual)
        new_uv = np.zeros((0, 2), np.float32)
        if found.is_keyframe:
            new_uv = front.detector.detect(grey, self.config.max_points, tracked.uv[tracked.alive], MIN_DISTANCE_PX)
        watch.lap("detect")
        after = self._after(memory, found, tracked, grey, new_uv, frame.time_ns)
        if after.grey is not grey:  # a feature without a match may be matched in the next frame: it did not end
            tracked = tracked.only(tracked.status != TrackStatus.LOST)
        landmarks = _landmarks(after, frame) if found.is_keyframe else Landmarks.empty()
        return after, Result(
            found.pose, found.decisions, {"video": tracked.seen_after(memory.shown).as_tracks(new_uv, memory.next_id)},
            landmarks, tracked.residual_px[tracked.alive & np.isfinite(tracked.residual_px)].astype(float),
            key_frame=found.is_keyframe, restarted=found.is_new_map and memory.segments > 0,
        )  # fmt: skip

    @property
    def _width(self) -> float:
        """max_error_px, normalised."""
        return self.config.max_error_px / self.rig.camera("video").fx

    @property
    def _limit(self) -> float:
        """Largest reprojection error of an inlier, normalised."""
        return 2 * self._width

    # Step 2: two and three views

    def _first_map(self, memory: Memory, here: TrackedFrame) -> Found:
        """Waits for three keyframes with parallax, and solves them; begins again where too few points are left."""
        config, keys = self.config, memory.keyframes
        if not keys:
            return Found((here,), memory.points, is_keyframe=True)
        shared = THREE_VIEWS.of(keys[0].common(here), config.min_inliers)
        if not shared.passed:
            return Found((here,), memory.points, (shared,), is_keyframe=True)
        few = keys[-1].common(here) < config.min_share * len(keys[-1].ids)
        needed_deg = config.min_parallax_deg * (EARLY_SHARE if few else 1)
        moved = PARALLAX.of(parallax_deg(keys[-1], here, self._width), needed_deg)
        if not moved.passed:
            return Found(keys, memory.points, (moved,))
        if len(keys) < 2:
            return Found((*keys, here), memory.points, (moved,), is_keyframe=True)
        first, second = keys
        ids = np.intersect1d(np.intersect1d(first.ids, second.ids), here.ids)
        triple = solve_triple(first.at(ids), second.at(ids), here.at(ids), self._width, MIN_ANGLE_RAD)
        epipolar = EPIPOLAR.of(0 if triple is None else triple.epipolar.mean(), MIN_EPIPOLAR_SHARE)
        fits = THREE_VIEWS.of(0 if triple is None else triple.resected.sum(), config.min_inliers)
        if triple is None or not (epipolar.passed and fits.passed):
            return Found((second, here), memory.points, (moved, epipolar, fits), is_keyframe=True)
        world, unit = memory.world_from_camera, memory.unit
        keys = (
            replace(first, world_from_camera=world),
            replace(second, world_from_camera=world @ triple.second_from_first.inverse().scaled(unit)),
        )
        good = triple.resected
        points = ScenePoints(ids[good], world.apply(unit * triple.xyz_in_first[good]))
        pose = world @ triple.third_from_first.inverse().scaled(unit)
        return Found(keys, points, (moved, epipolar, fits), pose, is_keyframe=True, is_new_map=True)

    # Step 3: resection

    def _located(self, memory: Memory, here: TrackedFrame) -> Found:
        """Locates the frame; after too many that failed, a new segment starts with this one."""
        config, index = self.config, memory.points.places(here.ids)
        known = np.flatnonzero(index >= 0)
        predicted = predicted_pose(memory, here.time_ns)
        policy = Policy(self._width, self._limit, self._limit)
        fit = locate(memory.points.xyz[index[known]], here.x[known], predicted.inverse(), policy)
        needed = max(config.min_inliers, MIN_INLIER_SHARE * len(known))
        located = INLIERS.of(0 if fit is None else fit.inliers.sum(), needed)
        if fit is None or not located.passed:
            if memory.lost_frames < config.max_lost_frames:
                return Found(memory.keyframes, memory.points, (located,))
            return Found((here,), ScenePoints(), (located,), is_keyframe=True)
        pose = fit.camera_from_world.inverse()
        # Predictions are made of poses and poses of predictions: rounding errors would grow without this.
        here = replace(here, world_from_camera=Pose.from_xyzw(pose.xyzw, pose.translation))
        last = memory.keyframes[-1]
        moved = PARALLAX.of(parallax_deg(last, here, self._width), config.min_parallax_deg)
        few = FEW.of(
            fit.inliers.sum(), max(config.min_share * memory.points.count(last.ids), THIN * config.min_inliers)
        )  # fmt: skip
        return Found(
            memory.keyframes, memory.points, (located, moved, few), here.pose, moved.passed or few.passed,
            here.ids[known], fit.distances,
        )  # fmt: skip

    # Steps 4 and 5: new points, and refinement

    def _with_keyframe(self, found: Found, here: TrackedFrame) -> Found:
        """Adds the keyframe without its outliers, and the points that three keyframes agree on; adjusts all."""
        here = here.without(found.ids[found.distances > self._limit])
        keys = (*found.keyframes, here)[-self.config.keyframes :]
        points = intersected(keys, found.points, self._width, self._limit)
        keys, points, cost = refined(keys, points, self._width, self._limit)
        return replace(found, keyframes=keys, points=points, decisions=(*found.decisions, *cost), pose=keys[-1].pose)

    def _after(
        self, memory: Memory, found: Found, tracked: TrackedFeatures, grey: Image, new_uv: NDArray[np.float32],
        time_ns: int,
    ) -> Memory:  # fmt: skip
        """Returns the memory after the frame."""
        keys, alive, new_ids = found.keyframes, tracked.alive, memory.next_id + np.arange(len(new_uv))
        ids, uv = np.concatenate([tracked.ids[alive], new_ids]), np.concatenate([tracked.uv[alive], new_uv])
        if found.is_keyframe:
            keys = (*keys[:-1], keys[-1].with_new(new_ids, self.rig.camera("video").normalise(new_uv)))
        after = replace(
            memory, grey=grey, ids=ids, uv=uv, shown=(ids, uv), next_id=memory.next_id + len(new_uv),
            keyframes=keys, points=found.points, lost_frames=0,
        )  # fmt: skip
        if not found.is_keyframe and isinstance(front_end(self.config.features).tracker, DescriptorTracker):
            left = alive | (tracked.status == TrackStatus.LOST)
            after = replace(after, grey=memory.grey, ids=memory.ids[left], uv=memory.uv[left])
        if found.pose is None:
            ended = len(memory.points.ids) and not len(found.points.ids)
            unit = _span(memory.keyframes) if ended else memory.unit
            lost = memory.lost_frames + 1 if len(found.points.ids) else 0
            return replace(after, unit=unit, lost_frames=lost, velocity=np.zeros(6) if ended else memory.velocity)
        velocity = np.zeros(6)
        if not found.is_new_map:
            velocity = (memory.world_from_camera.inverse() @ found.pose).log() / ((time_ns - memory.time_ns) * 1e-9)
        segments = memory.segments + found.is_new_map
        return replace(after, time_ns=time_ns, world_from_camera=found.pose, velocity=velocity, segments=segments)


# Step 1: tracking, or describing and matching


@dataclass(frozen=True, eq=False)
class Followed(TrackedFeatures):
    """The features of `Memory` in a new frame."""

    def only(self, some: NDArray[np.bool_]) -> Followed:
        return Followed(
            self.ids[some], self.uv_prev[some], self.uv[some], self.status[some], self.residual_px[some]
        )  # fmt: skip

    def seen_after(self, shown: tuple[NDArray[np.int64], NDArray[np.float32]]) -> Followed:
        """Returns them with their places in the last frame, NaN where they were not seen in it; not the lost ones."""
        index = places(shown[0], self.ids)
        last = np.append(shown[1], np.full((1, 2), np.nan, np.float32), axis=0)[index]
        return replace(self, uv_prev=np.where(self.alive[:, None], last, self.uv_prev))


def track_features(front: FrontEnd, camera: Camera, memory: Memory, grey: Image, time_ns: int) -> Followed:
    """Returns the features in this frame; none in the first frame.

    Those that were not found but have a place in the map are searched for again, near where the predicted pose has it.
    """
    uv, status = NONE[1], np.zeros(0, np.uint8)
    if memory.grey is not None:
        uv, status = front.tracker.track(memory.grey, grey, memory.uv)
        index = memory.points.places(memory.ids)
        again = np.flatnonzero((status != TrackStatus.ALIVE) & (index >= 0))
        near = predicted_pose(memory, time_ns).inverse().apply(memory.points.xyz[index[again]])
        ahead = near[:, 2] > MIN_DEPTH_SHARE * memory.unit
        again, expected = again[ahead], camera.project(near[ahead]).astype(np.float32)
        uv[again], status[again] = front.guided.track(memory.grey, grey, memory.uv[again], expected)
    return Followed(memory.ids, memory.uv, uv, status, np.full(len(status), np.nan, np.float32))


def predicted_pose(memory: Memory, time_ns: int) -> Pose:
    """Returns world_from_camera at constant velocity."""
    return memory.world_from_camera @ Pose.exp((time_ns - memory.time_ns) * 1e-9 * memory.velocity)


def intersected(keys: tuple[TrackedFrame, ...], points: ScenePoints, width: float, limit: float) -> ScenePoints:
    """Returns the points with those that at least three keyframes see, and that fit all of them within `limit`."""
    ids, cameras = np.concatenate([k.ids for k in keys]), np.repeat(np.arange(len(keys)), [len(k.ids) for k in keys])
    known, owners, counts = np.unique(ids, return_inverse=True, return_counts=True)
    fresh = (counts >= VIEWS) & (points.places(known) < 0)
    number = np.where(fresh, np.cumsum(fresh) - 1, -1)[owners]
    order = np.lexsort((cameras, number))[np.count_nonzero(number < 0) :]
    poses = [key.pose.inverse() for key in keys]
    found = intersect(
        np.stack([pose.rotation for pose in poses]), np.stack([pose.translation for pose in poses]), cameras[order],
        number[order], np.concatenate([k.x for k in keys])[order], int(fresh.sum()),
        Noise(width / LOSS_FACTOR, LOSS_FACTOR),
    )  # fmt: skip
    good = (found.depth > 0) & (found.worst <= limit) & (found.significance >= SIGNIFICANCE)
    return points.merged(ScenePoints(known[fresh][good], found.xyz_in_world[good]))


def refined(
    keys: tuple[TrackedFrame, ...], points: ScenePoints, width: float, limit: float
) -> tuple[tuple[TrackedFrame, ...], ScenePoints, tuple[Decision, ...]]:
    """Adjusts keyframes and points together, and drops the points that then do not fit within `limit`."""
    every, counts = np.unique(np.concatenate([key.ids for key in keys]), return_counts=True)
    points = points.only(every[counts >= 2])
    if len(points.ids) < MIN_BUNDLE_POINTS:
        return keys, points, ()
    index = [points.places(key.ids) for key in keys]
    owners = np.concatenate([i[i >= 0] for i in index])
    bundle = adjust(
        tuple(key.pose.inverse() for key in keys),
        points.xyz,
        np.repeat(np.arange(len(keys)), [np.count_nonzero(i >= 0) for i in index]),
        owners,
        np.concatenate([key.x[i >= 0] for key, i in zip(keys, index, strict=True)]),
        FIXED_KEYFRAMES,
        width,
        ITERATIONS,
    )
    worst = np.zeros(len(points.ids))
    np.maximum.at(worst, owners, bundle.residuals)
    cost = BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0)
    poses = (pose.inverse() for pose in bundle.cameras_from_world)
    keys = tuple(replace(key, world_from_camera=pose) for key, pose in zip(keys, poses, strict=True))
    good = worst <= limit
    return keys, ScenePoints(points.ids[good], bundle.xyz_in_world[good]), (cost,)


def _span(keys: tuple[TrackedFrame, ...]) -> float:
    """Returns the distance of the last keyframe and the second last before it."""
    return float(np.linalg.norm(keys[-1].pose.translation - keys[-VIEWS].pose.translation))


def _landmarks(memory: Memory, frame: Frame) -> Landmarks:
    """Returns the points that are followed in this frame."""
    here, there = common(memory.ids, memory.points.ids)
    return Landmarks(memory.ids[here], memory.points.xyz[there], colours_at(frame.image, memory.uv[here]))


METHOD = Method(
    "points", VIDEO, PointsConfig, "own", "Hartley and Zisserman 2004; Triggs, McLauchlan, Hartley and Fitzgibbon 2000",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: points",
)  # fmt: skip
