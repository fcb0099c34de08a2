"""What is known of the poses of a window, and of its correction, besides the observations in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.lie import logs

POSE = 6
"""Unknowns of a pose: left twist (rho, phi) of camera_from_world."""
LENS = 2
"""Unknowns of what is wrong with one lens, or with both of a pair: see window.Window.extra."""


@dataclass(frozen=True, eq=False)
class Sandwich:
    """A covariance is H^-1 S H^-1; both are the same where all errors are independent and as large as the loss says."""

    curvature: Array
    """H (D, D), second derivatives of the cost: its loss's own, where `Prior.hessian` holds the weights."""
    scatter: Array
    """S (D, D), the covariance of the cost's gradient."""

    def without(self, gain: Array, gone: NDArray[np.bool_]) -> Sandwich:
        """Of what is left when the unknowns `gone` (D,) are eliminated: `gain` (D - G, G) times their gradient is taken
        from that of the others."""
        over = np.zeros((len(gain), len(gone)))
        over[:, gone], over[:, ~gone] = -gain, np.eye(len(gain))
        return Sandwich(over @ self.curvature @ over.T, over @ self.scatter @ over.T)


@dataclass(frozen=True, eq=False)
class Prior:
    """What marginalised poses and points say of those still there: cost 1/2 d' H d + g' d + c, d their change since."""

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
    constant: float = 0.0
    """c, what the evidence that was added costs where d is 0."""
    sandwich: Sandwich | None = None
    """Where someone keeps what the covariance follows from."""

    def shifted(self, rotations: Array, translations: Array, extra: Array) -> Array:
        """d (6 P + E,) of the values now against those of the linearisation."""
        p = len(self.rotations)
        turn = rotations[:p] @ np.swapaxes(self.rotations, 1, 2)
        rho = translations[:p] - (turn @ self.translations[:, :, None])[..., 0]
        return np.concatenate([np.hstack([rho, logs(turn)]).ravel(), extra - self.extra])

    def with_evidence(self, design: Array, seen: Array) -> Prior:
        """With what else the corrections show in: `design` (N, E) times them is `seen` (N,), in deviations."""
        hessian, gradient, e = self.hessian.copy(), self.gradient.copy(), len(self.extra)
        error = design @ self.extra - seen
        hessian[-e:, -e:] += design.T @ design
        gradient[-e:] += design.T @ error
        return replace(self, hessian=hessian, gradient=gradient, constant=self.constant + 0.5 * float(error @ error))

    def aged(self, kept: float, sigma: Array) -> Prior:
        """Of the corrections a while later: `kept` of each is left, and as much has come that its deviation returns to
        `sigma` (E,) if nothing is seen (a Gauss-Markov process); 0 holds one.
        """
        poses = len(self.hessian) - len(sigma)
        now = np.flatnonzero(sigma > 0) + poses
        if not 0 <= kept < 1 or not len(now):
            return self
        came = 1 / ((1 - kept**2) * sigma[now - poses] ** 2)
        # now = kept * then + what came; the values then are eliminated
        gone = (1 - kept) * self.extra[now - poses]
        then, hessian, gradient = self.hessian[now], self.hessian.copy(), self.gradient.copy()
        mixed, own = then.copy(), then[:, now] + np.diag(kept**2 * came)
        mixed[:, now] = -kept * np.diag(came)
        hessian[now], hessian[:, now] = 0.0, 0.0
        hessian[now, now] = came
        gradient[now] = came * gone
        gain = np.linalg.solve(own, mixed).T
        hessian = hessian - gain @ mixed
        gradient = gradient - gain @ (self.gradient[now] - kept * came * gone)
        return replace(self, hessian=(hessian + hessian.T) / 2, gradient=gradient)

    def cost(self, shift: Array) -> float:
        """Of a change `shift` (6 P + E,); inf where a step ended at no number, so that it is not taken."""
        if not np.isfinite(shift).all():
            return float("inf")
        return float(0.5 * shift @ self.hessian @ shift + self.gradient @ shift) + self.constant


def anchored(rotation: Array, translation: Array, extra_sigma: Array, sigma: float = 1e-6) -> Prior:
    """The prior that makes the first pose the world: known to `sigma`."""
    information = np.concatenate([np.full(POSE, sigma**-2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0])
    zeros = np.zeros(len(information))
    return Prior(rotation[None], translation[None], np.zeros(len(extra_sigma)), np.diag(information), zeros)
