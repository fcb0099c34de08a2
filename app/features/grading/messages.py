"""What a submission's process is sent, and what it answers. The answers are data, and nothing in them is trusted.

A message is its length (8 bytes), then its content. Requests are pickled: they come from the grader alone. Answers are
MessagePack of a fixed structure, with arrays as bytes; nothing that a submission writes is unpickled.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Landmarks, Status, Step, Tracks, Trajectory

HEAD = struct.Struct("<Q")
MOST_BYTES = 64 << 20
"""Most bytes of an answer: a trajectory of 600,000 poses, or a million tracks."""
FAR_PX, FAR = 1e5, 1e12
"""Image points beyond this, or not finite, are outside of the image; such landmarks are none."""
NOWHERE_PX = -1e4
ROTATION = 1e-3
"""Largest difference of R^T R from the unit matrix of a rotation R."""


class Listed(msgspec.Struct):
    """A method of a package."""

    name: str
    unit: str


class PoseAnswer(msgspec.Struct):
    time_ns: int
    frame: str
    pose: bytes | None
    """(3, 4) float64; None without a pose."""


class TracksAnswer(msgspec.Struct):
    ids: bytes
    uv: bytes
    status: bytes


class StepAnswer(msgspec.Struct):
    at: PoseAnswer
    tracks: dict[str, TracksAnswer]
    landmark_ids: bytes
    landmarks: bytes


class TrajectoryAnswer(msgspec.Struct):
    times_ns: bytes
    poses: bytes
    frame: str


class Answer(msgspec.Struct):
    """What came of a request. One of the fields is set; none where there is nothing to say."""

    mistake: str | None = None
    """A sentence about what the user gave."""
    failure: str | None = None
    """The exception that ended the method, or how it breaks the contract."""
    methods: list[Listed] | None = None
    steps: list[StepAnswer] | None = None
    trajectory: TrajectoryAnswer | None = None


def step_answer(step: Step) -> StepAnswer:
    """Of a Step: what the grader measures."""
    tracks = {
        str(name): TracksAnswer(_bytes(t.ids, np.int64), _bytes(t.uv, np.float32), _bytes(t.status, np.uint8))
        for name, t in step.tracks.items()
    }
    pose = step.world_from_frame
    matrix = None if pose is None else _bytes(np.column_stack([pose.rotation, pose.translation]), np.float64)
    ids, xyz = _bytes(step.landmarks.ids, np.int64), _bytes(step.landmarks.xyz_in_world, np.float64)
    return StepAnswer(PoseAnswer(int(step.time_ns), str(step.frame), matrix), tracks, ids, xyz)


def trajectory_answer(trajectory: Trajectory) -> TrajectoryAnswer:
    poses = np.concatenate([trajectory.rotations, trajectory.translations[:, :, None]], axis=2)
    return TrajectoryAnswer(_bytes(trajectory.times_ns, np.int64), _bytes(poses, np.float64), str(trajectory.frame))


def step_of(answer: StepAnswer) -> Step:
    """Returns the Step that Views measures. A pose that is none (NaN, no rotation) is left out; of several tracks or
    landmarks of one id the first counts. Raises ValueError where sizes do not fit."""
    tracks = {}
    for name, each in answer.tracks.items():
        ids, uv = _array(each.ids, np.int64, ()), _array(each.uv, np.float32, (2,))
        status = _array(each.status, np.uint8, ())
        first = _first(ids, len(uv), len(status))
        nowhere = ~np.all(np.abs(uv) < FAR_PX, axis=1)
        tracks[name] = Tracks.of(ids[first], np.where(nowhere[:, None], NOWHERE_PX, uv)[first], status=status[first])
    ids, xyz = _array(answer.landmark_ids, np.int64, ()), _array(answer.landmarks, np.float64, (3,))
    first = _first(ids, len(xyz))
    known = first[np.all(np.abs(xyz[first]) < FAR, axis=1)]
    landmarks = Landmarks(ids[known], xyz[known], np.zeros((len(known), 3), np.uint8))
    at = answer.at
    pose = None if at.pose is None else _poses(at.pose)
    if pose is not None and pose.shape != (1, 3, 4):
        raise ValueError("not one pose")
    usable = pose is not None and bool(_usable(pose)[0])
    return Step(
        at.time_ns,
        Status.TRACKING if usable else Status.LOST,
        at.frame,
        Pose(pose[0, :, :3], pose[0, :, 3]) if usable and pose is not None else None,
        tracks=tracks,
        landmarks=landmarks,
    )


def trajectory_of(answer: TrajectoryAnswer) -> Trajectory:
    """Returns the Trajectory without poses that are none. Raises ValueError where sizes do not fit, or times do not
    increase."""
    times_ns, poses = _array(answer.times_ns, np.int64, ()), _poses(answer.poses)
    if len(times_ns) != len(poses) or (np.diff(times_ns) <= 0).any():
        raise ValueError("times that do not increase")
    found = Trajectory(times_ns, poses[:, :, :3], poses[:, :, 3], answer.frame)
    return found.select(_usable(poses))


def _usable(poses: Array) -> NDArray[np.bool_]:
    """Returns which of (N, 3, 4) are a finite rotation and position."""
    with np.errstate(invalid="ignore", over="ignore"):
        rotations = poses[:, :, :3]
        errors = np.abs(np.einsum("nji,njk->nik", rotations, rotations) - np.eye(3)).max(axis=(1, 2))
        return (errors < ROTATION) & (np.abs(poses[:, :, 3]) < FAR).all(axis=1)


def _first(ids: NDArray[np.int64], *counts: int) -> NDArray[np.int64]:
    """Returns the places of the first of each id, in order. Raises ValueError where other arrays are not as long."""
    if any(count != len(ids) for count in counts):
        raise ValueError("arrays of different lengths")
    return np.sort(np.unique(ids, return_index=True)[1])


def _bytes(values: Any, kind: type[np.generic]) -> bytes:
    return np.ascontiguousarray(values, kind).tobytes()


def _array(content: bytes, kind: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.frombuffer(content, kind).reshape(-1, *shape)


def _poses(content: bytes) -> Array:
    return _array(content, np.float64, (3, 4))


def encoded(content: bytes) -> bytes:
    """Returns a message with its length."""
    return HEAD.pack(len(content)) + content


def merged(answers: Mapping[str, Any]) -> bytes:
    """Returns the bytes of an Answer."""
    return encoded(msgspec.msgpack.encode(Answer(**answers)))
