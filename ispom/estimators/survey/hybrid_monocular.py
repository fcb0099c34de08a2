"""The hybrid method with one camera and a map of its own, as printed (Forster, Pizzoli and Scaramuzza, SVO, 2014).

Sparse alignment, feature alignment and pose refinement are those of `hybrid.py`. Depths of new corners come from motion
here, where they come from the pair there. The steps, in the order of this file:

1. The first map: corners are followed until two images and those between them give one (`first_map.py`).
2. Seeds: new corners of a keyframe are followed, and become points of the map once their rays from the keyframe and
   from the present image meet at a sufficient angle. SVO filters depths of such seeds; the angle is a simple stand-in.
3. Keyframes are adjusted together with their points (the last few; the two oldest stay as they are).

Limits. The unit is the median depth of the first map. Where the camera only rotates no seed becomes a point, and the
map is lost once it leaves the view: points that are out of sight are not found again. After that a new segment begins,
with a unit of its own.

Measured (`ispom run SOURCE --methods hybrid.monocular`), aligned with Sim(3): handheld camera over a checkerboard, 250
images of 1.1 m: ATE 1.25 mm in the 233 images from the first map on (`monocular`: 1.24 mm; SVO itself: 1.3 mm). KITTI
06, 51 images of the left camera: t_err 1.1 %; KITTI 00, the first 200 (145 m): 4.3 %, as the scale drifts by 11 %. A
pure rotation (sim:city?motion=rotation) gives no map.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
from ispom.estimators.survey import first_map, hybrid
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.first_map import (
    FOLLOW,
    LOSS_PX,
    MIN_DISTANCE_PX,
    NEW_POINT_PX,
    FirstMap,
    FirstMaps,
    Start,
)
from ispom.estimators.survey.hybrid import ALIGNED, INLIERS, MOVED, REMAINING, Keyframe, Points
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.bundle import adjust
from ispom.solvers.multiview.triangulation import parallax_rad, triangulate
from ispom.stopwatch import Stopwatch
from ispom.types import Camera, Check, Frame, Image, Landmarks, Rig, TrackStatus, as_grey, by_key, colours_at

MAX_KEYFRAMES = 8
"""Keyframes that are adjusted, and whose patches are kept."""

NEW_POINTS = Check(
    "seeds_converged", "seeds that became points of the map", "finding",
    passes="{value} corners became points of the map.", fails="No corner became a point of the map.",
)  # fmt: skip
CHECKS = by_key(*first_map.CHECKS.values(), INLIERS, ALIGNED, REMAINING, MOVED, NEW_POINTS)
STAGES = {
    "first map": first_map.STAGE,
    **{name: text for name, text in hybrid.STAGES.items() if name != "map"},
    "seeds": "Follows corners without a depth; those with enough parallax become points of the map.",
    "map": "Makes a keyframe, and adjusts the last keyframes together with their points.",
}


@dataclass(frozen=True)
class HybridMonocularConfig:
    """Settings of the hybrid method with one camera."""

    max_points: Annotated[int, Range(50, 3000), WorthTrying((2,))] = 400
    """Corners that are followed at a time, with and without a depth."""
    min_inliers: Annotated[int, Range(8, 500)] = 20
    """Least number of corners that agree with one pose; with fewer a frame is not located."""
    max_error_px: Annotated[float, Range(0.3, 20), WorthTrying((2,))] = 2.0
    """Largest reprojection error of an inlier [px]."""
    start_moved: Annotated[float, Range(0.2, 30)] = 1.0
    """Median displacement of the corners, without what a rotation explains, for a first map [% of the width]."""
    min_parallax_deg: Annotated[float, Range(0.1, 20)] = 1.5
    """Angle between two rays from which a corner becomes a point of the map [degrees]."""
    keyframe_left: Annotated[float, Range(0.1, 1)] = 0.8
    """Share of the last keyframe's points below which the frame becomes a keyframe."""
    keyframe_moved: Annotated[float, Range(0.1, 50), WorthTrying((0.5,))] = 4.0
    """Median displacement of the corners above which the frame becomes a keyframe [% of the image's width]."""
    max_lost_frames: Annotated[int, Range(0, 100)] = 5
    """Frames that may fail before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> HybridMonocular:
        return HybridMonocular(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Seeds:
    """M corners without a depth."""

    ids: NDArray[np.int64]
    key: NDArray[np.int64]
    """(M,) number of the keyframe that saw them first."""
    key_uv: NDArray[np.float32]
    uv: NDArray[np.float32]
    """(M, 2) in the last frame."""

    def __getitem__(self, some: NDArray[np.bool_]) -> Seeds:
        return Seeds(self.ids[some], self.key[some], self.key_uv[some], self.uv[some])


@dataclass(frozen=True, eq=False)
class Memory:
    """The map with its seeds, or the start of one."""

    start: Start | None = None
    map: hybrid.Memory | None = None
    seen: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0, 2), np.float32))
    """(N, K, 2) where the N points of the map were seen by its K keyframes [px]; NaN where they were not."""
    seeds: Seeds | None = None


class HybridMonocular(OneKind[Memory]):
    """Gives each frame a pose in the unit of the first map. World: the camera at the first frame of that."""

    kind, frame = "video", "video"

    def __init__(self, rig: Rig, config: HybridMonocularConfig) -> None:
        self.rig, self.config, self.camera = rig, config, rig.camera("video")
        self.first_maps = FirstMaps(self.camera, config.max_points, config.min_inliers, config.start_moved)

    def begin(self) -> Memory:
        """See OneKind."""
        return Memory()

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        grey = as_grey(frame.image)
        if memory.map is None or memory.seeds is None:
            return self._started(memory.start, frame, grey, watch)
        config, old, camera = self.config, memory.map, self.camera
        motion, aligned = hybrid.sparse_alignment(old, camera, grey, frame.time_ns)
        watch.lap("sparse alignment")
        uv, found = hybrid.feature_alignment(old, camera, grey, motion)
        watch.lap("feature alignment")
        fit = hybrid.refined(old.points, camera, uv, found, motion, config.max_error_px)
        inliers = np.zeros(len(uv), bool)
        if fit is not None:
            inliers[np.flatnonzero(found)[fit.inliers]] = True
        located = INLIERS.of(inliers.sum(), config.min_inliers)
        watch.lap("pose")
        if fit is None or not located.passed:
            if old.lost < config.max_lost_frames:
                return replace(memory, map=replace(old, lost=old.lost + 1)), Result(decisions=(aligned, located))
            start = self.first_maps.begun(grey, old.next_id, old.world_from_camera, restarted=True)
            return Memory(start), Result(decisions=(aligned, located))

        pose = fit.camera_from_world.inverse()
        pose = Pose.from_xyzw(pose.xyzw, pose.translation)
        points = replace(old.points, uv=np.where(inliers[:, None], uv, old.points.uv).astype(np.float32))
        seconds = (frame.time_ns - old.time_ns) * 1e-9
        now = replace(
            old, points=points[inliers], grey=grey, time_ns=frame.time_ns, world_from_camera=pose, lost=0,
            velocity=(old.world_from_camera.inverse() @ pose).log() / seconds,
        )  # fmt: skip
        after = Memory(None, now, memory.seen[inliers], memory.seeds)
        after, converged = self._with_seeds(after, old.grey)
        watch.lap("seeds")
        shift = np.linalg.norm(points.uv - points.last_key_uv, axis=1)[inliers]
        triggers = (
            REMAINING.of(inliers.sum() / max(old.full, 1), config.keyframe_left),
            MOVED.of(100 * np.median(shift) / grey.shape[1], config.keyframe_moved),
        )
        key_frame = any(trigger.passed for trigger in triggers)
        if key_frame:
            after = self._keyframe(after)
        assert after.map is not None
        errors_px = np.full(len(uv), np.nan)
        errors_px[found] = camera.fx * fit.distances
        tracks = hybrid.tracks_of(old.points, points, inliers, found, errors_px, after.map.points)
        watch.lap("map")
        return after, Result(
            after.map.world_from_camera, (aligned, located, *triggers, NEW_POINTS.of(converged, 1)), {"video": tracks},
            _landmarks(after.map.points, frame), errors_px[inliers], key_frame=key_frame,
        )  # fmt: skip

    # Step 1: the first map

    def _started(self, start: Start | None, frame: Frame, grey: Image, watch: Stopwatch) -> tuple[Memory, Result]:
        """Follows the corners of the start, and makes a map where they show one."""
        start, decisions, tracks, made = self.first_maps.followed(start, grey)
        watch.lap("first map")
        if made is None:
            return Memory(start), Result(decisions=decisions, tracks={"video": tracks})
        memory = self._first_map(made, frame.time_ns)
        assert memory.map is not None
        return memory, Result(
            memory.map.world_from_camera, decisions, {"video": tracks}, _landmarks(memory.map.points, frame),
            key_frame=True, restarted=start.restarted,
        )  # fmt: skip

    def _first_map(self, made: FirstMap, time_ns: int) -> Memory:
        start, second_from_first, xyz, keep = made
        unit = 1 / float(np.median(xyz[keep, 2]))
        now = start.base @ second_from_first.scaled(unit).inverse()
        keyframes = Keyframe(0, start.first, start.base), Keyframe(1, start.grey, now)
        count = int(keep.sum())
        points = Points(
            start.ids[keep], start.base.apply(unit * xyz[keep]), np.zeros(count), np.zeros(count, np.int64),
            start.first_uv[keep], start.uv[keep], start.uv[keep],
        )  # fmt: skip
        seen = np.stack([start.first_uv[keep], start.uv[keep]], axis=1)
        first = hybrid.Memory(keyframes, points, start.grey, time_ns, now, start.next_id, full=count)
        empty = Seeds(points.ids[:0], points.key[:0], points.key_uv[:0], points.uv[:0])
        return self._with_new_seeds(Memory(None, first, seen, empty))

    # Step 2: seeds

    def _with_seeds(self, memory: Memory, before: Image) -> tuple[Memory, int]:
        """Follows the seeds into the present image; those with enough parallax become points. Also their number."""
        seeds, now, camera = memory.seeds, memory.map, self.camera
        assert seeds is not None and now is not None
        uv, status = FOLLOW.track(before, now.grey, seeds.uv)
        seeds = replace(seeds, uv=uv)[status == TrackStatus.ALIVE]
        xyz, sure = np.zeros((len(seeds.ids), 3)), np.zeros(len(seeds.ids), bool)
        x_key, x_now = (camera.normalise(p.astype(float)) for p in (seeds.key_uv, seeds.uv))
        for keyframe in now.keyframes:
            some = np.flatnonzero(seeds.key == keyframe.number)
            now_from_key = now.world_from_camera.inverse() @ keyframe.world_from_camera
            if not len(some) or np.linalg.norm(now_from_key.translation) < 1e-9:
                continue
            found = triangulate(now_from_key, x_key[some], x_now[some])
            sure[some] = self._sure(now_from_key, found, x_key[some], x_now[some])
            xyz[some] = keyframe.world_from_camera.apply(found)
        if not sure.any():
            return replace(memory, seeds=seeds), 0
        new = seeds[sure]
        made = Points(new.ids, xyz[sure], np.zeros(len(new.ids)), new.key, new.key_uv, new.uv, new.uv)
        seen = np.full((len(new.ids), len(now.keyframes), 2), np.nan, np.float32)
        for k, keyframe in enumerate(now.keyframes):
            seen[new.key == keyframe.number, k] = new.key_uv[new.key == keyframe.number]
        grown = replace(now, points=now.points.joined(made))
        return Memory(None, grown, np.concatenate([memory.seen, seen]), seeds[~sure]), int(sure.sum())

    def _sure(self, now_from_key: Pose, xyz: Array, x_key: Array, x_now: Array) -> NDArray[np.bool_]:
        """Returns which points (N, 3) in the keyframe lie before both cameras, fit, and have enough parallax."""
        there = now_from_key.apply(xyz)
        ahead = np.isfinite(xyz).all(axis=1) & (xyz[:, 2] > 0) & (there[:, 2] > 0)
        safe = np.where(ahead[:, None], xyz, (0.0, 0.0, 1.0))
        there = np.where(ahead[:, None], there, (0.0, 0.0, 1.0))
        errors = [np.linalg.norm(p[:, :2] / p[:, 2:] - x, axis=1) for p, x in ((safe, x_key), (there, x_now))]
        fits = np.maximum(*errors) <= NEW_POINT_PX / self.camera.fx
        return ahead & fits & (parallax_rad(now_from_key, safe) >= np.radians(self.config.min_parallax_deg))

    def _with_new_seeds(self, memory: Memory) -> Memory:
        """Adds corners of the last keyframe where there are none."""
        now, seeds = memory.map, memory.seeds
        assert seeds is not None and now is not None
        uv = detect_spread(now.grey, self.config.max_points, np.concatenate([now.points.uv, seeds.uv]), MIN_DISTANCE_PX)
        ids, number = now.next_id + np.arange(len(uv)), now.keyframes[-1].number
        more = Seeds(
            np.concatenate([seeds.ids, ids]), np.concatenate([seeds.key, np.full(len(uv), number)]),
            np.concatenate([seeds.key_uv, uv]), np.concatenate([seeds.uv, uv]),
        )  # fmt: skip
        return replace(memory, map=replace(now, next_id=now.next_id + len(uv)), seeds=more)

    # Step 3: keyframes

    def _keyframe(self, memory: Memory) -> Memory:
        """Makes the last frame a keyframe, and adjusts the last ones with their points."""
        now, seeds = memory.map, memory.seeds
        assert seeds is not None and now is not None
        number = now.keyframes[-1].number + 1
        keyframes = (*now.keyframes, Keyframe(number, now.grey, now.world_from_camera))[-MAX_KEYFRAMES:]
        seen = np.concatenate([memory.seen, now.points.uv[:, None]], axis=1)[:, -len(keyframes) :]
        points, oldest = replace(now.points, last_key_uv=now.points.uv), keyframes[0].number
        stale = points.key < oldest
        points = replace(
            points, key=np.where(stale, number, points.key),
            key_uv=np.where(stale[:, None], points.uv, points.key_uv),
        )  # fmt: skip
        poses, xyz, keep = adjusted(keyframes, points.xyz, seen, self.camera, self.config.max_error_px)
        keyframes = tuple(replace(k, world_from_camera=p) for k, p in zip(keyframes, poses, strict=True))
        points = replace(points, xyz=xyz)[keep]
        now = replace(now, keyframes=keyframes, points=points, world_from_camera=poses[-1], full=len(points))
        return self._with_new_seeds(Memory(None, now, seen[keep], seeds[seeds.key >= oldest]))


def adjusted(
    keyframes: tuple[Keyframe, ...], xyz: Array, seen: NDArray[np.float32], camera: Camera, max_error_px: float
) -> tuple[list[Pose], Array, NDArray[np.bool_]]:
    """Returns world_from_camera of K keyframes and points (N, 3), adjusted to where they were seen (N, K, 2) [px].

    The two oldest keyframes are fixed: they hold the unit. Also which points (N,) fit in the last keyframe.
    """
    point, key = np.nonzero(np.isfinite(seen[..., 0]))
    x = camera.normalise(seen[point, key].astype(float))
    bundle = adjust(tuple(k.world_from_camera.inverse() for k in keyframes), xyz, key, point, x, 2, LOSS_PX / camera.fx)
    poses = [p.inverse() for p in bundle.cameras_from_world]
    poses = [Pose.from_xyzw(p.xyzw, p.translation) for p in poses]
    keep = np.ones(len(xyz), bool)
    keep[point[(key == len(keyframes) - 1) & (bundle.residuals > max_error_px / camera.fx)]] = False
    return poses, bundle.xyz_in_world, keep & np.isfinite(bundle.xyz_in_world).all(axis=1)


def _landmarks(points: Points, frame: Frame) -> Landmarks:
    return Landmarks(points.ids, points.xyz, colours_at(frame.image, points.uv))


METHOD = Method(
    "hybrid.monocular", VIDEO, HybridMonocularConfig, "own", "Forster, Pizzoli and Scaramuzza 2014 (SVO)",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: hybrid",
)  # fmt: skip
