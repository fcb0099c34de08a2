"""The poses of one camera over time, interpolated; and the rotation and clock offset of two cameras by their poses.

Cameras on a rig rotate together: between two times, their rotation vectors differ by the rotation between the cameras
only (Park & Martin 1994). The initial offset is the one at which a single rotation explains them best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp, so3_log
from ispom.types import Trajectory

NEIGHBOURS = 4
"""Poses that one between them is made of: a cubic through the two before it and the two after."""
GAP = 2.5
"""Over a longer interval, in median intervals, nothing is interpolated,"""
LONGEST_S = 0.25
"""nor over one longer than this: hands and vehicles shake at several hertz."""


@dataclass(frozen=True, eq=False)
class Course:
    """world_from_camera at times; the unit of the positions may be the camera's own."""

    times_s: Array
    """(N,) increasing."""
    rotations: Array
    """(N, 3, 3)."""
    positions: Array
    """(N, 3)."""

    def __len__(self) -> int:
        return len(self.times_s)

    @staticmethod
    def of(trajectory: Trajectory) -> Course:
        """Times count from the same zero as the trajectory's."""
        return Course(trajectory.times_ns * 1e-9, trajectory.rotations, trajectory.translations)

    def select(self, index: NDArray) -> Course:
        """Returns the poses of a slice, boolean mask or index array."""
        return Course(self.times_s[index], self.rotations[index], self.positions[index])

    def at(self, times_s: Array, one_sided: bool = False) -> Between:
        """Poses at times (E,), by cubics through the four nearest; `one_sided`, by others around the time where an
        interval between these is too long: at the ends of stretches."""
        first = self._first(times_s, 0)
        for shift in (1, -1, -2) if one_sided else ():
            other = self._first(times_s, shift)
            better = ~self._known(times_s, first[:, None] + np.arange(NEIGHBOURS))
            better &= (self.times_s[other] <= times_s) & (times_s <= self.times_s[other + NEIGHBOURS - 1])
            first = np.where(better, other, first)
        index = first[:, None] + np.arange(NEIGHBOURS)
        weights, slopes = _lagrange(self.times_s[index], times_s)
        base = self.rotations[index[:, 1]]
        turns = so3_log(np.swapaxes(base, 1, 2)[:, None] @ self.rotations[index])
        rotations = base @ so3_exp(np.einsum("ek,eki->ei", weights, turns))
        positions = np.einsum("ek,eki->ei", weights, self.positions[index])
        moves = np.einsum("ek,eki->ei", slopes, self.positions[index] - self.positions[index[:, :1]])
        inverse = np.swapaxes(rotations, 1, 2)
        rates = np.concatenate([(inverse @ moves[..., None])[..., 0], np.einsum("ek,eki->ei", slopes, turns)], axis=1)
        return Between(
            rotations=rotations,
            positions=positions,
            rates=rates,
            index=index,
            weights=weights,
            slopes=slopes,
            known=self._known(times_s, index),
        )

    def _first(self, times_s: Array, shift: int) -> NDArray[np.int64]:
        """Returns the indices of the four poses around each time (E, 4)."""
        second = np.searchsorted(self.times_s, times_s, side="right") - 1
        return np.clip(second - 1 + shift, 0, max(len(self) - NEIGHBOURS, 0))

    def _known(self, times_s: Array, index: NDArray[np.int64]) -> NDArray[np.bool_]:
        inside = (times_s >= self.times_s[0]) & (times_s <= self.times_s[-1])
        intervals = np.diff(self.times_s[index], axis=1).max(1)
        return inside & (intervals <= min(GAP * float(np.median(np.diff(self.times_s))), LONGEST_S))


