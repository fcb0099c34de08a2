"""How far off a pose may be: the region that holds it with 95 %, from the covariance of its Step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ispom.geometry import Array, Pose
from ispom.types import Step

from .texts import angle, length

CHI2_95_OF_3 = float(chdtri(3, 0.05))
"""What a chi-square variable with 3 degrees of freedom stays below with 95 %."""


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Of positions, in the world and unit of the pose."""

    centre: Array
    """(3,)."""
    axes: Array
    """(3, 3) a rotation: its columns are the axes, the shortest first."""
    half_sizes: Array
    """(3,) along them."""

    @property
    def pose(self) -> Pose:
        """world_from_ellipsoid."""
        return Pose(self.axes, self.centre)


def ellipsoid(world_from_frame: Pose, covariance: Array) -> Ellipsoid | None:
    """Of the (6, 6) covariance of the twist (rho, phi) on the right of the pose; None where that is not finite.

    To first order the position moves by R rho: the twist is given along the axes of the frame.
    """
    if not np.isfinite(covariance).all():
        return None
    variances, axes = np.linalg.eigh(covariance[:3, :3])
    axes = axes * np.sign(np.linalg.det(axes))
    return Ellipsoid(
        world_from_frame.translation,
        world_from_frame.rotation @ axes,
        np.sqrt(CHI2_95_OF_3 * np.maximum(variances, 0.0)),
    )


def of_step(step: Step) -> Ellipsoid | None:
    """None where the method gives no pose or no covariance."""
    if step.world_from_frame is None or step.covariance is None:
        return None
    return ellipsoid(step.world_from_frame, step.covariance)


def describe(step: Step, unit_m: float | None) -> str:
    """The largest half size and angle, for people; empty where nothing is known. `unit_m` is the step's unit [m], None
    where nobody knows it."""
    found = of_step(step)
    if found is None or step.covariance is None:
        return ""
    variance = max(float(np.linalg.eigvalsh(step.covariance[3:, 3:]).max()), 0.0)
    size, angle_deg = float(found.half_sizes.max()), float(np.degrees(np.sqrt(CHI2_95_OF_3 * variance)))
    position = f"{size:.3g} of its own unit" if unit_m is None else length(unit_m * size)
    return f"95 % confidence: {position}, {angle(angle_deg)} (largest axis)"
