"""The tracks of one camera in the history: the method, the observations, and the first frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types import FrameName, Rig, Step, Tracks, TrackStatus

from ..history.history import Records
from ..history.quantities import by_method
from ..history.record import ExposureRecord
from .selection import Selection

SEARCHED = 300
"""Frames looked through for a track: each costs a millisecond where it is on disk only."""


@dataclass(frozen=True, eq=False)
class Seen:
    """The tracks of one camera at one frame, and the step that they come from."""

    index: int
    step: Step
    camera: FrameName
    tracks: Tracks

    @property
    def moved(self) -> Tracks | None:
        """Those that one other rigid motion explains; None where there is none."""
        return self.step.other_motion.get(self.camera)


@dataclass(frozen=True, eq=False)
class Observation:
    """One track at one frame."""

    index: int
    time_ns: int
    uv: Array
    """(2,) [px]; of a track that ended here the last known place."""
    status: TrackStatus
    residual_px: float
    """Residual that the method reported at the frame; NaN where the track took no part in the pose."""
    disparity_px: float
    """NaN where unknown."""
    key_frame: bool
    world_from_camera: Pose | None
    """Pose that was given at the frame; None without a pose, or where its world was discarded since."""
    xyz_in_world: Array | None
    """(3,) the point, where this frame has it."""


@dataclass(frozen=True, eq=False)
class TrackLife:
    """A track up to the frame shown."""

    method: str
    camera: FrameName
    number: int
    observations: tuple[Observation, ...]
    """Oldest first; at least one."""
    whole: bool
    """Whether it goes back to where the track began."""

    @property
    def last(self) -> Observation:
        return self.observations[-1]

    @property
    def seen(self) -> tuple[Observation, ...]:
        """Returns the observations without that of the frame that lost the track."""
        return tuple(s for s in self.observations if not s.status.dropped)


def seen_by(record: ExposureRecord, method: str = "", camera: str = "") -> Seen | None:
    """The tracks that a method has in the frame, in this camera; empty for the first that has any."""
    for name, step in by_method(record.steps).items():
        for of, tracks in step.tracks.items():
            if method in ("", name) and camera in ("", of) and of in ("video", "left"):
                return Seen(record.index, step, "video" if of == "video" else "left", tracks)
    return None


def missing_tracks(record: ExposureRecord, unavailable: str = "", recorded: bool = False) -> str:
    """Returns why single tracks of a frame are unknown, and what to do about it; empty where the frame has no tracks.

    `unavailable` says why a stored run cannot be computed again; `recorded`: the frame is computed soon.
    """
    if record.stored is not None and recorded:
        return "This frame is recorded; its single tracks are known as soon as it is computed here, which is under way."
    if record.stored is not None and unavailable:
        return f"A stored run keeps no single tracks, and they cannot be computed again: {unavailable}"
    if record.stored is not None:
        return (
            "A stored run keeps no single tracks: fork it at an earlier frame, or apply and restart (Methods); "
            "frames that are computed then have them."
        )
    if record.thinned:
        return (
            "The tracks of this frame were discarded to save disk space: fork at an earlier frame (Methods) to "
            "compute them again."
        )
    return ""


def seen_before(
    records: Records, index: int, method: str = "", camera: str = "", most: int = SEARCHED
) -> Iterator[Seen]:
    """Yields what `seen_by` returns for frame `index` and the frames before it, newest first: `most` frames at most."""
    for i in range(index, max(index - most, -1), -1):
        if (found := seen_by(records[i], method, camera)) is not None:
            yield found


def life(records: Records, index: int, selection: Selection, rig: Rig) -> TrackLife | None:
    """The track as known at frame `index`; None where it is not among the last SEARCHED frames up to there."""
    method, camera, found, same_world, whole = selection.method, "", list[Observation](), True, False
    for seen in seen_before(records, index, method):
        if camera and seen.camera != camera:
            continue
        rows = np.flatnonzero(seen.tracks.ids == selection.number)
        if not len(rows):
            if found:
                whole = True
                break
            continue
        method, camera = seen.step.method, seen.camera
        observation = _observation(seen, int(rows[0]), rig)
        found.append(observation if same_world else replace(observation, world_from_camera=None, xyz_in_world=None))
        same_world = same_world and not seen.step.restarted
        if observation.status == TrackStatus.NEW:
            whole = True
            break
    if not found:
        return None
    return TrackLife(method, "video" if camera == "video" else "left", selection.number, tuple(reversed(found)), whole)


def nearest(seen: Seen, uv: Array) -> int | None:
    """The id of the track nearest to a pixel (2,); None where there is none."""
    if not len(seen.tracks):
        return None
    return int(seen.tracks.ids[np.nanargmin(np.linalg.norm(seen.tracks.uv - uv, axis=1))])


def camera_pose(step: Step, rig: Rig, camera: FrameName) -> Pose | None:
    """world_from_camera of a step, in its method's world."""
    if step.world_from_frame is None:
        return None
    return step.world_from_frame @ rig.rig_from(step.frame).inverse() @ rig.rig_from(camera)


def _observation(seen: Seen, row: int, rig: Rig) -> Observation:
    tracks, points = seen.tracks, seen.step.landmarks
    at = np.flatnonzero(points.ids == tracks.ids[row])
    xyz = points.xyz_in_world[at[0]] if len(at) and np.isfinite(points.xyz_in_world[at[0]]).all() else None
    return Observation(
        seen.index,
        seen.step.time_ns,
        tracks.uv[row].astype(float),
        TrackStatus(int(tracks.status[row])),
        float(tracks.residual_px[row]),
        float(tracks.disparity_px[row]),
        seen.step.key_frame,
        camera_pose(seen.step, rig, seen.camera),
        xyz,
    )
