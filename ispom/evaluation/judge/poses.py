"""The judged poses at the times of the frames, and changes of all poses at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory

NEAR_NS = 1_000_000
"""Largest time difference of a pose that is the frame's own: files round times to microseconds or milliseconds."""
LONGEST_GAP_NS = 250_000_000
"""Largest interval between two poses in which poses are interpolated: handheld cameras change their motion within a
longer one."""


@dataclass(frozen=True, eq=False)
class Change:
    """The change of all poses before they are compared with the images."""

    clock_s: float = 0.0
    """A frame at time t has the pose that the file states for t + `clock_s`."""
    mount: Array | None = None
    """(3, 3) frame_from_camera: the axes of the camera in those of the poses; None where they are the same."""
    lever: Array | None = None
    """(3,) of the camera in the frame of the poses, in the unit of the poses."""
    inverse: bool = False
    """Whether the file states camera_from_world for world_from_camera."""
    turning: Array | None = None
    """(3,) [rad/s] by which the camera turns more than the poses do, about its own axes; None where it does not."""
    growing: float = 0.0
    """Share [1/s] by which each step is to grow, once more each second."""

    @property
    def drifts(self) -> bool:
        """Whether steps are changed, each one in the same way."""
        return self.turning is not None or self.growing != 0


UNCHANGED = Change()


def changed(poses: Trajectory, times_ns: NDArray[np.int64], change: Change) -> Trajectory:
    """Returns world_from_camera at the times (F,) of frames, of world_from_frame poses as a file states them."""
    if change.inverse:
        back = np.swapaxes(poses.rotations, 1, 2)
        moved = -np.einsum("nij,nj->ni", back, poses.translations)
        poses = Trajectory(poses.times_ns, back, moved, poses.frame)
    asked = times_ns + round(change.clock_s * 1e9)
    at = poses if np.array_equal(poses.times_ns, asked) else interpolate(poses, asked, "linear")
    at = replace(at, times_ns=times_ns)
    mount = np.eye(3) if change.mount is None else change.mount
    lever = np.zeros(3) if change.lever is None else change.lever
    right = at.moved(right=Pose(mount, lever))
    return drifted(right, change) if change.drifts else right


def drifted(poses: Trajectory, change: Change) -> Trajectory:
    """Returns the poses with each step turned and made longer, as `turning` and `growing` say."""
    seconds = np.diff(poses.times_ns) * 1e-9
    back = np.swapaxes(poses.rotations[:-1], 1, 2)
    rate = np.zeros(3) if change.turning is None else change.turning
    turns = back @ poses.rotations[1:] @ so3_exp(seconds[:, None] * rate)
    elapsed = (poses.times_ns[:-1] - poses.times_ns[0]) * 1e-9
    steps = np.einsum("nij,nj->ni", back, np.diff(poses.translations, axis=0))
    rotations = np.empty_like(poses.rotations)
    rotations[:1] = poses.rotations[:1]
    for n, turn in enumerate(turns):
        rotations[n + 1] = rotations[n] @ turn
    moved = np.einsum("nij,nj->ni", rotations[:-1], steps * np.exp(change.growing * elapsed)[:, None])
    positions = np.concatenate([poses.translations[:1], poses.translations[:1] + np.cumsum(moved, axis=0)])
    return Trajectory(poses.times_ns, rotations, positions, poses.frame)


def covered(poses: Trajectory, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Checks which of the frames (F,) have a pose, or two near enough to interpolate between."""
    gaps, inside = _gaps(poses, times_ns)
    return (np.minimum(*gaps) <= NEAR_NS) | (inside & (gaps[0] + gaps[1] <= LONGEST_GAP_NS))


def own(poses: Trajectory, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Checks which frames (F,) have a pose of their own, or poses so dense that interpolation smooths nothing."""
    gaps, _ = _gaps(poses, times_ns)
    dense = 0.5 * np.median(np.diff(times_ns)) if len(times_ns) > 1 else 0.0
    return covered(poses, times_ns) & ((np.minimum(*gaps) <= NEAR_NS) | (gaps[0] + gaps[1] <= dense))


def _gaps(
    poses: Trajectory, times_ns: NDArray[np.int64]
) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], NDArray[np.bool_]]:
    """Times (F,) to the poses before and after each frame [ns], and whether it is between the first and last pose."""
    after = np.searchsorted(poses.times_ns, times_ns)
    before, after = (after - 1).clip(0), after.clip(0, len(poses) - 1)
    gaps = np.abs(times_ns - poses.times_ns[before]), np.abs(times_ns - poses.times_ns[after])
    return gaps, (times_ns >= poses.times_ns[0]) & (times_ns <= poses.times_ns[-1])


def turned(rotvec_rad: Array) -> Array:
    """Returns the rotation (3, 3) of a rotation vector (3,)."""
    return so3_exp(np.asarray(rotvec_rad, float)[None])[0]


def distinct(poses: Trajectory) -> Trajectory:
    """Returns the poses with different times, the last one of each."""
    if not len(poses):
        return poses
    order = np.argsort(poses.times_ns, kind="stable")
    times = poses.times_ns[order]
    return poses.select(order[np.append(np.diff(times) > 0, True)])
