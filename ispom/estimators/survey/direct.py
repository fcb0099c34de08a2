"""Motion of a stereo camera directly from intensities and a depth field, without correspondences: the paper's "direct"
class with one camera (Irani and Anandan, About Direct Methods, 1999; Comport, Malis and Rives, Accurate Quadrifocal
Tracking for Robust 3D Visual Odometry, 2007; Kerl, Sturm and Cremers, Robust Odometry Estimation for RGB-D Cameras,
2013; pixels with a gradient only, as Engel, Sturm and Cremers, Semi-Dense Visual Odometry, 2013).

The steps, in the order of this file:

1. A keyframe is a pair. The pixel with the steepest gradient of each grid cell of its left image is found in the right
   one, along the row: its depth. These pixels are the semi-dense depth field.
2. The motion to the present left image is the one under which the patches around these pixels keep their intensities:
   Gauss-Newton over a pyramid, with a robust loss and one gain and offset of the whole image (`photometric.py`). It
   begins at a constant velocity and at several other guesses, the best of which goes on.
3. A frame is located where enough patches look the same at their new places. It becomes the next keyframe where too few
   of them do, or where the pixels have moved far.

Limits. The intensities must stay: a light that moves, or shadows, look like a motion. Motions must be near one of the
guesses, within some pixels of the smallest image. A large object that moves with most patches is taken for the scene.
Pixels that are neither textured along the row nor near the cameras have no depth, and take no part. No pose is revised
later, and no covariance is given: neighbouring pixels share their errors, which no simple formula covers.

Measured (`ispom run SOURCE --methods direct`): KITTI 06, the first 51 pairs of 59.9 m: t_err 1.3 %, rotation within
0.02 degrees from pair to pair (median). sim:city, 60 pairs of 33 m: 0.01 %. EuRoC V1_01 at rest, 20 pairs: 0.6 mm.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result, tracks_between
from ispom.estimators.survey.photometric import Alignment, align, guesses_around, pyramid, square_patch, textured
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Landmarks, Rig, as_grey, by_key, colours_at

PATCH = square_patch(4)
BORDER_PX = 8
MIN_DISPARITY_PX = 0.5
"""Points with a smaller disparity have no depth."""
MAX_DEVIATION_PX = 0.5
"""Largest standard deviation of a disparity."""

POINTS = Check(
    "depth_points", "pixels with a gradient and a depth", "requirement", "Keyframe possible?",
    passes="{value} pixels of the pair have a gradient and a depth ({threshold} needed).",
    fails="No depth field: {value} pixels of the pair have a gradient and a depth ({threshold} needed).",
)  # fmt: skip
SIMILAR = Check(
    "similar_patches", "share of patches that look the same", "requirement", "Located?", topic="pose",
    passes="Located: {value:.0%} of the patches of the keyframe look the same in the frame ({threshold:.0%} needed).",
    fails="Lost: {value:.0%} of the patches of the keyframe look the same in the frame ({threshold:.0%} needed).",
)  # fmt: skip
OVERLAP = Check(
    "low_similarity", "share of patches that look the same", "trigger", "New keyframe?", relation="<",
    passes="New keyframe: {value:.0%} of the patches look the same (limit {threshold:.0%}).",
    fails="{value:.0%} of the patches look the same: the keyframe stays (limit {threshold:.0%}).",
)  # fmt: skip
MOVED = Check(
    "pixels_moved", "median displacement of the pixels", "trigger", "New keyframe?", unit="% of the width",
    passes="New keyframe: the pixels moved by {value:.1f} % of the width (limit {threshold} %).",
    fails="The pixels moved by {value:.1f} % of the width: the keyframe stays (limit {threshold} %).",
)  # fmt: skip
CHECKS = by_key(POINTS, SIMILAR, OVERLAP, MOVED)
STAGES = {
    "align": "Finds the motion under which the intensities around the pixels of the keyframe stay the same.",
    "depth": "Makes a keyframe: selects pixels with a gradient and finds their depth in the right image.",
}


@dataclass(frozen=True)
class DirectConfig:
    """Settings of the direct method."""

    max_points: Annotated[int, Range(100, 10000), WorthTrying((2,))] = 2000
    """Pixels of a keyframe: cells of the grid, each of which gives the one with the steepest gradient."""
    min_gradient: Annotated[float, Range(0.5, 50), WorthTrying((0.5,))] = 4.0
    """Least gradient of a pixel [grey levels per px]; noise of a camera is below 2."""
    min_points: Annotated[int, Range(20, 2000)] = 60
    """A pair with fewer pixels that have a depth is no keyframe."""
    min_similar: Annotated[float, Range(0.05, 0.9)] = 0.25
    """Least share of patches that look the same for a frame to be located."""
    keyframe_similar: Annotated[float, Range(0.1, 1), WorthTrying((0.5,))] = 0.8
    """With a smaller share the frame becomes a keyframe."""
    keyframe_moved: Annotated[float, Range(0.1, 50), WorthTrying((0.5,))] = 3.0
    """With a larger median displacement of the pixels the frame becomes a keyframe [% of the image's width]."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the keyframe before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Direct:
        return Direct(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A pair with its depth field of N pixels."""

    grey: Image
    """The left image."""
    ids: NDArray[np.int64]
    uv: NDArray[np.float32]
    disparity_px: NDArray[np.float32]
    world_from_left: Pose


@dataclass(frozen=True, eq=False)
class Memory:
    """The keyframe, and the last motion."""

    keyframe: Keyframe
    next_id: int
    time_ns: int
    """Of the last located pair."""
    world_from_left: Pose
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    uv: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) the keyframe's pixels in the last pair [px]; NaN where they were not found."""
    lost_pairs: int = 0


@dataclass(frozen=True, eq=False)
class Direct(OneKind["Memory | None"]):
    """Gives each pair a metric pose relative to the last keyframe. World: the rig at the first pair."""

    rig: Rig
    config: DirectConfig
    kind = "stereo"
    frame = "rig"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        left = as_grey(frame.left)
        if memory is None:
            return self._begun(None, frame, left, watch, self.rig.rig_from_left, ())
        found, similar = self._aligned(memory, left, frame.time_ns), np.zeros(len(memory.keyframe.ids), bool)
        if found is not None:
            similar = found.similar
        located = SIMILAR.of(similar.mean(), self.config.min_similar)
        watch.lap("align")
        if found is None or not located.passed:
            if memory.lost_pairs < self.config.max_lost_pairs:
                return replace(memory, lost_pairs=memory.lost_pairs + 1), Result(decisions=(located,))
            return self._begun(memory, frame, left, watch, memory.world_from_left, (located,))

        keyframe = memory.keyframe
        pose = keyframe.world_from_left @ found.pose.inverse()
        # Predictions are made of poses and poses of predictions: rounding errors would grow without this.
        pose = Pose.from_xyzw(pose.xyzw, pose.translation)
        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        after = replace(
            memory, time_ns=frame.time_ns, world_from_left=pose, uv=found.uv, lost_pairs=0,
            velocity=(memory.world_from_left.inverse() @ pose).log() / seconds,
        )  # fmt: skip
        shift = np.linalg.norm(found.uv - keyframe.uv, axis=1)[similar]
        triggers = (
            OVERLAP.of(similar.mean(), self.config.keyframe_similar),
            MOVED.of(100 * np.median(shift) / left.shape[1], self.config.keyframe_moved),
        )
        result = self._result(memory, frame, found, similar, pose, (located, *triggers))
        if any(trigger.passed for trigger in triggers):
            new, points = self._keyframe(frame, left, pose, memory.next_id)
            result = replace(result, decisions=(*result.decisions, points))
            if points.passed:
                after = replace(after, keyframe=new, next_id=memory.next_id + len(new.ids), uv=new.uv)
                result = replace(result, key_frame=True, landmarks=self._landmarks(new, frame))
        watch.lap("depth")
        return after, result

    def _aligned(self, memory: Memory, left: Image, time_ns: int) -> Alignment | None:
        """Step 2: returns the motion from the keyframe to this image."""
        keyframe, camera = memory.keyframe, self.rig.camera("left")
        seconds = (time_ns - memory.time_ns) * 1e-9
        now_from_key = memory.world_from_left.inverse() @ keyframe.world_from_left
        predicted = Pose.exp(seconds * memory.velocity).inverse() @ now_from_key
        depth = camera.fx * self.rig.baseline_m / keyframe.disparity_px.astype(float)
        guesses = guesses_around(predicted, now_from_key, depth)
        return align(
            camera, pyramid(keyframe.grey), keyframe.uv.astype(float), depth, pyramid(left), guesses, PATCH
        )  # fmt: skip

    def _begun(
        self, memory: Memory | None, frame: Frame, left: Image, watch: Stopwatch, pose: Pose,
        decisions: tuple[Decision, ...],
    ) -> tuple[Memory | None, Result]:  # fmt: skip
        """Begins at a pair: the first one, or after a loss at the last known pose."""
        first_id = 0 if memory is None else memory.next_id
        keyframe, points = self._keyframe(frame, left, pose, first_id)
        watch.lap("depth")
        if not points.passed:
            return memory, Result(decisions=(*decisions, points))
        after = Memory(keyframe, first_id + len(keyframe.ids), frame.time_ns, pose, uv=keyframe.uv)
        tracks = tracks_between(keyframe.ids, keyframe.uv)
        return after, Result(
            pose @ self.rig.rig_from_left.inverse(), (*decisions, points), {"left": tracks},
            self._landmarks(keyframe, frame), key_frame=True, restarted=memory is not None,
        )  # fmt: skip

    def _keyframe(self, frame: Frame, left: Image, pose: Pose, first_id: int) -> tuple[Keyframe, Decision]:
        """Step 1: returns the pair with its depth field."""
        uv = textured(left, self.config.max_points, self.config.min_gradient, BORDER_PX)
        matches = PointSearch().search(left, as_grey(frame.right), uv)
        good = (matches.disparity_px >= MIN_DISPARITY_PX) & (matches.deviations_px <= MAX_DEVIATION_PX)
        count = int(good.sum())
        keyframe = Keyframe(left, first_id + np.arange(count), uv[good], matches.disparity_px[good], pose)
        return keyframe, POINTS.of(count, self.config.min_points)

    def _landmarks(self, keyframe: Keyframe, frame: Frame) -> Landmarks:
        camera, baseline = self.rig.camera("left"), self.rig.baseline_m
        xyz = points_from_disparity(camera, baseline, keyframe.uv, keyframe.disparity_px)
        return Landmarks(keyframe.ids, keyframe.world_from_left.apply(xyz), colours_at(frame.left, keyframe.uv))

    def _result(
        self, memory: Memory, frame: Frame, found: Alignment, similar: NDArray[np.bool_], pose: Pose,
        decisions: tuple[Decision, ...],
    ) -> Result:  # fmt: skip
        """Tracks are for display: where the motion carries the pixels of the keyframe."""
        keyframe = memory.keyframe
        tracks = tracks_between(keyframe.ids[similar], found.uv[similar], memory.uv[similar])
        return Result(pose @ self.rig.rig_from_left.inverse(), decisions, {"left": tracks})


METHOD = Method(
    "direct", STEREO, DirectConfig, "metric", "Kerl, Sturm and Cremers 2013; Engel, Sturm and Cremers 2013",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: direct",
)  # fmt: skip
