"""Samples of an estimate and a reference at common times, and the errors of blocks that are aligned one by one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array
from ispom.types import Trajectory

MAX_SAMPLES = 3000
"""Largest number of samples, which limits the time of an audit; longer trajectories are thinned evenly."""
MAX_GAP = 5.0
"""Longest interval that is interpolated, in median intervals of its trajectory: no pose is invented in a gap."""


@dataclass(frozen=True, eq=False)
class Path:
    """Poses over time, ready to be interpolated."""

    times_s: Array
    """(N,) strictly increasing, relative to any origin [s]."""
    rotations: Array | None
    """(N, 3, 3) world_from_body; None where the file has positions only."""
    positions: Array
    """(N, 3)."""

    @staticmethod
    def of(trajectory: Trajectory, origin_ns: int, has_rotations: bool) -> Path:
        """Returns the path of a trajectory; of poses with the same time the first one is used."""
        _, first = np.unique(trajectory.times_ns, return_index=True)
        rotations = trajectory.rotations[first] if has_rotations else None
        return Path((trajectory.times_ns[first] - origin_ns) * 1e-9, rotations, trajectory.translations[first])

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def span_s(self) -> float:
        return float(self.times_s[-1] - self.times_s[0])

    @cached_property
    def interval_s(self) -> float:
        """Median interval."""
        return float(np.median(np.diff(self.times_s))) if len(self) > 1 else 0.0

    @cached_property
    def _quaternions(self) -> Array | None:
        """(N, 4) of which neighbours have the same sign."""
        if self.rotations is None:
            return None
        xyzw = Rotation.from_matrix(self.rotations).as_quat()
        same = np.sign(np.einsum("ni,ni->n", xyzw[1:], xyzw[:-1]))
        return xyzw * np.cumprod(np.concatenate([[1.0], np.where(same == 0, 1.0, same)]))[:, None]

    def thinned(self, count: int) -> Path:
        step = -(-len(self) // count)
        rotations = None if self.rotations is None else self.rotations[::step]
        return Path(self.times_s[::step], rotations, self.positions[::step])

    def without(self, spans_s: list[tuple[float, float]]) -> Path:
        """Without the poses at times within these spans, ends included."""
        good = np.ones(len(self), bool)
        for first, last in spans_s:
            good &= (self.times_s < first) | (self.times_s > last)
        rotations = None if self.rotations is None else self.rotations[good]
        return Path(self.times_s[good], rotations, self.positions[good])

    def inside(self, times_s: Array) -> NDArray[np.bool_]:
        """(M,) whether a time is one of a pose, or between two without a gap."""
        after = np.searchsorted(self.times_s, times_s).clip(1, len(self) - 1)
        gap = self.times_s[after] - self.times_s[after - 1]
        near = np.minimum(abs(times_s - self.times_s[after - 1]), abs(times_s - self.times_s[after]))
        within = (times_s >= self.times_s[0]) & (times_s <= self.times_s[-1])
        # A time that a pose has may stand at a gap's end; files are rounded to microseconds.
        return ((gap <= MAX_GAP * self.interval_s) & within) | (near <= 2e-6)

    def positions_at(self, times_s: Array) -> Array:
        """(M, 3), linearly."""
        return np.stack([np.interp(times_s, self.times_s, axis) for axis in self.positions.T], axis=1)

    def rotations_at(self, times_s: Array) -> Array | None:
        """(M, 3, 3): linear quaternions, which are as good as slerp over the small turns between poses."""
        if self._quaternions is None:
            return None
        xyzw = np.stack([np.interp(times_s, self.times_s, axis) for axis in self._quaternions.T], axis=1)
        return Rotation.from_quat(xyzw).as_matrix()


@dataclass(frozen=True, eq=False)
class Samples:
    """Poses of both at common times."""

    times_s: Array
    """(N,)."""
    own: Array
    """(N, 3) positions of the estimate."""
    own_rotations: Array | None
    true: Array
    """(N, 3) positions of the reference."""
    true_rotations: Array | None

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def rotations(self) -> tuple[Array, Array] | None:
        """Of estimate and reference, where both have them."""
        if self.own_rotations is None or self.true_rotations is None:
            return None
        return self.own_rotations, self.true_rotations

    def select(self, index: NDArray) -> Samples:
        rotations = [None if r is None else r[index] for r in (self.own_rotations, self.true_rotations)]
        return Samples(self.times_s[index], self.own[index], rotations[0], self.true[index], rotations[1])

    def moved(self, own: Array, own_rotations: Array | None) -> Samples:
        return replace(self, own=own, own_rotations=own_rotations)


def clocks_at(own: Path, true: Path, offset_s: float = 0.0) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the reference's times (N,) of all candidates for samples, and which of them both have.

    They are the times of the trajectory that has fewer poses, of which the other one is interpolated. `offset_s` is
    added to the estimate's times.
    """
    if own.interval_s >= true.interval_s:
        times = own.thinned(MAX_SAMPLES).times_s + offset_s
    else:
        times = true.thinned(MAX_SAMPLES).times_s
    return times, own.inside(times - offset_s) & true.inside(times)


def samples_at(own: Path, true: Path, times_s: Array, offset_s: float = 0.0) -> Samples:
    """Interpolates both; `times_s` (N,) are the reference's, `offset_s` is added to the estimate's times."""
    shifted = times_s - offset_s
    return Samples(
        times_s,
        own.positions_at(shifted),
        own.rotations_at(shifted),
        true.positions_at(times_s),
        true.rotations_at(times_s),
    )
