"""Structure from motion: the "SFM" of the paper's Table 1. Selected key images, adjusted all at once afterwards.

The images are those that `monocular` selects as keyframes, with the tracks that they share. While the recording goes
on, they are only collected. At the end the points of all tracks are intersected, and all poses and all points of a
segment are adjusted together by one robust bundle adjustment (Triggs et al., Bundle Adjustment: A Modern Synthesis,
2000; Schoenberger and Frahm, Structure-from-Motion Revisited, 2016, without its search for image pairs).

Its limits: points are those of tracks, so a place that is seen again later is not recognised; the focal length is that
of the calibration; memory grows with the number of key images. `ispom map` makes the dense cloud of Table 1 from the
run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method, require_frame
from ispom.geometry import Array, Pose
from ispom.numerics.places import places
from ispom.persistent_list import PersistentList
from ispom.settings import Range, checked
from ispom.solvers.bundle import adjust
from ispom.solvers.multiview.structure import intersected
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Measurement, Rig, Status, Step, TrackStatus, Trajectory, by_key

MIN_IMAGES = 3
"""Fewer images of a segment leave nothing to adjust: two fix the world and its unit."""
MIN_POINTS = 20
"""Fewer points than this do not hold the poses: they stay as they were."""
LOSS_PX = 1.0
"""Width of the robust loss of the adjustment: about twice the deviation of a tracked corner."""

SHARED = Check(
    "shared",
    "points shared with the last key image",
    "requirement",
    "Key image?",
    passes="Key image: {value} points are shared with the last one (minimum {threshold}).",
    fails="Too few points are shared with the last key image: {value} ({threshold} needed): a new segment begins.",
    topic="pose",
)


@dataclass(frozen=True)
class SfmConfig:
    """Settings of `sfm`."""

    min_shared: Annotated[int, Range(6, 200)] = 15
    """A key image that shares fewer points with the last one begins a new segment."""
    iterations: Annotated[int, Range(1, 200)] = 40
    """Most iterations of the bundle adjustment at the end."""

    def build(self, rig: Rig) -> Sfm:
        """Returns the estimator for the rig's video camera."""
        return Sfm(rig, checked(self))


@dataclass(frozen=True, eq=False)
class KeyImage:
    """A selected image, with its observations and its pose by `monocular`."""

    time_ns: int
    ids: NDArray[np.int64]
    """(N,) ascending."""
    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    world_from_camera: Pose
    segment: int


@dataclass(frozen=True, eq=False)
class SfmState:
    """The key images so far."""

    images: PersistentList[KeyImage] = PersistentList()
    last: KeyImage | None = None
    """None at the start, and where the visual method began a new segment since."""
    segment: int = 0
    """Segment of the newest key image."""
    worlds: tuple[int | None, ...] = (0,)
    """For each segment of the visual method, the segment of its first key image; None before that image."""
    joins: int | None = None
    """The earlier segment whose world the visual method's newest segment has, until a Step reports it."""
    last_ns: int | None = None


def _joined(state: SfmState) -> tuple[SfmState, int | None]:
    """Returns the earlier segment that the newest one joins, once it has a key image, and the state after that."""
    if state.joins is None or state.worlds[-1] is None:
        return state, None
    return replace(state, joins=None), state.joins


