"""Comparison of one estimate with its reference: coverage, scale, and statistics of all errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.relative_error import kitti_errors, motion_errors
from ispom.evaluation.scale import StepScale, step_scale
from ispom.evaluation.trajectory_error import Alignment, TrajectoryError, rms
from ispom.geometry import Array, Similarity, rotation_angle_rad
from ispom.types import Trajectory


@dataclass(frozen=True)
class Coverage:
    """The part of a reference that an estimate covers."""

    compared: int
    """Number of poses of the estimate that were compared."""
    expected: int
    """Number of poses that the estimate, at its own median rate, would have over the reference's span; at most the
    number of the reference's poses."""
    longest_gap_ns: int
    """Longest time without a compared pose, from the reference's first pose to its last."""


def coverage(estimate: Trajectory, reference: Trajectory, compared_ns: NDArray[np.int64]) -> Coverage:
    """Compares whole trajectories with at least one pose each; `compared_ns` (K,): times of the compared poses."""
    first_ns, last_ns = int(reference.times_ns[0]), int(reference.times_ns[-1])
    expected = len(reference)
    intervals_ns = np.diff(np.unique(estimate.times_ns))
    if len(intervals_ns):
        interval_ns = float(np.median(intervals_ns))
        expected = min(expected, round((last_ns - first_ns) / interval_ns) + 1)
    compared = len(np.unique(compared_ns))
    gaps_ns = np.diff(np.concatenate([[first_ns], np.sort(compared_ns), [last_ns]]))
    return Coverage(compared, max(expected, compared), int(gaps_ns.max()))


AT_REST_M, AT_REST_DEG = 1e-3, 0.1
"""Largest difference of positions [m], and of orientations [deg], of a rig at rest."""
MAX_STRAIGHT_RATIO = 0.05
"""Largest ratio of a straight path's extent across to that along it; positions do not determine the rotation about
it."""


Motion = Literal["rests", "turns", "straight", "free"]
"""At rest; only rotating; on a straight line, so that positions hardly determine the rotation about it; any other
motion.
"""


@dataclass(frozen=True)
class Delta:
    """Distance between the two poses of a relative error."""

    value: float
    """A whole number of poses, or any positive number of metres or seconds."""
    unit: Literal["poses", "m", "s"] = "poses"

    def motions(self, reference: Trajectory) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns indices of the first and last poses (K,) of all motions of that distance.

        In metres, it is the path of the reference up to the first pose that is at least that far; in seconds, the last
        pose is the one nearest in time, and a motion across a gap, whose time differs by more than a quarter, is none.
        """
        first: NDArray[np.intp] = np.arange(len(reference))
        if self.unit == "poses":
            first = first[: max(len(reference) - int(self.value), 0)]
            return first, first + int(self.value)
        if self.unit == "m":
            steps = np.linalg.norm(np.diff(reference.translations, axis=0), axis=1)
            travelled = np.concatenate([[0.0], np.cumsum(steps)])
            # A little less, as sums of steps are rounded.
            last = np.searchsorted(travelled, travelled + self.value * (1 - 1e-9))
            inside = last < len(reference)
            return first[inside], last[inside]
        since = (reference.times_ns - reference.times_ns[:1]) * 1e-9
        after = np.searchsorted(since, since + self.value).clip(1, max(len(since) - 1, 1))
        nearer = abs(since[after - 1] - since - self.value) <= abs(since[after] - since - self.value)
        last = np.where(nearer, after - 1, after)
        good = abs(since[last] - since - self.value) <= MAX_OFF * self.value
        return first[good], last[good]

    def __str__(self) -> str:
        return f"{self.value:g}{'' if self.unit == 'poses' else self.unit}"


MAX_OFF = 0.25
"""Largest relative difference of the duration of a motion from the requested one."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Associated poses (N, at least MIN_POSES) of both, the estimate's aligned."""

    error: TrajectoryError
    coverage: Coverage
    scale: StepScale | None
    """Scale of the estimate before alignment; None where the path is too short."""
    delta: Delta

    @property
    def estimate(self) -> Trajectory:
        """The aligned estimate."""
        return self.error.aligned

    @property
    def reference(self) -> Trajectory:
        return self.error.reference

    @property
    def world_from_own(self) -> Similarity:
        """The alignment of the estimate."""
        return self.error.reference_from_estimate

    @property
    def position_errors(self) -> Array:
        """(N,) distances [m]."""
        return self.error.position_errors_m

    @property
    def rotation_errors_deg(self) -> Array:
        """(N,) angles [deg]."""
        return np.degrees(rotation_angle_rad(np.swapaxes(self.reference.rotations, 1, 2) @ self.estimate.rotations))

    @property
    def motion(self) -> Motion:
        """The kind of motion of the reference's compared poses, on which alignments depend."""
        centred = self.reference.translations - self.reference.translations.mean(axis=0)
        if np.linalg.norm(centred, axis=1).max() <= AT_REST_M:
            turned = rotation_angle_rad(self.reference.rotations[0].T @ self.reference.rotations)
            return "turns" if np.degrees(turned.max()) > AT_REST_DEG else "rests"
        spread = np.linalg.svd(centred, compute_uv=False)
        return "straight" if spread[1] <= MAX_STRAIGHT_RATIO * spread[0] else "free"

    @property
    def relative_errors(self) -> tuple[Array, Array]:
        """Errors (K,) [m] and (K,) [deg] of all motions over `delta`; empty with too few poses."""
        first, last = self.delta.motions(self.reference)
        translation, rotation_rad = motion_errors(self.estimate, self.reference, first, last)
        return translation, np.degrees(rotation_rad)


