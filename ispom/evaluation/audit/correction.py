"""Corrections of trajectories before they are compared: undone conventions, another body, another clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose
from ispom.types import Trajectory

Convention = Literal["inverse", "rotations-inverse", "w-first", "w-last", "mirrored-x", "mirrored-y", "mirrored-z"]
"""inverse: the poses are FRAME_from_world; rotations-inverse: only their rotations are; w-first: quaternions have w
first, but were read with w last, w-last the reverse; mirrored: world and body are left-handed, by this axis."""
ROUNDED_NS = 1000
"""Dates in seconds as floats are good to 0.2 us, and files have microseconds: a pose belongs to the end of a stretch
that is this close [ns]."""
Poses = tuple[Array | None, Array]
"""Rotations (N, 3, 3), None where there are none, and positions (N, 3)."""


def _inverse(rotations: Array | None, positions: Array) -> Poses:
    if rotations is None:
        return rotations, positions
    back = np.swapaxes(rotations, 1, 2)
    return back, -np.einsum("nij,nj->ni", back, positions)


def _rotations_inverse(rotations: Array | None, positions: Array) -> Poses:
    return None if rotations is None else np.swapaxes(rotations, 1, 2), positions


def _reordered(order: list[int]) -> Callable[[Array | None, Array], Poses]:
    def reordered(rotations: Array | None, positions: Array) -> Poses:
        if rotations is None or not len(rotations):
            return rotations, positions
        return Rotation.from_quat(Rotation.from_matrix(rotations).as_quat()[:, order]).as_matrix(), positions

    return reordered


def _mirrored(axis: int) -> Callable[[Array | None, Array], Poses]:
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)

    def mirrored(rotations: Array | None, positions: Array) -> Poses:
        turned = None if rotations is None else signs[:, None] * rotations * signs
        return turned, positions * signs

    return mirrored


UNDONE: Mapping[Convention, Callable[[Array | None, Array], Poses]] = MappingProxyType(
    {
        "inverse": _inverse,
        "rotations-inverse": _rotations_inverse,
        "w-first": _reordered([1, 2, 3, 0]),
        "w-last": _reordered([3, 0, 1, 2]),
        "mirrored-x": _mirrored(0),
        "mirrored-y": _mirrored(1),
        "mirrored-z": _mirrored(2),
    }
)
"""By convention: the function that converts poses to world_from_FRAME in right-handed axes."""


def undone(trajectory: Trajectory, conventions: tuple[Convention, ...]) -> Trajectory:
    """Returns world_from_FRAME of poses that follow these conventions."""
    rotations, positions = trajectory.rotations, trajectory.translations
    for name in conventions:
        turned, positions = UNDONE[name](rotations, positions)
        assert turned is not None
        rotations = turned
    return replace(trajectory, rotations=rotations, translations=positions)


@dataclass(frozen=True, eq=False)
class Correction:
    """The correction of an estimate and of its reference."""

    conventions: tuple[Convention, ...] = ()
    """Conventions of the estimate that are undone."""
    reference_conventions: tuple[Convention, ...] = ()
    body: Pose | None = None
    """estimate_body_from_reference_body, in the estimate's unit."""
    clock_rate: float = 1.0
    """Seconds of the reference per second of the estimate, about the estimate's first pose."""
    offset_s: float = 0.0
    """Added to the estimate's times [s]; rows, where there are no times."""
    with_scale: bool = False
    """Whether the scale is fitted although the requested alignment does not fit it."""
    excluded_s: tuple[tuple[float, float], ...] = ()
    """First and last times of stretches of the reference's clock that are not compared [s]."""
    max_difference_s: float | None = None
    """Largest time difference of associated poses [s], if the requested one associates hardly any of them."""

    def then(self, new: Correction) -> Correction:
        """Returns this correction, followed by another one."""
        body = self.body if new.body is None else new.body if self.body is None else self.body @ new.body
        return Correction(
            self.conventions + new.conventions,
            self.reference_conventions + new.reference_conventions,
            body,
            self.clock_rate * new.clock_rate,
            self.offset_s + new.offset_s,
            self.with_scale or new.with_scale,
            self.excluded_s + new.excluded_s,
            self.max_difference_s if new.max_difference_s is None else new.max_difference_s,
        )

    def of_estimate(self, estimate: Trajectory) -> Trajectory:
        moved = undone(estimate, self.conventions)
        if self.body is not None:
            moved = moved.moved(right=self.body)
        return replace(moved, times_ns=shifted_ns(moved.times_ns, self.clock_rate, self.offset_s))

    def of_reference(self, reference: Trajectory) -> Trajectory:
        poses = undone(reference, self.reference_conventions)
        return poses.select(outside(poses.times_ns, self.excluded_s)) if self.excluded_s else poses


def shifted_ns(times_ns: NDArray[np.int64], rate: float, offset_s: float) -> NDArray[np.int64]:
    """Returns the times (N,) of a clock of another rate and offset, about the first of them."""
    if (rate == 1.0 and offset_s == 0.0) or not len(times_ns):
        return times_ns
    since = times_ns - times_ns[0]
    scaled = since if rate == 1.0 else np.rint(since * rate).astype(np.int64)
    return times_ns[0] + scaled + round(offset_s * 1e9)


def outside(times_ns: NDArray[np.int64], spans_s: tuple[tuple[float, float], ...]) -> NDArray[np.bool_]:
    """Returns (N,) whether times are outside of all spans, whose ends belong to them."""
    good = np.ones(len(times_ns), bool)
    for first, last in spans_s:
        good &= (times_ns < _ns(first) - ROUNDED_NS) | (times_ns > _ns(last) + ROUNDED_NS)
    return good


def _ns(seconds: float) -> int:
    """Returns the time [ns]; infinity is the largest time."""
    bound = np.iinfo(np.int64).max - ROUNDED_NS
    return int(np.rint(np.clip(np.longdouble(seconds) * 10**9, -bound, bound)))
