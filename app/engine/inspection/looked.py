"""The data from which the details of one frame are drawn. They are computed once, and its panels share them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ispom.estimators.modern.lens import Lens
from ispom.geometry import Pose, Similarity
from ispom.types import Camera, FrameName, Rig, Sequence, Step

from ..history.history import Records
from ..history.record import ExposureRecord
from ..history.series import Series
from ..model.drawn_size import unit_in_metres
from ..model.poses import POSES_PER_BLOCK
from ..model.run_model import RunModel
from .colouring import Colouring
from .knowledge import Knowledge, known_from
from .point import PointEstimate, estimate
from .selection import Selection
from .sightings import Seen, TrackLife, life, missing_tracks, seen_before, seen_by


def revised(life: TrackLife, model: RunModel, rig: Rig) -> TrackLife:
    """Returns the track with the poses that the model knows, in place of those given at each frame.

    A method that runs only for another one is not in the model: its poses stay as they were given.
    """
    if life.method not in model.methods:
        return life
    found = []
    for observation in life.observations:
        pose = pose_at(model, life.method, observation.time_ns, rig, life.camera)
        known = observation.world_from_camera is not None and pose is not None
        found.append(replace(observation, world_from_camera=pose) if known else observation)
    return replace(life, observations=tuple(found))


def pose_at(model: RunModel, method: str, time_ns: int, rig: Rig, camera: FrameName) -> Pose | None:
    """world_from_camera of a method of the model at the time of a frame; None where it has no pose there."""
    poses, times = model.methods[method].poses, model.times
    row = int(times.rows(np.array([time_ns]))[0])
    block, at = divmod(row, POSES_PER_BLOCK)
    if block >= len(poses.blocks) or not poses.blocks[block].known[at]:
        return None
    if not times.count or int(times.times_ns(slice(row, row + 1))[0]) != time_ns:
        return None
    return poses.pose(row) @ rig.rig_from(poses.frame).inverse() @ rig.rig_from(camera)


EXPOSURES = 60
"""Number of the camera's frames, up to the one shown, whose lifetimes and residuals are drawn."""
REMEMBERED = 256
"""Number of frames from which ages and depths are computed."""
RAYLEIGH_MEDIAN = 1.1774
"""Median length of an error (x, y) whose coordinates have a standard deviation of 1."""


@dataclass(frozen=True, eq=False)
class Looked:
    """The details of the frame `record`. `camera` is the camera whose image is requested, if the rig has it."""

    sequence: Sequence
    records: Records
    series: Series
    known_at: Callable[[int], RunModel]
    record: ExposureRecord
    selection: Selection | None
    camera: str
    colour_by: Colouring
    unavailable: str = ""
    """Why a stored run cannot be computed again; empty where it can."""
    recorded: bool = False
    """Whether a recorded frame is computed soon."""

    @property
    def rig(self) -> Rig:
        return self.sequence.rig

    @cached_property
    def cameras(self) -> tuple[FrameName, ...]:
        """Returns the cameras of the rig in which tracks are followed."""
        video: tuple[FrameName, ...] = ("video",) if self.rig.video is not None else ()
        left: tuple[FrameName, ...] = ("left",) if self.rig.left is not None else ()
        return video + left

    @cached_property
    def _recorded_cameras(self) -> tuple[FrameName, ...]:
        """Returns the cameras of a recording that has no rig."""
        kinds = self.sequence.kinds
        return (("video",) if "video" in kinds else ()) + (("left",) if "stereo" in kinds else ())

    @cached_property
    def pictured(self) -> FrameName:
        """Returns the camera whose image is shown: the one requested, else the first one in which the method of the
        selection has tracks."""
        cameras = self.cameras or self._recorded_cameras
        if self.camera in cameras:
            return self.camera
        method = self.selection.method if self.selection else ""
        return next((name for name in cameras if method and self._sees(method, name)), (*cameras, "video")[0])

    @cached_property
    def index(self) -> int | None:
        """The camera's latest frame; None before its first."""
        return self._latest(self.pictured)

    def _latest(self, camera: FrameName) -> int | None:
        kind, kinds = "stereo" if camera == "left" else "video", self.sequence.kinds
        return next((i for i in range(self.record.index, -1, -1) if kinds[i] == kind), None)

    def _sees(self, method: str, camera: FrameName) -> bool:
        index = self._latest(camera)
        return index is not None and seen_by(self.records[index], method, camera) is not None

    @cached_property
    def seen(self) -> Seen | None:
        """Returns the tracks in the image, of the method whose track or keyframe is selected, or else of the first
        one."""
        if self.index is None:
            return None
        record, method = self.records[self.index], self.selection.method if self.selection else ""
        return seen_by(record, method, self.pictured) or seen_by(record, camera=self.pictured)

    @cached_property
    def missing(self) -> str:
        """Why the tracks in the picture are not known one by one, and what to do; empty where they are."""
        if self.index is None or (self.seen is not None and len(self.seen.tracks)):
            return ""
        return missing_tracks(self.records[self.index], self.unavailable, self.recorded)

    @cached_property
    def recent(self) -> tuple[Seen, ...]:
        """The frames of the picture's camera and method up to it, oldest first."""
        if self.seen is None:
            return ()
        found = seen_before(self.records, self.seen.index, self.seen.step.method, self.pictured, REMEMBERED)
        return tuple(reversed(list(found)))

    @cached_property
    def knowledge(self) -> Knowledge:
        return known_from(self.recent, self.rig)

    @cached_property
    def life(self) -> TrackLife | None:
        """Returns the observations of the selected track, with the poses known at the frame shown."""
        if self.selection is None or self.selection.kind != "track":
            return None
        found = life(self.records, self.record.index, self.selection, self.rig)
        return None if found is None else revised(found, self.known_at(self.record.index), self.rig)

    @cached_property
    def of_track(self) -> Step | None:
        """Returns the step that saw the selected track last."""
        if self.life is None:
            return None
        seen = seen_by(self.records[self.life.last.index], self.life.method, self.life.camera)
        return None if seen is None else seen.step

    @cached_property
    def point(self) -> PointEstimate | None:
        """Of the selected track."""
        if self.life is None:
            return None
        return estimate(self.life, self.lens(self.of_track, self.life.camera), self.rig, self.sigma_px)

    @property
    def sigma_px(self) -> float:
        """Returns the standard deviation of an observed coordinate, by the residuals of the step that saw the selected
        track last; 1 without residuals."""
        residuals = self.of_track.residuals_px if self.of_track is not None else np.zeros(0)
        return max(float(np.median(residuals)) / RAYLEIGH_MEDIAN, 0.05) if len(residuals) else 1.0

    def lens(self, step: Step | None, camera: FrameName) -> Lens:
        """Returns the camera as the method had corrected it at this step."""
        lens = step.calibration.lens if step is not None and camera == "video" else None
        return Lens(self.of_camera(camera), np.zeros(2) if lens is None else lens.values)

    def of_camera(self, camera: FrameName) -> Camera:
        return self.rig.camera(camera)

    def unit_m(self, method: str) -> float | None:
        """Of a method's world [m]; None where nobody knows."""
        return unit_in_metres(method, self.record.placements.get(method, Similarity()).scale)
