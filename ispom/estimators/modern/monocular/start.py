"""Before the first map, and after a loss: frames since a reference, and the place that is held for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import TURN_LOSS
from ispom.estimators.modern.rolling import Sight
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.solvers.multiview.rotation import dominant_rotation
from ispom.solvers.window.prior import LENS

NEWEST, BUFFER = 40, 120
"""Frames remembered while waiting: the newest ones all, older ones the fewer the longer it takes."""
MIN_POINTS = 40
"""Fewer points make no map: it has to last until the next key frame with a third of them lost."""
MIN_SHARED = 8
"""Fewer points say nothing sure about a turn, nor, of an old map, about the unit of a new one."""


@dataclass(frozen=True, eq=False)
class Start:
    """Frames since the reference, which has the pose `base`."""

    frames: tuple[TrackedFrame, ...] = ()
    """The first is the reference. Each with the pose held for it (its own rotation, the place of the reference)."""
    base: Pose = Pose()
    speed: float | None = None
    """Units per second before a loss, taken for those of the new map's first baseline; None: that is 1 long."""
    points: ScenePoints = ScenePoints()
    """Of the map before a loss: where tracks go on, they carry the unit over."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """How far the camera's calibration may be corrected."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) of the base in the world from before a loss; zero where the base is the world."""
    coasting: Callable[[int], Pose] | None = None
    """The pose that goes on from before a loss, by time, for as long as nothing is seen."""
    joined: bool = True
    """Whether tracks tell how the reference is turned against the frames before, and points of the map before a loss
    what the unit is; where they do not, what begins there is a segment of its own."""
    lost: Map | None = None
    """The map before a loss, without its keyframes and points: frames may still be found in what they showed."""
    sights: tuple[Sight, ...] = ()
    """What the frames but the last one showed; none unless the shutter rolls."""
    earlier: tuple[TrackedFrame, ...] = ()
    """Those before the reference, of starts that began again: too few of their points went on to make a map with them,
    but the map may tell where they were."""
    passed: PersistentList[tuple[int, Pose]] = PersistentList()
    """The poses held for frames that are not remembered; what the map tells of those before and after places them."""

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Start:
        """Adds tracks first seen in the reference, while that is the only frame."""
        return replace(self, frames=(self.frames[0].with_new(ids, x),))

    def with_sight(self, sight: Sight) -> Start:
        """With what the last frame showed; what frames that are gone did is forgotten."""
        kept = {f.time_ns for f in self.frames}
        return replace(self, sights=tuple(s for s in (*self.sights, sight) if s.time_ns in kept))

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> Start:
        """With tracks (M,) at other coordinates (M, 2) in the frame of that time, if there is one."""

        def placed(frames: tuple[TrackedFrame, ...]) -> tuple[TrackedFrame, ...]:
            return tuple(f.with_updated_coordinates(ids, x) if f.time_ns == time_ns else f for f in frames)

        return replace(self, earlier=placed(self.earlier), frames=placed(self.frames))

    @property
    def held(self) -> tuple[tuple[int, Pose], ...]:
        """The poses held for all of its frames, in no order."""
        return (*self.passed, *poses_held((*self.earlier, *self.frames)))

    def limited(self) -> Start:
        """Without one of the frames, where there are too many: of the older ones, that with the nearest neighbours."""
        frames, reference = (*self.earlier, *self.frames), len(self.earlier)
        if len(frames) <= BUFFER:
            return self
        times_ns = np.array([f.time_ns for f in frames])
        apart_ns = times_ns[2 : 1 - NEWEST] - times_ns[: -1 - NEWEST]
        inner = np.arange(1, len(apart_ns) + 1)
        gone = int(inner[np.argmin(np.where(inner == reference, np.iinfo(np.int64).max, apart_ns))])
        passed = self.passed.extended(poses_held((frames[gone],)))
        kept, first = (*frames[:gone], *frames[gone + 1 :]), reference - (gone < reference)
        return replace(self, earlier=kept[:first], frames=kept[first:], passed=passed)

    def restarted(self, frame: TrackedFrame, width: float) -> tuple[Start, tuple[tuple[int, Pose], ...]]:
        """With this frame as the reference, the rotation so far kept; and the poses held for those before it, where no
        observation joins it to them. `width` of the robust loss, normalised."""
        last = self.frames[-1]
        ids = np.intersect1d(last.ids, frame.ids, assume_unique=True)
        base = last.world_from_camera or self.base
        # Of frames in which nothing was seen no pose is told: there is nothing to be joined to.
        shared = len(ids) >= MIN_SHARED or len(last.ids) < MIN_SHARED
        same_unit = self.lost is None or self.points.count(frame.ids) >= MIN_SHARED
        if len(ids) >= MIN_SHARED:
            turn = dominant_rotation(last.at(ids), frame.at(ids), TURN_LOSS * width)
            base = Pose(base.rotation @ turn.T, base.translation)
        elif self.coasting is not None and len(self.frames) == 1:
            base = self.coasting(frame.time_ns)
        frames = (replace(frame, world_from_camera=base),)
        new = replace(self, frames=frames, base=base, joined=self.joined and shared and same_unit)
        if not shared:
            return replace(new, earlier=(), passed=PersistentList()), self.held
        return replace(new, earlier=(*self.earlier, *self.frames)).limited(), ()


def poses_held(frames: tuple[TrackedFrame, ...]) -> tuple[tuple[int, Pose], ...]:
    """The poses held for frames in which enough was seen to tell at least how they were turned."""
    return tuple((f.time_ns, f.world_from_camera) for f in frames if f.world_from_camera and len(f.ids) >= MIN_SHARED)
