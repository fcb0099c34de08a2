"""Motion of a stereo camera directly from intensities and a depth field, without correspondences: the paper's "direct"
class with one camera (Irani and Anandan, About Direct Methods, 1999; Comport, Malis and Rives, Accurate Quadrifocal
Tracking for Robust 3D Visual Odometry, 2007; Kerl, Sturm and Cremers, Robust Odometry Estimation for RGB-D Cameras,
2013; pixels with a gradient only, as Engel, Sturm and Cremers, Semi-Dense Visual Odometry, 2013).

The steps, in the order of this file:

1. A keyframe is a pair. The pixel with the steepest gradient of each grid cell of its left image is found in the right
   one, along the row: its depth. These pixels are the semi-dense depth field.
2. The motion to the present left image is the one under which the patches around these pixels keep their intensities:
   Gauss-Newton over a pyramid, with a robust loss and one gain and offset of the whole image (`photometric.py`). It
   starts from the prediction of a constant velocity and from several other guesses, and continues with the best one.
3. A frame is located if enough patches look the same at their new positions. It becomes the next keyframe if too few
   of them do, or if the pixels have moved far.

Limits. The intensities must stay: a light that moves, or shadows, look like a motion. Motions must be near one of the
guesses, within some pixels of the smallest image. A large object that moves with most patches is taken for the scene.
Pixels that are neither textured along the row nor near the cameras have no depth, and take no part. No pose is revised
later, and no covariance is given: neighbouring pixels share their errors, which no simple formula covers.
`direct.monocular` has the same with one camera, whose depths come from motion.

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
from ispom.estimators.survey.photometric import (
    Alignment,
    align,
    guesses_around,
    pyramid,
    rays_of,
    square_patch,
    textured,
)
from ispom.features.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.stopwatch import Stopwatch
from ispom.types import Camera, Check, Decision, Frame, Image, Landmarks, Rig, Tracks, as_grey, by_key, colours_at

PATCH = square_patch(4)
BORDER_PX = 8
MIN_DISPARITY_PX = 0.5
"""Points with a smaller disparity have no depth."""
MAX_DEVIATION_PX = 0.5
"""Largest standard deviation of a disparity."""

POINTS = Check(
    "depth_points", "pixels with a gradient and a depth", "requirement", "Keyframe possible?",
    passes="{value} pixels have a gradient and a depth ({threshold} needed).",
    fails="No depth field: {value} pixels have a gradient and a depth ({threshold} needed).",
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
class FieldSettings:
    """Settings of the direct methods."""

    max_points: Annotated[int, Range(100, 10000), WorthTrying((2,))] = 2000
    """Pixels of a keyframe: cells of the grid, each of which gives the one with the steepest gradient."""
    min_gradient: Annotated[float, Range(0.5, 50), WorthTrying((0.5,))] = 4.0
    """Least gradient of a pixel [grey levels per px]; noise of a camera is below 2."""
    min_points: Annotated[int, Range(20, 2000)] = 60
    """An image with fewer pixels that have a depth is no keyframe."""
    min_similar: Annotated[float, Range(0.05, 0.9)] = 0.25
    """Least share of patches that look the same for a frame to be located."""
    keyframe_similar: Annotated[float, Range(0.1, 1), WorthTrying((0.5,))] = 0.8
    """Share of similar patches below which the frame becomes a keyframe."""
    keyframe_moved: Annotated[float, Range(0.1, 50), WorthTrying((0.5,))] = 3.0
    """Median displacement of the pixels above which the frame becomes a keyframe [% of the image's width]."""


@dataclass(frozen=True)
class DirectConfig(FieldSettings):
    """Settings of the direct method."""

    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the keyframe before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Direct:
        return Direct(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Keyframe:
    """An image with its depth field of N pixels."""

    grey: Image
    ids: NDArray[np.int64]
    uv: NDArray[np.float32]
    depth: Array
    """(N,)."""
    world_from_camera: Pose


@dataclass(frozen=True, eq=False)
class Memory:
    """The keyframe, and the last motion."""

    keyframe: Keyframe
    next_id: int
    time_ns: int
    """Time of the last located frame."""
    world_from_camera: Pose
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    uv: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) the keyframe's pixels in the last frame [px]; NaN where they were not found."""
    lost: int = 0
    """Frames since the last located one."""

    def located(self, found: Alignment, time_ns: int) -> Memory:
        """Returns the memory after a frame that was aligned with the keyframe."""
        pose = self.keyframe.world_from_camera @ found.pose.inverse()
        # Predictions are made of poses and poses of predictions: rounding errors would grow without this.
        pose = Pose.from_xyzw(pose.xyzw, pose.translation)
        velocity = (self.world_from_camera.inverse() @ pose).log() / ((time_ns - self.time_ns) * 1e-9)
        return replace(self, time_ns=time_ns, world_from_camera=pose, uv=found.uv, lost=0, velocity=velocity)


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
        found, located = aligned(memory, self.rig.camera("left"), left, frame.time_ns, self.config.min_similar)
        watch.lap("align")
        if found is None or not located.passed:
            if memory.lost < self.config.max_lost_pairs:
                return replace(memory, lost=memory.lost + 1), Result(decisions=(located,))
            return self._begun(memory, frame, left, watch, memory.world_from_camera, (located,))

        after = memory.located(found, frame.time_ns)
        pose, triggers = after.world_from_camera, moved_on(memory.keyframe, found, self.config)
        result = Result(
            pose @ self.rig.rig_from_left.inverse(), (located, *triggers), {"left": carried_tracks(memory, found)}
        )
        if any(trigger.passed for trigger in triggers):
            new, points = self._keyframe(frame, left, pose, memory.next_id)
            result = replace(result, decisions=(*result.decisions, points))
            if points.passed:
                after = replace(after, keyframe=new, next_id=memory.next_id + len(new.ids), uv=new.uv)
                result = replace(result, key_frame=True, landmarks=self._landmarks(new, frame))
        watch.lap("depth")
        return after, result

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
        depth = self.rig.camera("left").fx * self.rig.baseline_m / matches.disparity_px[good].astype(float)
        keyframe = Keyframe(left, first_id + np.arange(count), uv[good], depth, pose)
        return keyframe, POINTS.of(count, self.config.min_points)

    def _landmarks(self, keyframe: Keyframe, frame: Frame) -> Landmarks:
        return landmarks_of(keyframe, self.rig.camera("left"), frame.left)


def aligned(
    memory: Memory, camera: Camera, grey: Image, time_ns: int, least_similar: float
) -> tuple[Alignment | None, Decision]:
    """Step 2: returns the motion from the keyframe to an image, and whether enough patches then look the same."""
    keyframe, seconds = memory.keyframe, (time_ns - memory.time_ns) * 1e-9
    now_from_key = memory.world_from_camera.inverse() @ keyframe.world_from_camera
    predicted = Pose.exp(seconds * memory.velocity).inverse() @ now_from_key
    guesses = guesses_around(predicted, now_from_key, keyframe.depth)
    found = align(
        camera, pyramid(keyframe.grey), keyframe.uv.astype(float), keyframe.depth, pyramid(grey), guesses, PATCH
    )  # fmt: skip
    return found, SIMILAR.of(0.0 if found is None else found.similar.mean(), least_similar)


def moved_on(keyframe: Keyframe, found: Alignment, settings: FieldSettings) -> tuple[Decision, ...]:
    """Step 3: returns the checks for a keyframe. An aligned frame becomes one if any of them passes."""
    shift = np.linalg.norm(found.uv - keyframe.uv, axis=1)[found.similar]
    return (
        OVERLAP.of(found.similar.mean(), settings.keyframe_similar),
        MOVED.of(100 * np.median(shift) / keyframe.grey.shape[1], settings.keyframe_moved),
    )


def carried_tracks(memory: Memory, found: Alignment) -> Tracks:
    """Returns tracks for display: where the motion carries the pixels of the keyframe."""
    similar = found.similar
    return tracks_between(memory.keyframe.ids[similar], found.uv[similar], memory.uv[similar])


def landmarks_of(keyframe: Keyframe, camera: Camera, image: Image) -> Landmarks:
    """Returns the pixels of a keyframe in the world, with the colours of its image."""
    xyz = keyframe.depth[:, None] * rays_of(camera, keyframe.uv)
    return Landmarks(keyframe.ids, keyframe.world_from_camera.apply(xyz), colours_at(image, keyframe.uv))


METHOD = Method(
    "direct", STEREO, DirectConfig, "metric", "Kerl, Sturm and Cremers 2013; Engel, Sturm and Cremers 2013",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: direct",
)  # fmt: skip
