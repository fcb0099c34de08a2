"""The height prior of a ground vehicle: from keyframe to keyframe the rig moves in its own plane.

The residual is the change of height, along the rig's y axis at the earlier keyframe. So the road may rise and fall, as
the rig turns with it; a rig that is mounted at a slope to the road needs a standard deviation of at least that slope
times the distance between keyframes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.estimators.modern.stereo.pair import Setup
from ispom.estimators.modern.stereo.state import StereoMap
from ispom.geometry import Array
from ispom.solvers.least_squares import Derivatives
from ispom.solvers.window.prior import POSE
from ispom.solvers.window.problem import PoseFamily, Window


@dataclass(frozen=True, eq=False)
class HeightPrior(PoseFamily):
    """Changes of height (C - 1,) [m] between the first C poses of a window."""

    widths: Array
    """(C - 1,) see PoseFamily."""
    variance: float
    down: Array
    """(3,) the rig's y axis in the left camera."""
    name = "height prior"

    def residuals(self, values: Window) -> Array:
        return (self._next_in_camera(values) @ self.down)[:, None]

    def derivatives(self, values: Window) -> Derivatives:
        """The position q of the next camera changes by rho + phi x q with the twist of the earlier pose, and by
        -R_i R_{i+1}' rho with that of the later one."""
        q = self._next_in_camera(values)
        rotations = values.rotations[: len(q) + 1]
        turned = rotations[1:] @ np.swapaxes(rotations[:-1], 1, 2) @ self.down
        rows = np.concatenate([np.tile(self.down, (len(q), 1)), np.cross(q, self.down), -turned, 0 * turned], axis=1)
        columns = POSE * np.arange(len(q))[:, None] + np.arange(2 * POSE)
        return Derivatives.of_shared(rows[:, None], columns)

    def _next_in_camera(self, values: Window) -> Array:
        """Returns the position (C - 1, 3) of each next left camera in the one before it."""
        poses = slice(len(self.widths) + 1)
        rotations, translations = values.rotations[poses], values.translations[poses]
        centres = -np.einsum("cji,cj->ci", rotations, translations)
        return np.einsum("cij,cj->ci", rotations[:-1], centres[1:]) + translations[:-1]


def height_prior(setup: Setup, world: StereoMap, sigma_m: float) -> HeightPrior:
    """Returns the prior of the window's keyframes; `sigma_m` is the standard deviation of a change of height."""
    variance = world.variance_factor(setup.noise)
    widths = np.full(max(len(world.keys) - 1, 0), sigma_m / np.sqrt(variance))
    return HeightPrior(widths, variance, setup.rig_from_left.rotation[1])