@dataclass(frozen=True, eq=False)
class Between:
    """A course at times (E,)."""

    rotations: Array
    """(E, 3, 3) world_from_camera."""
    positions: Array
    """(E, 3)."""
    rates: Array
    """(E, 6) velocity and angular velocity [rad/s] in the camera's own frame."""
    index: NDArray[np.int64]
    """(E, 4) indices of the poses used,"""
    weights: Array
    """(E, 4) their weights,"""
    slopes: Array
    """(E, 4) [1/s] and their weights in the rates."""
    known: NDArray[np.bool_]
    """(E,) whether there are poses near enough."""


def _lagrange(nodes: Array, at: Array) -> tuple[Array, Array]:
    """Weights (E, K) of values at nodes (E, K) for the value at (E,), and those for the slope there."""
    count = nodes.shape[1]
    weights, slopes = np.ones_like(nodes), np.zeros_like(nodes)
    for k in range(count):
        others = [j for j in range(count) if j != k]
        for j in others:
            weights[:, k] *= (at - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
        for left in others:
            term = 1 / (nodes[:, k] - nodes[:, left])
            for j in others:
                if j != left:
                    term = term * (at - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
            slopes[:, k] += term
    return weights, slopes


STEP_S = 0.01
"""Step of the offsets that are tried."""
LEAST_PAIRS = 6
"""Least number of intervals between two poses of both cameras."""
LEAST_SHARE = 0.5
"""Least share of the largest number of intervals that an offset must be tested on."""
UNEXPLAINED = 0.5
"""Where this share of the rotations' mean square is not explained, the cameras did not rotate together,"""
STILL_RAD = np.radians(0.1)
"""unless they hardly rotated at all: root mean square from one pose to the next."""


@dataclass(frozen=True, eq=False)
class Start:
    """Initial values from the poses of a stereo pair's left camera and of a video camera."""

    offset_s: float
    """The video's time stamps are to be increased by it."""
    left_from_video: Array
    """(3, 3) rotation."""
    unexplained: float
    """Share of the rotations' mean square that is not explained."""
    turned_rad: float
    """Root mean square of the rotations from one stereo pose to the next."""

    @property
    def together(self) -> bool:
        """The two may be cameras on one rig, filming at the same time."""
        return self.unexplained < UNEXPLAINED or self.turned_rad < STILL_RAD


def start_of(left: Course, video: Course, most_s: float, middle_s: float = 0.0) -> Start | None:
    """Tries offsets within `most_s` of `middle_s`; None where the two share too little time at all of them."""
    offsets = middle_s + STEP_S * np.arange(-np.floor(most_s / STEP_S), np.floor(most_s / STEP_S) + 1)
    tried = [_tried(left, video, float(offset)) for offset in offsets]
    most = max((count for count, *_ in tried), default=0)
    good = [k for k, (count, *_) in enumerate(tried) if count >= max(LEAST_PAIRS, LEAST_SHARE * most)]
    if not good:
        return None
    best = min(good, key=lambda k: (tried[k][1], abs(offsets[k] - middle_s)))
    _, share, rotation, turned = tried[best]
    return Start(float(offsets[best]), rotation, share, turned)


def _tried(left: Course, video: Course, offset_s: float) -> tuple[int, float, Array, float]:
    """Returns the number of intervals, the unexplained share, the best rotation, and the size of the rotations."""
    seen = video.at(left.times_s - offset_s)
    good = seen.known[:-1] & seen.known[1:]
    count = int(good.sum())
    if count < LEAST_PAIRS:
        return count, np.inf, np.eye(3), 0.0
    a = so3_log(np.swapaxes(left.rotations[:-1], 1, 2)[good] @ left.rotations[1:][good])
    b = so3_log(np.swapaxes(seen.rotations[:-1], 1, 2)[good] @ seen.rotations[1:][good])
    u, _, vt = np.linalg.svd(a.T @ b)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    squares = float((a**2).sum())
    away = float(((a - b @ rotation.T) ** 2).sum())
    return count, away / max(squares, 1e-18), rotation, float(np.sqrt(squares / count))