def compare(
    estimate: Trajectory,
    reference: Trajectory,
    pairs: tuple[Trajectory, Trajectory],
    kind: Alignment,
    delta: Delta = Delta(1),
    first: int | None = None,
) -> Comparison:
    """Compares whole trajectories; `pairs` are the associated poses of both (at least MIN_POSES). The first `first`
    of them determine the alignment, by default all."""
    own, partners = pairs
    return Comparison(
        TrajectoryError(own, partners, kind, first),
        coverage(estimate, reference, partners.times_ns),
        step_scale(own, partners),
        delta,
    )


def measures(found: Comparison) -> dict[str, float | None]:
    """Returns all measures by name with unit; None where the path is too short for one."""
    relative_m, relative_deg = found.relative_errors
    drift = kitti_errors(found.estimate, found.reference)
    return {
        "poses_given": found.coverage.compared,
        "poses_asked": found.coverage.expected,
        "longest_gap_s": found.coverage.longest_gap_ns * 1e-9,
        "alignment_scale": found.world_from_own.scale,
        **_statistics("ate", "m", found.position_errors),
        **_statistics("ate", "deg", found.rotation_errors_deg),
        **_statistics("rpe", "m", relative_m),
        **_statistics("rpe", "deg", relative_deg),
        "kitti_t_percent": drift and drift.t_err_percent,
        "kitti_r_deg_per_100m": drift and drift.r_err_deg_per_100m,
        "kitti_shortest_m": drift and drift.lengths_m[0],
        "kitti_longest_m": drift and drift.lengths_m[-1],
        "scale_start": found.scale and found.scale.first,
        "scale_end": found.scale and found.scale.first * found.scale.end_over_start,
        "scale_end_over_start": found.scale and found.scale.end_over_start,
    }


def local_scale(found: Comparison) -> dict[str, Any]:
    """Returns units of the estimate, before alignment, per unit of the reference, in windows along the path."""
    if found.scale is None:
        return {"times_ns": [], "scale": []}
    return {
        "times_ns": list(found.scale.middles_ns),
        "scale": [found.scale.first * share for share in found.scale.windows],
    }


def _statistics(name: str, unit: str, errors: Array) -> dict[str, float | None]:
    values = {"rmse": rms, "mean": np.mean, "median": np.median, "max": np.max}
    return {f"{name}_{key}_{unit}": float(of(errors)) if len(errors) else None for key, of in values.items()}
