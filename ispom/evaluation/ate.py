"""Absolute trajectory error: the distance of estimated positions from the truth, after alignment."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Trajectory

Alignment = Literal["none", "first", "scale", "se3", "sim3"]


def alignment(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> Similarity:
    """reference_world_from_estimate_world by associated poses, at least one.

    first: the first poses coincide; se3, sim3: the motion (and unit) that brings the positions closest; scale: only
    the unit of that, about the estimate's origin.
    """
    if kind == "none":
        return Similarity()
    if kind == "first":
        return Similarity(1.0, reference.pose(0) @ estimate.pose(0).inverse())
    found = umeyama(estimate.translations, reference.translations, with_scale=kind != "se3")
    return Similarity(found.scale, Pose()) if kind == "scale" else found


def placed(estimate: Trajectory, world_from_own: Similarity) -> Trajectory:
    """The same poses in another world and unit."""
    return Trajectory(
        estimate.times_ns,
        world_from_own.pose.rotation @ estimate.rotations,
        world_from_own.apply(estimate.translations),
        estimate.frame,
    )


def aligned(estimate: Trajectory, reference: Trajectory, kind: Alignment) -> Trajectory:
    """The estimate in the reference's world. Both hold associated poses, at least one."""
    return placed(estimate, alignment(estimate, reference, kind))


def ate_m(estimate: Trajectory, reference: Trajectory) -> float:
    """Root mean square distance of associated positions [m]."""
    return rms(np.linalg.norm(estimate.translations - reference.translations, axis=1))


def rms(values: np.ndarray) -> float:
    """Root mean square of values (N,), N >= 1."""
    return float(np.sqrt(np.mean(np.square(values))))
