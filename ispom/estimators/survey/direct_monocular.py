"""Motion of one camera directly from intensities and a depth field that motion gives, without correspondences (Engel,
Sturm and Cremers, Semi-Dense Visual Odometry for a Monocular Camera, 2013; alignment as in `direct`).

The steps, in the order of this file:

1. Start: without depths, intensities do not determine a motion. Corners are followed until two images and those between
   them give their relative pose (`first_map.py`); the corners are not used further. The second image becomes the
   keyframe, and the depths of its pixels with a gradient are searched in the first one.
2. The motion from the keyframe to the present image is found as in `direct`, from the pixels whose depths are certain.
   It is then refined together with these depths (`depth_alignment.py`). A frame whose patches are not on their epipolar
   lines is lost.
3. The present image then improves the depths of all pixels of the keyframe (`depth_field.py`).
4. Where the view has changed the image becomes the keyframe. Depths are carried to it, and pixels with a gradient
   where there are none are searched in the last keyframe. What the images contradict makes the scale less certain; the
   segment ends where it is lost.

Limits. Those of `direct`; and an image whose pose is wrong makes depths wrong. The unit is the distance of the two
images of the start. It drifts, as each keyframe has it from the last one. Where the camera only rotates there is no
start, and after a start new pixels get no depth: the method is lost once the known ones are out of sight. After a loss
a new segment begins, with a unit of its own. Poses and depths of several images are never adjusted together. An error
that displaces all patches along their lines, and none across them, is not seen.

Measured (`ispom run SOURCE --methods direct.monocular`), aligned with Sim(3), each in one segment with no frame lost.
sim:tiny, seeds 0 and 1: ATE 1.3 mm both; sim:city (its first 100 images): 0.4 mm. Handheld camera over a checkerboard,
250 images of 1.1 m: 3.0 mm in 233 images (`hybrid.monocular`: 1.3 mm). KITTI 06, 51 images of the left camera, 59 m:
t_err 0.6 % (`hybrid.monocular`: 1.1 %); the scale changes by 0.7 % (stated standard deviation: 1.7 %).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ispom.estimator import VIDEO, Method
from ispom.estimators.modern.monocular.keyframe import MAX_SCALE_GROWTH
from ispom.estimators.survey import direct, first_map
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.depth_alignment import LINES, jointly_aligned
from ispom.estimators.survey.depth_field import LINE_PX, DepthField, cells
from ispom.estimators.survey.direct import BORDER_PX, POINTS, FieldSettings, Keyframe
from ispom.estimators.survey.first_map import FirstMap, FirstMaps, Start
from ispom.estimators.survey.photometric import Alignment, textured
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Rig, as_grey, by_key

START_CORNERS, START_INLIERS = 400, 20
"""Corners that are followed until there is a start, and the least number of them that must agree with it."""

SCALE = Check(
    "scale_known", "scale uncertainty grown since the start of the segment", "requirement", "Is the scale known?", "<=",
    "%", topic="scale",
    passes="Scale since the start of the segment: standard deviation {value:.1f} % (limit {threshold:.1f} %).",
    fails="The scale is lost: its standard deviation since the start of the segment is {value:.1f} % (limit "
    "{threshold:.1f} %). A new segment begins.",
)  # fmt: skip

CHECKS = {**first_map.CHECKS, **direct.CHECKS, **by_key(LINES, SCALE)}
STAGES = {
    "first map": first_map.STAGE,
    "align": direct.STAGES["align"],
    "depth": "Improves the depths of the keyframe's pixels, and carries them to the next keyframe.",
}


@dataclass(frozen=True)
class DirectMonocularConfig(FieldSettings):
    """Settings of the direct method with one camera."""

    keyframe_moved: Annotated[float, Range(0.1, 50), WorthTrying((0.5,))] = 8.0
    """Median displacement of the pixels above which the frame becomes a keyframe [% of the image's width]."""
    start_moved: Annotated[float, Range(0.2, 30)] = 1.0
    """Median displacement of corners, without what a rotation explains, for a start [% of the width]."""
    max_lost_frames: Annotated[int, Range(0, 100)] = 5
    """Frames that may fail against the keyframe before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> DirectMonocular:
        return DirectMonocular(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Memory:
    """The depth field with the last motion, or the start of one."""

    start: Start | None = None
    field: DepthField | None = None
    last: direct.Memory | None = None
    """Memory of `direct`; its keyframe has the pixels of the field whose depths are certain."""
    scale_sigma: float = 0.0
    """See Step; of the depths of the keyframe. What the images contradict has the same cause in successive ones, such
    as a lens that is not quite as calibrated: contributions of keyframes add up as they are, not their squares."""


class DirectMonocular(OneKind[Memory]):
    """Gives each frame a pose in the unit of the start. World: the camera at the first image of that."""

    kind, frame = "video", "video"

    def __init__(self, rig: Rig, config: DirectMonocularConfig) -> None:
        self.rig, self.config, self.camera = rig, config, rig.camera("video")
        self.first_maps = FirstMaps(self.camera, START_CORNERS, START_INLIERS, config.start_moved)

    def begin(self) -> Memory:
        """See OneKind."""
        return Memory()

    def process(self, memory: Memory, frame: Frame, watch: Stopwatch) -> tuple[Memory, Result]:
        """See OneKind: one frame."""
        grey = as_grey(frame.image)
        if memory.field is None or memory.last is None:
            return self._started(memory.start, frame, grey, watch)
        config, last = self.config, memory.last
        found, scale_sigma, decisions = self._aligned(last, memory.field, grey, frame.time_ns)
        watch.lap("align")
        if found is None:
            if last.lost < config.max_lost_frames:
                return replace(memory, last=replace(last, lost=last.lost + 1)), Result(decisions=decisions)
            return self._restarted(last, grey), Result(decisions=decisions)
        after = last.located(found, frame.time_ns)
        pose, triggers = after.world_from_camera, direct.moved_on(last.keyframe, found, config)
        decisions, tracks = (*decisions, *triggers), {"video": direct.carried_tracks(last, found)}
        field = memory.field.improved(self.camera, grey, found.pose)
        new, points = None, None
        if any(trigger.passed for trigger in triggers):
            gone = np.isin(field.ids, last.keyframe.ids[~found.similar])
            new, next_id = self._carried(field[~gone], grey, found.pose, last.next_id)
            points = POINTS.of(new.sure.sum(), config.min_points)
            decisions = (*decisions, points)
        if new is None or points is None or not points.passed:
            watch.lap("depth")
            memory = replace(memory, field=field, last=with_sure(after, field))
            return memory, Result(pose, decisions, tracks, scale_sigma=memory.scale_sigma)
        scale = SCALE.of(100 * (memory.scale_sigma + scale_sigma), 100 * MAX_SCALE_GROWTH)
        decisions = (*decisions, scale)
        if not scale.passed:
            return self._restarted(after, grey), Result(decisions=decisions)
        key = keyframe_of(new, pose)
        watch.lap("depth")
        after = replace(after, keyframe=key, next_id=next_id, uv=key.uv)
        landmarks = direct.landmarks_of(key, self.camera, frame.image)
        memory = Memory(None, new, after, memory.scale_sigma + scale_sigma)
        return memory, Result(pose, decisions, tracks, landmarks, key_frame=True, scale_sigma=memory.scale_sigma)

    def _restarted(self, last: direct.Memory, grey: Image) -> Memory:
        """Returns the start of a new segment at an image, from the last pose."""
        return Memory(self.first_maps.begun(grey, last.next_id, last.world_from_camera, restarted=True))

    # Step 1

    def _started(self, start: Start | None, frame: Frame, grey: Image, watch: Stopwatch) -> tuple[Memory, Result]:
        """Follows the corners of the start, and makes a keyframe where they give a motion, and that enough depths."""
        start, decisions, tracks, made = self.first_maps.followed(start, grey)
        watch.lap("first map")
        waiting = Result(decisions=decisions, tracks={"video": tracks})
        if made is None:
            return Memory(start), waiting
        field, first_from_second = self._first_field(made)
        points = POINTS.of(field.sure.sum(), self.config.min_points)
        watch.lap("depth")
        if not points.passed:
            return Memory(start), replace(waiting, decisions=(*decisions, points))
        pose = start.base @ first_from_second
        key = keyframe_of(field, pose)
        last = direct.Memory(key, start.next_id + len(field.ids), frame.time_ns, pose, uv=key.uv)
        return Memory(None, field, last), replace(
            waiting, pose=pose, decisions=(*decisions, points), key_frame=True, restarted=start.restarted,
            landmarks=direct.landmarks_of(key, self.camera, frame.image), scale_sigma=0.0,
        )  # fmt: skip

    def _first_field(self, made: FirstMap) -> tuple[DepthField, Pose]:
        """Returns the field of the second image, as the first one shows it; and first_from_second in its unit."""
        unit = 1 / float(np.linalg.norm(made.second_from_first.translation))
        first_from_second = made.second_from_first.scaled(unit).inverse()
        depth = unit * made.second_from_first.apply(made.xyz[made.keep])[:, 2]
        start = made.start
        uv = self._pixels(start.grey)
        ids = start.next_id + np.arange(len(uv))
        field = DepthField.unknown(start.grey, ids, uv, 1 / float(np.median(depth)))
        field = field.improved(self.camera, start.first, first_from_second)
        # There is no other image yet that could confirm them.
        return replace(field, agreed=2 * field.agreed), first_from_second

    # Step 2

    def _aligned(
        self, last: direct.Memory, field: DepthField, grey: Image, time_ns: int
    ) -> tuple[Alignment | None, float, tuple[Decision, ...]]:
        """Returns how the keyframe lies in an image, None where that is not known; and the standard deviation of the
        logarithm of the scale that depths from it get."""
        found, located = direct.aligned(last, self.camera, grey, time_ns, self.config.min_similar)
        if found is None or not located.passed:
            return None, 0.0, (located,)
        joint = jointly_aligned(field[field.sure], self.camera, grey, found.pose)
        fits = LINES.of(joint.line_error_px, LINE_PX)
        if not fits.passed:
            return None, 0.0, (located, fits)
        key = last.keyframe
        found = found.moved(self.camera, key.uv, key.depth, grey, joint.pose)
        return found, joint.scale_sigma, (located, fits)

    # Step 4

    def _carried(self, field: DepthField, grey: Image, now_from_key: Pose, next_id: int) -> tuple[DepthField, int]:
        """Returns the field of the present image, and the next id."""
        count = self.config.max_points
        old, uv = field.carried(self.camera, grey, now_from_key, count), self._pixels(grey)
        uv = uv[~np.isin(cells(uv, grey, count), cells(old.uv, grey, count))]
        new = DepthField.unknown(grey, next_id + np.arange(len(uv)), uv, old.typical)
        return old.joined(new.improved(self.camera, field.grey, now_from_key.inverse())), next_id + len(uv)

    def _pixels(self, grey: Image) -> Array:
        return textured(grey, self.config.max_points, self.config.min_gradient, BORDER_PX)


def keyframe_of(field: DepthField, world_from_camera: Pose) -> Keyframe:
    """Returns the sure pixels of a field as a keyframe."""
    known = field[field.sure]
    return Keyframe(field.grey, known.ids, known.uv.astype(np.float32), 1 / known.inverse, world_from_camera)


def with_sure(memory: direct.Memory, field: DepthField) -> direct.Memory:
    """Returns the memory with the pixels of its keyframe that are sure now."""
    keyframe = keyframe_of(field, memory.keyframe.world_from_camera)
    uv = np.full((len(keyframe.ids), 2), np.nan)
    _, now, before = np.intersect1d(keyframe.ids, memory.keyframe.ids, return_indices=True)
    uv[now] = memory.uv[before]
    return replace(memory, keyframe=keyframe, uv=uv)


METHOD = Method(
    "direct.monocular", VIDEO, DirectMonocularConfig, "own", "Engel, Sturm and Cremers 2013",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: direct",
)  # fmt: skip
