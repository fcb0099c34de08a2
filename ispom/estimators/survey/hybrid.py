"""Motion of a stereo camera from intensities around Shi-Tomasi corners, then from the corners: the paper's "hybrid"
class with one camera (Forster, Pizzoli and Scaramuzza, SVO: Fast Semi-Direct Monocular Visual Odometry, 2014; with
depths from a pair as in Forster et al., SVO for Monocular and Multi-Camera Systems, 2017).

The steps, in the order of this file:

1. Sparse image alignment (section IV-A of 2014): the motion since the last image is the one under which small patches
   around all known corners keep their intensities. No corner is matched by itself.
2. Feature alignment (IV-B): each corner's patch in its keyframe is warped to the present view as a plane, and aligned
   near the predicted position by inverse compositional Lucas-Kanade. Patches come from the keyframe that observed the
   corner first, so that positions do not drift from image to image.
3. Pose refinement (IV-C): the pose with the least reprojection errors of the 3-D points.
4. Mapping (V): if the view has changed, the frame becomes a keyframe. New corners get their depth from the pair at
   once, which replaces SVO's depth filter. Depths of known points are averaged with those of the new pair.

Limits. As `direct`, the method needs motions near one of its guesses and intensities that stay; as any method with
corners, it needs texture. A large object that moves with most corners is taken for the scene. No pose is revised later:
it drifts. No covariance is given: that of one pose refinement takes the map as exact.

Measured (`ispom run SOURCE --methods hybrid`): KITTI 06, the first 51 pairs of 59.9 m: t_err 1.2 %, ATE 0.15 m; in the
same measure `direct` has 1.3 %. sim:city, 30 pairs of 16 m: 0.03 %. EuRoC V1_01 at rest, 20 pairs: 0.6 mm.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.photometric import align, guesses_around, pyramid, square_patch
from ispom.features import patches
from ispom.features.row_search import PointSearch
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.localisation import PoseFit, fit_pose
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Camera,
    Check,
    Decision,
    Frame,
    Image,
    Landmarks,
    Rig,
    Tracks,
    TrackStatus,
    as_grey,
    by_key,
    colours_at,
)

PATCH = square_patch(4)
"""Patch of sparse alignment, as in SVO; that of feature alignment has 11 x 11 pixels."""
MAX_SHIFT_PX = 5.0
"""Feature alignment moves a corner by no more."""
MIN_CORRELATION = 0.8
"""Least correlation of a patch with the image at the position that was found."""
MIN_DISTANCE_PX = 10.0
"""Least distance between corners."""
MIN_DISPARITY_PX, MAX_DEVIATION_PX = 0.5, 0.5
"""Corners with a smaller disparity, or a larger standard deviation of it, have no depth."""
LEAST_DEVIATION_PX = 0.1
"""Least standard deviation of a disparity. Matching states less where texture is strong, but rectification is no
better than this."""
LOSS_PX = 0.7
"""Width of the robust loss of a reprojection error, about twice the deviation of a corner."""
MAX_KEYFRAMES = 5
"""Keyframes whose patches are kept; corners of an older one that are still seen get their patch from a new one."""

POINTS = Check(
    "hybrid_points", "corners with a depth", "requirement", "Keyframe possible?",
    passes="{value} corners of the pair have a depth ({threshold} needed).",
    fails="No map: {value} corners of the pair have a depth ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "aligned_inliers", "aligned corners that agree with one pose", "requirement", "Located?", topic="pose",
    passes="Located: {value} aligned corners agree with one pose ({threshold} needed).",
    fails="Lost: {value} aligned corners agree with one pose ({threshold} needed).",
)  # fmt: skip
ALIGNED = Check(
    "similar_share", "share of patches that sparse alignment finds similar", "finding",
    passes="Sparse alignment: {value:.0%} of the patches look the same ({threshold:.0%} expected).",
    fails="Sparse alignment: only {value:.0%} of the patches look the same ({threshold:.0%} expected).",
)  # fmt: skip
REMAINING = Check(
    "points_left", "share of the last keyframe's corners that are left", "trigger", "New keyframe?", relation="<",
    passes="New keyframe: {value:.0%} of the last keyframe's corners are left (limit {threshold:.0%}).",
    fails="{value:.0%} of the last keyframe's corners are left: no keyframe (limit {threshold:.0%}).",
)  # fmt: skip
MOVED = Check(
    "corners_moved", "median displacement of the corners", "trigger", "New keyframe?", unit="% of the width",
    passes="New keyframe: the corners moved by {value:.1f} % of the width (limit {threshold} %).",
    fails="The corners moved by {value:.1f} % of the width: no keyframe (limit {threshold} %).",
)  # fmt: skip
CHECKS = by_key(POINTS, INLIERS, ALIGNED, REMAINING, MOVED)
STAGES = {
    "sparse alignment": "Finds the motion under which the patches around all corners keep their intensities.",
    "feature alignment": "Finds each corner's patch near where this motion puts it.",
    "pose": "Finds the pose under which the 3-D points lie best where their corners were found.",
    "map": "Makes a keyframe: new corners, and depths from the pair.",
}
EXPECTED_SIMILAR = 0.5


@dataclass(frozen=True)
class HybridConfig:
    """Settings of the hybrid method."""

    max_points: Annotated[int, Range(50, 3000), WorthTrying((2,))] = 400
    """Corners that are followed at a time."""
    min_inliers: Annotated[int, Range(6, 500)] = 20
    """Least number of corners that agree with one pose; with fewer a frame is not located."""
    max_error_px: Annotated[float, Range(0.3, 20), WorthTrying((2,))] = 2.0
    """Largest reprojection error of an inlier [px]."""
    keyframe_left: Annotated[float, Range(0.1, 1)] = 0.7
    """Share of the last keyframe's corners below which the frame becomes a keyframe."""
    keyframe_moved: Annotated[float, Range(0.1, 50), WorthTrying((0.5,))] = 4.0
    """Median displacement of the corners above which the frame becomes a keyframe [% of the image's width]."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Hybrid:
        return Hybrid(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Keyframe:
    """An image that gives patches."""

    number: int
    grey: Image
    world_from_camera: Pose


@dataclass(frozen=True, eq=False)
class Points:
    """N points of the map that the last frame saw."""

    ids: NDArray[np.int64]
    xyz: Array
    """(N, 3) in the world."""
    sigma: Array
    """(N,) standard deviation of the distance [m]; in keyframes it is measured again."""
    key: NDArray[np.int64]
    """(N,) number of the keyframe whose patch it has."""
    key_uv: NDArray[np.float32]
    """(N, 2) in that keyframe [px]."""
    uv: NDArray[np.float32]
    """(N, 2) in the last located frame [px]."""
    last_key_uv: NDArray[np.float32]
    """(N, 2) in the last keyframe [px]."""

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, some: NDArray[np.bool_]) -> Points:
        return Points(*(getattr(self, name)[some] for name in self.__dataclass_fields__))

    def joined(self, more: Points) -> Points:
        return Points(*(np.concatenate([getattr(a, n) for a in (self, more)]) for n in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Memory:
    """The map, and the last located frame."""

    keyframes: tuple[Keyframe, ...]
    points: Points
    grey: Image
    time_ns: int
    world_from_camera: Pose
    next_id: int
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    full: int = 0
    """Number of points right after the last keyframe."""
    lost: int = 0


@dataclass(frozen=True, eq=False)
class Hybrid(OneKind["Memory | None"]):
    """Gives each pair a metric pose. World: the rig at the first pair."""

    rig: Rig
    config: HybridConfig
    kind = "stereo"
    frame = "rig"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        grey = as_grey(frame.left)
        if memory is None:
            return self._begun(None, frame, grey, watch, ())
        camera = self.rig.camera("left")
        motion, aligned = sparse_alignment(memory, camera, grey, frame.time_ns)
        watch.lap("sparse alignment")
        uv, found = feature_alignment(memory, camera, grey, motion)
        watch.lap("feature alignment")
        fit = refined(memory.points, camera, uv, found, motion, self.config.max_error_px)
        inliers = np.zeros(len(uv), bool)
        if fit is not None:
            inliers[np.flatnonzero(found)[fit.inliers]] = True
        located = INLIERS.of(inliers.sum(), self.config.min_inliers)
        decisions = (aligned, located)
        watch.lap("pose")
        if fit is None or not located.passed:
            if memory.lost < self.config.max_lost_pairs:
                return replace(memory, lost=memory.lost + 1), Result(decisions=decisions)
            return self._begun(memory, frame, grey, watch, decisions)

        pose = fit.camera_from_world.inverse()
        pose = Pose.from_xyzw(pose.xyzw, pose.translation)
        points = replace(memory.points, uv=np.where(inliers[:, None], uv, memory.points.uv).astype(np.float32))
        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        after = replace(
            memory, points=points[inliers], grey=grey, time_ns=frame.time_ns, world_from_camera=pose, lost=0,
            velocity=(memory.world_from_camera.inverse() @ pose).log() / seconds,
        )  # fmt: skip
        shift = np.linalg.norm(after.points.uv - after.points.last_key_uv, axis=1)
        triggers = (
            REMAINING.of(inliers.sum() / max(memory.full, 1), self.config.keyframe_left),
            MOVED.of(100 * np.median(shift) / grey.shape[1], self.config.keyframe_moved),
        )
        errors_px = np.full(len(uv), np.nan)
        errors_px[found] = camera.fx * fit.distances
        key_frame = any(trigger.passed for trigger in triggers)
        if key_frame:
            after = self._keyframe(after, frame)
        tracks = tracks_of(memory.points, points, inliers, found, errors_px, after.points)
        watch.lap("map")
        return after, Result(
            pose @ self.rig.rig_from_left.inverse(), (*decisions, *triggers), {"left": tracks},
            _landmarks(after.points, frame) if key_frame else Landmarks.empty(), errors_px[inliers],
            key_frame=key_frame,
        )  # fmt: skip

    def _begun(
        self, memory: Memory | None, frame: Frame, grey: Image, watch: Stopwatch, decisions: tuple[Decision, ...]
    ) -> tuple[Memory | None, Result]:
        """Begins at a pair: the first one, or after a loss at the last known pose."""
        pose = self.rig.rig_from_left if memory is None else memory.world_from_camera
        first_id = 0 if memory is None else memory.next_id
        after = self._keyframe(Memory((), nothing(), grey, frame.time_ns, pose, first_id), frame)
        points = POINTS.of(len(after.points), self.config.min_inliers)
        watch.lap("map")
        if not points.passed:
            return memory, Result(decisions=(*decisions, points))
        new = after.points
        return after, Result(
            pose @ self.rig.rig_from_left.inverse(), (*decisions, points),
            {"left": Tracks.of(new.ids, new.uv, status=np.full(len(new), TrackStatus.NEW))},
            _landmarks(after.points, frame), key_frame=True, restarted=memory is not None,
        )  # fmt: skip

    # Step 4: the map

    def _keyframe(self, memory: Memory, frame: Frame) -> Memory:
        """Returns the memory with the last located frame as a keyframe."""
        camera, baseline, old = self.rig.camera("left"), self.rig.baseline_m, memory.points
        number = memory.keyframes[-1].number + 1 if memory.keyframes else 0
        keyframes = (*memory.keyframes, Keyframe(number, memory.grey, memory.world_from_camera))[-MAX_KEYFRAMES:]
        new_uv = detect_spread(memory.grey, self.config.max_points, old.uv, MIN_DISTANCE_PX)
        uv = np.concatenate([old.uv, new_uv])
        matches = PointSearch().search(memory.grey, as_grey(frame.right), uv)
        known = (matches.disparity_px >= MIN_DISPARITY_PX) & (matches.deviations_px <= MAX_DEVIATION_PX)
        measured = np.where(known, matches.disparity_px, 0.0).astype(float)
        information = np.where(known, 1 / np.maximum(matches.deviations_px, LEAST_DEVIATION_PX) ** 2, 0.0)

        # Disparities are averaged, as their errors are normal ones; those of depths are not.
        depth, per_disparity = memory.world_from_camera.inverse().apply(old.xyz)[:, 2], camera.fx * baseline
        predicted, before = np.zeros(len(uv)), np.zeros(len(uv))
        predicted[: len(old)] = per_disparity / depth
        before[: len(old)] = (depth**2 / (per_disparity * old.sigma)) ** 2
        total = information + before
        keep = total > 0
        disparity = (information * measured + before * predicted) / np.maximum(total, 1e-12)
        sigma = per_disparity / np.maximum(disparity, 1e-9) ** 2 / np.sqrt(np.maximum(total, 1e-12))
        xyz = memory.world_from_camera.apply(points_from_disparity(camera, baseline, uv, disparity))
        blank = np.full(len(new_uv), number)
        all_points = Points(
            np.concatenate([old.ids, memory.next_id + np.arange(len(new_uv))]), xyz, sigma,
            np.concatenate([old.key, blank]), np.concatenate([old.key_uv, new_uv]), uv, uv,
        )  # fmt: skip
        stale = all_points.key < keyframes[0].number
        all_points = replace(
            all_points, key=np.where(stale, number, all_points.key),
            key_uv=np.where(stale[:, None], uv, all_points.key_uv),
        )  # fmt: skip
        return replace(
            memory, keyframes=keyframes, points=all_points[keep], next_id=memory.next_id + len(new_uv),
            full=int(keep.sum()),
        )  # fmt: skip


def nothing() -> Points:
    """Returns no points."""
    floats, none = np.zeros((0, 2), np.float32), np.zeros(0, np.int64)
    return Points(none, np.zeros((0, 3)), np.zeros(0), none, floats, floats, floats)


# Step 1


def sparse_alignment(memory: Memory, camera: Camera, grey: Image, time_ns: int) -> tuple[Pose, Decision]:
    """Returns world_from_camera of the image under which the patches around the corners keep their intensities."""
    points, seconds = memory.points, (time_ns - memory.time_ns) * 1e-9
    predicted = Pose.exp(seconds * memory.velocity)
    depth = memory.world_from_camera.inverse().apply(points.xyz)[:, 2]
    candidates = guesses_around(predicted.inverse(), Pose(), depth)
    found = align(
        camera, pyramid(memory.grey), points.uv.astype(float), depth, pyramid(grey), candidates, PATCH
    )  # fmt: skip
    if found is None:
        return memory.world_from_camera @ predicted, ALIGNED.of(0.0, EXPECTED_SIMILAR)
    return memory.world_from_camera @ found.pose.inverse(), ALIGNED.of(found.similar.mean(), EXPECTED_SIMILAR)


# Step 2


def feature_alignment(
    memory: Memory, camera: Camera, grey: Image, world_from_camera: Pose
) -> tuple[Array, NDArray[np.bool_]]:
    """Returns where the corners are in the image (N, 2) [px], and which of them (N,) were found."""
    points, camera_from_world = memory.points, world_from_camera.inverse()
    xyz = camera_from_world.apply(points.xyz)
    predicted = camera.project(xyz)
    uv, found = np.where(np.isfinite(predicted), predicted, -1e3), np.zeros(len(points), bool)
    for keyframe in memory.keyframes:
        some = np.flatnonzero((points.key == keyframe.number) & np.isfinite(predicted).all(axis=1))
        if not len(some):
            continue
        key_from_camera = keyframe.world_from_camera.inverse() @ world_from_camera
        warps, bends = patches.warps_of(
            camera, key_from_camera.rotation[None], key_from_camera.translation[None], xyz[some]
        )
        at, correlation = patches.align(
            keyframe.grey, points.key_uv[some], grey, uv[some], warps, bends=bends
        )  # fmt: skip
        near = np.linalg.norm(at - uv[some], axis=1) <= MAX_SHIFT_PX
        found[some] = near & (correlation >= MIN_CORRELATION)
        uv[some] = at
    return uv, found


# Step 3


def refined(
    points: Points, camera: Camera, uv: Array, found: NDArray[np.bool_], guess: Pose, max_error_px: float
) -> PoseFit | None:
    """Returns camera_from_world from those corners that were found."""
    x = camera.normalise(uv[found])
    return fit_pose(points.xyz[found], x, guess.inverse(), LOSS_PX / camera.fx, max_error_px / camera.fx)


# What is shown


def tracks_of(
    before: Points, now: Points, inliers: NDArray[np.bool_], found: NDArray[np.bool_], errors_px: Array, after: Points
) -> Tracks:
    """Returns the points of the last frame, those that ended where they were last, and the new ones `after` it."""
    status = np.where(found, TrackStatus.REPROJECTION, TrackStatus.LOST)
    status[inliers] = TrackStatus.ALIVE
    new = ~np.isin(after.ids, before.ids)
    gap = np.full(int(new.sum()), np.nan)
    return Tracks.of(
        np.concatenate([before.ids, after.ids[new]]),
        np.concatenate([now.uv, after.uv[new]]),
        uv_prev=np.concatenate([before.uv, np.column_stack([gap, gap])]),
        status=np.concatenate([status, np.full(len(gap), TrackStatus.NEW)]),
        residual_px=np.concatenate([np.where(inliers, errors_px, np.nan), gap]),
    )


def _landmarks(points: Points, frame: Frame) -> Landmarks:
    return Landmarks(points.ids, points.xyz, colours_at(frame.left, points.uv))


METHOD = Method(
    "hybrid", STEREO, HybridConfig, "metric", "Forster, Pizzoli and Scaramuzza 2014 (SVO)",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: hybrid",
)  # fmt: skip