class Sfm:
    """An Integrator of `monocular`, which it calls `visual`."""

    def __init__(self, rig: Rig, config: SfmConfig) -> None:
        self._rig, self._camera, self._config = rig, rig.camera("video"), config

    def start(self) -> SfmState:
        """See Integrator."""
        return SfmState()

    def step(self, state: SfmState, measurement: Measurement, inputs: Mapping[str, Step], /) -> tuple[SfmState, Step]:
        """See Integrator. Collects the image where the visual method selected it."""
        frame, watch = require_frame(measurement, VIDEO, state.last_ns, self._rig), Stopwatch()
        visual, state = inputs["visual"], replace(state, last_ns=frame.time_ns)
        if visual.restarted:
            state = replace(state, last=None, worlds=(*state.worlds, None), joins=None)
        if visual.joins is not None and visual.joins < len(state.worlds):
            state = replace(state, joins=state.worlds[visual.joins])
        pose, tracks = visual.world_from_frame, visual.tracks.get("video")
        waiting = Status.LOST if len(state.images) else Status.INITIALISING
        if visual.status is not Status.TRACKING or pose is None or tracks is None or not visual.key_frame:
            status = visual.status if pose is not None and len(state.images) else waiting
            watch.lap("collect")
            shown = pose if status is Status.TRACKING else None
            state, joins = _joined(state)
            return state, Step(frame.time_ns, status, "video", shown, seconds=watch.seconds, joins=joins)
        used = np.flatnonzero(tracks.status < TrackStatus.LOST)
        used = used[np.argsort(tracks.ids[used])]
        restarted = state.last is None and len(state.images) > 0
        decisions = ()
        if state.last is not None:
            shared = SHARED.of(np.isin(tracks.ids[used], state.last.ids).sum(), self._config.min_shared)
            decisions, restarted = (shared,), not shared.passed
        image = KeyImage(frame.time_ns, tracks.ids[used], tracks.uv[used], pose, state.segment + restarted)
        watch.lap("collect")
        worlds = (*state.worlds[:-1], image.segment if state.worlds[-1] is None else state.worlds[-1])
        after = replace(state, images=state.images.appended(image), last=image, segment=image.segment, worlds=worlds)
        after, joins = _joined(after)
        return after, Step(
            frame.time_ns,
            Status.TRACKING,
            "video",
            pose,
            key_frame=True,
            tracks=visual.tracks,
            landmarks=visual.landmarks,
            residuals_px=visual.residuals_px,
            decisions=decisions,
            seconds=watch.seconds,
            restarted=restarted,
            joins=joins,
        )

    def finish(self, state: SfmState, inputs: Mapping[str, Trajectory], /) -> Trajectory:
        """See Integrator: the adjusted poses of the key images; between them there are none."""
        images, found = list(state.images), list[tuple[int, Pose]]()
        final = inputs["visual"]
        for segment in sorted({image.segment for image in images}):
            own = [image for image in images if image.segment == segment]
            poses = tuple(final.at(image.time_ns) or image.world_from_camera for image in own)
            found += zip((image.time_ns for image in own), self._adjusted(own, poses), strict=True)
        return Trajectory.of(found, "video")

    def _adjusted(self, images: list[KeyImage], poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
        """World_from_camera of the images of one segment, all adjusted with all their points."""
        if len(images) < MIN_IMAGES:
            return poses
        seen_from = np.repeat(np.arange(len(images)), [len(image.ids) for image in images])
        ids = np.concatenate([image.ids for image in images])
        uv = np.concatenate([image.uv for image in images])
        views = Trajectory.of([(i, pose) for i, pose in enumerate(poses)], "video")
        points, xyz = intersected(views, self._camera, seen_from, ids, uv, np.full(len(ids), np.nan))
        if len(points) < MIN_POINTS:
            return poses
        place = places(points, ids)
        kept = place >= 0
        adjusted = self._bundle(poses, xyz, seen_from[kept], place[kept], uv[kept])
        return tuple(pose.inverse() for pose in adjusted)

    def _bundle(
        self,
        poses: tuple[Pose, ...],
        xyz: Array,
        cameras: NDArray[np.int64],
        points: NDArray[np.int64],
        uv: NDArray[np.float32],
    ) -> tuple[Pose, ...]:
        return adjust(
            tuple(pose.inverse() for pose in poses),
            xyz,
            cameras,
            points,
            self._camera.normalise(uv),
            2,
            LOSS_PX / self._camera.fx,
            self._config.iterations,
        ).cameras_from_world


METHOD = Method(
    "sfm",
    VIDEO,
    SfmConfig,
    "own",
    "Triggs, McLauchlan, Hartley and Fitzgibbon 2000",
    asks={"visual": "monocular"},
    checks=by_key(SHARED),
    stages={"collect": "Keeps the image and its tracks where it is a key image."},
    survey="Table 1: structure from motion",
)
