"""The absolute trajectory error (ATE): association in time, alignment, and the error curve.

All tables, curves and files of the program use this definition of the error of a trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Rig, Trajectory

MAX_DIFFERENCE_NS = 10_000_000
"""Largest time difference of associated poses, as by default in evo and in TUM's tools (0.01 and 0.02 s)."""


def associate(
    estimate: Trajectory, reference: Trajectory, max_difference_ns: int = MAX_DIFFERENCE_NS
) -> tuple[Trajectory, Trajectory]:
    """Returns the poses of both whose times differ by at most `max_difference_ns`, equally long.

    Each pose of the shorter trajectory is paired with the nearest one of the longer.
    """
    if not len(estimate) or not len(reference):
        return Trajectory.empty(estimate.frame), Trajectory.empty(reference.frame)
    if len(estimate) > len(reference):
        partners, own = associate(reference, estimate, max_difference_ns)
        return own, partners
    own, other = _seconds(estimate), _seconds(reference)
    after = np.searchsorted(reference.times_ns, estimate.times_ns, side="right").clip(0, len(reference) - 1)
    before = (after - 1).clip(0)
    gap_before, gap_after = abs(own - other[before]), abs(other[after] - own)
    nearest = np.where(gap_before <= gap_after, before, after)
    near = np.minimum(gap_before, gap_after) <= max_difference_ns * 1e-9
    return estimate.select(near), reference.select(nearest[near])


def _seconds(trajectory: Trajectory) -> Array:
    """Returns times (N,) [s] as floats, as in other programs, so that these associate the same of two equally near
    poses."""
    return (trajectory.times_ns.astype(np.longdouble) / 1e9).astype(float)


Alignment = Literal["none", "first", "scale", "se3", "sim3"]


def alignment(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> Similarity:
    """Returns reference_world_from_estimate_world from associated poses, at least one.

    first: the first poses coincide; se3, sim3: the motion (and scale) that brings the positions closest (Umeyama 1991);
    scale: only the scale of sim3, about the estimate's origin.
    """
    if kind == "none":
        return Similarity()
    if kind == "first":
        return Similarity(1.0, reference.pose(0) @ estimate.pose(0).inverse())
    similarity = umeyama(estimate.translations, reference.translations, with_scale=kind != "se3")
    return Similarity(similarity.scale, Pose()) if kind == "scale" else similarity


def placed(estimate: Trajectory, world_from_own: Similarity) -> Trajectory:
    """Transforms the poses to another world and scale."""
    return Trajectory(
        estimate.times_ns,
        world_from_own.pose.rotation @ estimate.rotations,
        world_from_own.apply(estimate.translations),
        estimate.frame,
    )


def aligned(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> Trajectory:
    """Returns the estimate in the reference's world. Both hold associated poses, at least one."""
    return placed(estimate, alignment(estimate, reference, kind))


def ate_m(estimate: Trajectory, reference: Trajectory) -> float:
    """Returns the root mean square distance of associated positions [m]."""
    return rms(np.linalg.norm(estimate.translations - reference.translations, axis=1))


def rms(values: np.ndarray) -> float:
    """Returns the root mean square of values (N,), N >= 1."""
    return float(np.sqrt(np.mean(np.square(values))))


MIN_POSES = 3
"""Least number of associated poses that determine an alignment."""


def alignment_of(metric: bool) -> Alignment:
    """Returns how a trajectory is aligned to the ground truth: SE(3) where its unit is the metre, else Sim(3)."""
    return "se3" if metric else "sim3"


@dataclass(frozen=True, eq=False)
class TrajectoryError:
    """Associated poses (N, at least MIN_POSES) of an estimate and of its reference, and the alignment between them."""

    estimate: Trajectory
    """The estimate in its own world and unit."""
    reference: Trajectory
    alignment: Alignment
    first: int | None = None
    """Number of first poses that determine the alignment; None for all."""

    @cached_property
    def reference_from_estimate(self) -> Similarity:
        """The alignment."""
        own, true = (t if self.first is None else t[: self.first] for t in (self.estimate, self.reference))
        assert isinstance(own, Trajectory) and isinstance(true, Trajectory)
        return alignment(own, true, self.alignment)

    @cached_property
    def aligned(self) -> Trajectory:
        """The estimate in the world of the reference."""
        return placed(self.estimate, self.reference_from_estimate)

    @cached_property
    def position_errors_m(self) -> Array:
        """(N,) distances of the aligned positions from the reference: the error curve."""
        return np.linalg.norm(self.aligned.translations - self.reference.translations, axis=1)

    @cached_property
    def ate_m(self) -> float:
        """Root mean square of the error curve: the absolute trajectory error (ATE)."""
        return rms(self.position_errors_m)

    def over(self, times_ns: NDArray[np.int64]) -> TrajectoryError | None:
        """Returns the error over the poses at these times only, aligned again; None with fewer than MIN_POSES."""
        common = np.isin(self.estimate.times_ns, times_ns)
        if common.sum() < MIN_POSES:
            return None
        return TrajectoryError(self.estimate.select(common), self.reference.select(common), self.alignment, self.first)


def trajectory_error(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> TrajectoryError | None:
    """Returns the error against a reference of the same frame; None with fewer than MIN_POSES common times."""
    own, partners = associate(estimate, reference)
    return TrajectoryError(own, partners, kind) if len(own) >= MIN_POSES else None


def error_against_truth(
    estimate: Trajectory, world_from_rig: Trajectory, rig: Rig, kind: Alignment
) -> TrajectoryError | None:
    """Returns the error against the true poses of the rig, transformed to the frame of the estimate's poses."""
    truth = world_from_rig.moved(right=rig.rig_from(estimate.frame), frame=estimate.frame)
    return trajectory_error(estimate, truth, kind)
