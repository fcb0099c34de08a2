"""Absolute trajectory error: the distance of estimated positions from the truth, after alignment."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ispom.solvers.alignment import umeyama
from ispom.types import Trajectory

Alignment = Literal["none", "se3", "sim3"]


def aligned(estimate: Trajectory, reference: Trajectory, alignment: Alignment) -> Trajectory:
    """The estimate in the reference's world, by the motion (sim3: and unit) that brings the positions closest.

    Both hold associated poses, at least one.
    """
    if alignment == "none":
        return estimate
    found = umeyama(estimate.translations, reference.translations, with_scale=alignment == "sim3")
    return Trajectory(
        estimate.times_ns,
        found.pose.rotation @ estimate.rotations,
        found.apply(estimate.translations),
        estimate.frame,
    )


def ate_m(estimate: Trajectory, reference: Trajectory) -> float:
    """Root mean square distance of associated positions [m]."""
    return rms(np.linalg.norm(estimate.translations - reference.translations, axis=1))


def rms(values: np.ndarray) -> float:
    """Root mean square of values (N,), N >= 1."""
    return float(np.sqrt(np.mean(np.square(values))))
