"""Twists of poses, compiled: applies the twist of a Gauss-Newton step, and computes that of a pose."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.kernels import kernel
from ispom.numerics.lie import inverse_right_jacobian, log3, rodrigues
from ispom.numerics.vectors import matrix, scaled, store, times, vector


@kernel()
def moved(rotations, translations, steps):
    """Returns poses (N, 3, 3), (N, 3) after left twists (N, 6) = (rho, phi): exp(phi) R, and exp(phi) t + rho."""
    rotations_after, translations_after = np.empty_like(rotations), np.empty_like(translations)
    for n in range(len(steps)):
        a, b, c = steps[n, 3], steps[n, 4], steps[n, 5]
        sine, versine = rodrigues(a * a + b * b + c * c)
        # exp(phi) v = v + sine phi x v + versine phi x (phi x v), of the columns of R and of t
        for d in range(4):
            if d < 3:
                x, y, z = rotations[n, 0, d], rotations[n, 1, d], rotations[n, 2, d]
            else:
                x, y, z = translations[n, 0], translations[n, 1], translations[n, 2]
            u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
            x += sine * u + versine * (b * w - c * v)
            y += sine * v + versine * (c * u - a * w)
            z += sine * w + versine * (a * v - b * u)
            if d < 3:
                rotations_after[n, 0, d], rotations_after[n, 1, d], rotations_after[n, 2, d] = x, y, z
            else:
                translations_after[n, 0] = x + steps[n, 0]
                translations_after[n, 1] = y + steps[n, 1]
                translations_after[n, 2] = z + steps[n, 2]
    return rotations_after, translations_after


def twist_of(pose: Pose) -> Array:
    """Returns Pose.log, fast enough for use at each frame."""
    return _log(np.array(pose.rotation[None], order="C"), np.array(pose.translation[None], order="C"))


@kernel()
def _log(rotations, translations):
    """Returns the twist (6,), (rho, phi), of the first pose."""
    phi, out = log3(matrix(rotations, 0)), np.empty((2, 3))
    # exp(phi, rho) has the translation J_l(phi) rho, and J_l(phi) = J_r(-phi)
    store(out, 0, times(inverse_right_jacobian(scaled(-1.0, phi)), vector(translations, 0)))
    store(out, 1, phi)
    return out.ravel()
