"""What a frame leaves behind: new corners where tracks were lost, the next state, and the Step that says all of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.monocular.state import MonocularState, Revision
from ispom.estimators.paper.monocular.tracks import Followed
from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.features.interfaces import Detector
from ispom.geometry import Pose
from ispom.types import Camera, Image, Landmarks, Status, Step, Trajectory, VideoFrame, colours_at

CORNER_DISTANCE_PX = 8.0
"""Least distance of a new corner from other points: two thirds of a tracking window."""


def corners_for(
    detector: Detector, window: KeyFrameWindow, grey: Image, followed: Followed, time_ns: int, max_tracks: int
) -> NDArray[np.float32]:
    """New corners (M, 2) [px] at a key frame; none else."""
    if not window.is_key(time_ns):
        return np.zeros((0, 2), np.float32)
    alive = followed.uv[followed.alive]
    return detector.detect(grey, max_tracks, alive, CORNER_DISTANCE_PX)


def next_state(
    state: MonocularState,
    grey: Image,
    followed: Followed,
    fresh: NDArray[np.float32],
    revision: Revision,
    camera: Camera,
    key_frames: int,
) -> tuple[MonocularState, list[tuple[int, Pose]]]:
    """And the poses of the frames that are older than the `key_frames` that stay."""
    window, new_ids = revision.window, state.next_id + np.arange(len(fresh), dtype=np.int64)
    if len(fresh):
        window = window.with_new_points(new_ids, camera.normalise(fresh))
    window, settled = window.settle(key_frames)
    alive = followed.alive
    after = MonocularState(
        grey,
        np.concatenate([followed.ids[alive], new_ids]),
        np.concatenate([followed.uv[alive], fresh]),
        state.next_id + len(fresh),
        window,
        revision.scale,
        state.settled.extended(settled),
    )
    return after, settled


def as_step(
    exposure: VideoFrame,
    after: MonocularState,
    followed: Followed,
    fresh: NDArray[np.float32],
    revision: Revision,
    settled: list[tuple[int, Pose]],
    seconds: Mapping[str, float],
) -> Step:
    """The Step of a revision that led to the state `after`."""
    window, residual = after.window, followed.residual_px
    pose = window.frames[-1].world_from_camera if window.frames else None
    revised = [] if revision.triple is None else [*settled, *window.poses()]
    return Step(
        exposure.time_ns,
        _status(window, pose, revision),
        "video",
        pose,
        key_frame=window.is_key(exposure.time_ns),
        tracks={"video": followed.as_tracks(fresh, after.next_id - len(fresh))},
        landmarks=_landmarks(exposure, after, revision),
        residuals_px=residual[np.isfinite(residual) & followed.alive],
        revised=Trajectory.of(revised, "video"),
        scale=revision.step_scale,
        seconds=seconds,
        decisions=revision.decisions,
        final_until_ns=window.final_until_ns,
        restarted=window.starts_ns[-1:] == (exposure.time_ns,),
    )


def _status(window: KeyFrameWindow, pose: Pose | None, revision: Revision) -> Status:
    started = window.landmarks.ids.size > 0
    if revision.lost or (started and pose is None):
        return Status.LOST
    return Status.TRACKING if started else Status.INITIALISING


def _landmarks(exposure: VideoFrame, after: MonocularState, revision: Revision) -> Landmarks:
    """The points of the window that are tracked on, after a triple."""
    if revision.triple is None:
        return Landmarks.empty()
    landmarks = revision.window.landmarks
    ids, here, there = np.intersect1d(after.ids, landmarks.ids, return_indices=True)
    return Landmarks(ids, landmarks.xyz[there], colours_at(exposure.image, after.uv[here]))
