"""The error of a trajectory, as every table, curve and file of the program states it: the absolute trajectory error."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.association import associate
from ispom.evaluation.ate import Alignment, alignment, placed, rms
from ispom.geometry import Array, Similarity
from ispom.types import Rig, Trajectory

MIN_POSES = 3
"""Fewer associated poses do not fix an alignment."""


def alignment_of(metric: bool) -> Alignment:
    """How a trajectory is aligned to the ground truth: by a rigid motion where its unit is the metre, else by a
    similarity."""
    return "se3" if metric else "sim3"


@dataclass(frozen=True, eq=False)
class TrajectoryError:
    """Associated poses (N, at least MIN_POSES) of an estimate and of its reference, and the alignment between them."""

    estimate: Trajectory
    """In its own world and unit."""
    reference: Trajectory
    alignment: Alignment

    @cached_property
    def reference_from_estimate(self) -> Similarity:
        """What the alignment does to the estimate."""
        return alignment(self.estimate, self.reference, self.alignment)

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
        """The error over the poses at these times alone, aligned again; None where fewer than MIN_POSES are left."""
        common = np.isin(self.estimate.times_ns, times_ns)
        if common.sum() < MIN_POSES:
            return None
        return TrajectoryError(self.estimate.select(common), self.reference.select(common), self.alignment)


def trajectory_error(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> TrajectoryError | None:
    """The error of an estimate against a reference of the same frame; None with fewer than MIN_POSES common times."""
    own, partners = associate(estimate, reference)
    return TrajectoryError(own, partners, kind) if len(own) >= MIN_POSES else None


def error_against_truth(
    estimate: Trajectory, world_from_rig: Trajectory, rig: Rig, kind: Alignment
) -> TrajectoryError | None:
    """The same against the true poses of the rig, carried to the frame that the estimate's poses are of."""
    truth = world_from_rig.moved(right=rig.rig_from(estimate.frame), frame=estimate.frame)
    return trajectory_error(estimate, truth, kind)
