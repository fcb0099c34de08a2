"""What is known of the poses of a window, and of its correction, besides the observations in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.numerics.lie import logs

POSE = 6
"""Unknowns of a pose: left twist (rho, phi) of camera_from_world."""
LENS, PAIR = 2, 4
"""Unknowns E of what is wrong with one camera, and with a pair: see window.Window.extra."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What marginalised poses and points say of those still there: cost 1/2 d' H d + g' d, d their change since."""

    rotations: Array
    """(P, 3, 3) camera_from_world of the first P poses of the window, when linearised."""
    translations: Array
    """(P, 3)."""
    extra: Array
    """(E,)."""
    hessian: Array
    """(6 P + E, 6 P + E)."""
    gradient: Array
    """(6 P + E,)."""

    def shifted(self, rotations: Array, translations: Array, extra: Array) -> Array:
        """d (6 P + E,) of the values now against those of the linearisation."""
        p = len(self.rotations)
        turn = rotations[:p] @ np.swapaxes(self.rotations, 1, 2)
        rho = translations[:p] - (turn @ self.translations[:, :, None])[..., 0]
        return np.concatenate([np.hstack([rho, logs(turn)]).ravel(), extra - self.extra])

    def cost(self, shift: Array) -> float:
        """Of a change `shift` (6 P + E,)."""
        return float(0.5 * shift @ self.hessian @ shift + self.gradient @ shift)


def anchored(rotation: Array, translation: Array, extra_sigma: Array, sigma: float = 1e-6) -> Prior:
    """The prior that makes the first pose the world: known to `sigma`."""
    information = np.concatenate([np.full(POSE, sigma**-2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0])
    zeros = np.zeros(len(information))
    return Prior(rotation[None], translation[None], np.zeros(len(extra_sigma)), np.diag(information), zeros)
