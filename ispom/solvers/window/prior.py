"""The prior of a window's poses and corrections, from marginalised observations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.lie import logs
from ispom.numerics.places import places

POSE = 6
"""Number of unknowns of a pose: left twist (rho, phi) of camera_from_world."""
LENS = 2
"""Number of lens corrections of one camera, or of both of a pair, see adjustment.Window.extra."""
LEAST_SIGMA = 1e-6
"""Least prior standard deviation of a correction [rad, relative, s]: less than a thousandth of a pixel, practically
fixed."""


@dataclass(frozen=True, eq=False)
class PendingScores:
    """Scores (gradients of the cost) of continuing tracks; they are squared together with their later scores."""

    ids: NDArray[np.int64]
    """(T,) ids of the tracks, ascending."""
    scores: Array
    """(T, D) scores."""

    @staticmethod
    def none(size: int) -> PendingScores:
        """Returns the scores of no track, for `size` unknowns."""
        return PendingScores(np.zeros(0, np.int64), np.zeros((0, size)))

    def and_of(self, ids: NDArray[np.int64], scores: Array) -> PendingScores:
        """Adds the scores `scores` (N, D) of tracks `ids` (N,), each at most once."""
        at = places(self.ids, ids)
        known, own = at >= 0, self.scores.copy()
        own[at[known]] += scores[known]
        every = np.concatenate([self.ids, ids[~known]])
        order = np.argsort(every, kind="stable")
        return PendingScores(every[order], np.concatenate([own, scores[~known]])[order])

    def without(self, gain: Array, gone: NDArray[np.bool_]) -> PendingScores:
        """Eliminates the unknowns `gone`, see Sandwich.without."""
        return PendingScores(self.ids, self.scores[:, ~gone] - self.scores[:, gone] @ gain.T)


def _without(form: Array, gain: Array, gone: NDArray[np.bool_]) -> Array:
    """Eliminates unknowns from a symmetric matrix (D, D), see Sandwich.without."""
    rows = form[gone]
    taken = gain @ (rows[:, ~gone] - rows[:, gone] @ gain.T / 2)
    return form[np.ix_(~gone, ~gone)] - taken - taken.T


@dataclass(frozen=True, eq=False)
class Evidence:
    """Further linear observations `seen` = `design` @ corrections, normalised and robustly weighted."""

    design: Array
    """(N, E) Jacobian."""
    seen: Array
    """(N,) observed values."""
    left: Array
    """(N,) residuals at which the weights were computed."""
    ids: NDArray[np.int64]
    """(N,) ids of the observed tracks, each once."""


@dataclass(frozen=True, eq=False)
class Sandwich:
    """The parts of a covariance H^-1 S H^-1. H and S are equal for independent errors with the width of the loss."""

    curvature: Array
    """H (D, D), second derivatives of the cost with the loss's own; in `Prior.hessian` weights are fixed."""
    scatter: Array
    """S (D, D), the covariance of the cost's gradient, without the contribution of `pending` tracks."""
    pending: PendingScores | None = None

    def without(self, gain: Array, gone: NDArray[np.bool_]) -> Sandwich:
        """Eliminates the unknowns `gone` (D,): `gain` (D - G, G) times their gradient is subtracted from that of the
        others."""
        pending = None if self.pending is None else self.pending.without(gain, gone)
        return Sandwich(_without(self.curvature, gain, gone), _without(self.scatter, gain, gone), pending)

    def times(self, factor: float) -> Sandwich:
        """Returns the sandwich of the cost multiplied by `factor`."""
        pending = None if self.pending is None else replace(self.pending, scores=factor * self.pending.scores)
        return Sandwich(factor * self.curvature, factor**2 * self.scatter, pending)

    def with_evidence(self, evidence: Evidence) -> Sandwich:
        """Adds evidence. The loss's second derivative by a residual is its weight times 1 - 2 left^2."""
        design, left, size = evidence.design, evidence.left, len(self.curvature)
        corrections = slice(size - design.shape[1], size)
        curvature, scores = self.curvature.copy(), np.zeros((len(design), size))
        curvature[corrections, corrections] += design.T @ (design * (1 - 2 * left**2)[:, None])
        scores[:, corrections] = design * left[:, None]
        return Sandwich(
            curvature, self.scatter, (self.pending or PendingScores.none(size)).and_of(evidence.ids, scores)
        )


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior from marginalised poses and points: cost 1/2 d' H d + g' d + c, d the change since linearisation."""

    rotations: Array
    """(P, 3, 3) camera_from_world of the first P poses of the window, at the linearisation."""
    translations: Array
    """(P, 3) translations of these poses."""
    extra: Array
    """(E,) corrections at the linearisation."""
    hessian: Array
    """(6 P + E, 6 P + E) H."""
    gradient: Array
    """(6 P + E,) g."""
    constant: float = 0.0
    """c, the cost of the added evidence at d = 0."""
    sandwich: Sandwich | None = None
    """Parts of the covariance, if the caller keeps them."""

    def shifted(self, rotations: Array, translations: Array, extra: Array) -> Array:
        """Returns d (6 P + E,), the change of the values since the linearisation."""
        p = len(self.rotations)
        turn = rotations[:p] @ np.swapaxes(self.rotations, 1, 2)
        rho = translations[:p] - (turn @ self.translations[:, :, None])[..., 0]
        return np.concatenate([np.hstack([rho, logs(turn)]).ravel(), extra - self.extra])

    def times(self, factor: float) -> Prior:
        """Returns the prior with its cost multiplied by `factor`, and the same covariance."""
        sandwich = self.sandwich or Sandwich(self.hessian, self.hessian)
        return replace(
            self,
            hessian=factor * self.hessian,
            gradient=factor * self.gradient,
            constant=factor * self.constant,
            sandwich=sandwich.times(factor),
        )

    def with_evidence(self, evidence: Evidence) -> Prior:
        """Adds further observations of the corrections."""
        hessian, gradient, e, design = self.hessian.copy(), self.gradient.copy(), len(self.extra), evidence.design
        error = design @ self.extra - evidence.seen
        hessian[-e:, -e:] += design.T @ design
        gradient[-e:] += design.T @ error
        sandwich = None if self.sandwich is None else self.sandwich.with_evidence(evidence)
        constant = self.constant + 0.5 * float(error @ error)
        return replace(self, hessian=hessian, gradient=gradient, constant=constant, sandwich=sandwich)

    def with_process_noise(self, kept: float, sigma: Array) -> Prior:
        """Adds process noise to the corrections (a Gauss-Markov process): each is multiplied by `kept`.

        Without observations the standard deviations return to `sigma` (E,); 0 fixes a correction.
        """
        poses, size = len(self.hessian) - len(sigma), len(self.hessian)
        now = np.flatnonzero(sigma > 0) + poses
        if not 0 <= kept < 1 or not len(now):
            return self
        came = 1 / ((1 - kept**2) * sigma[now - poses] ** 2)
        # now = kept * then + noise; the old values, at the end, are eliminated
        gone, then = (1 - kept) * self.extra[now - poses], size + np.arange(len(now))
        before = np.arange(size)
        before[now] = then

        def with_then(information: Array) -> Array:
            out = np.zeros((size + len(now), size + len(now)))
            out[np.ix_(before, before)] = information
            out[now, now], out[now, then], out[then, now] = came, -kept * came, -kept * came
            out[then, then] += kept**2 * came
            return out

        both, gradient = with_then(self.hessian), self.gradient.copy()
        gain = np.linalg.solve(both[size:, size:], both[size:, :size]).T
        hessian = both[:size, :size] - gain @ both[size:, :size]
        gradient[now] = came * gone
        gradient -= gain @ (self.gradient[now] - kept * came * gone)
        sandwich = self.sandwich
        if sandwich is not None:
            pending = sandwich.pending
            if pending is not None:
                scores = pending.scores - pending.scores[:, now] @ gain.T
                scores[:, now] -= pending.scores[:, now]
                pending = PendingScores(pending.ids, scores)
            own = Sandwich(with_then(sandwich.curvature), with_then(sandwich.scatter))
            sandwich = replace(own.without(gain, np.arange(len(both)) >= size), pending=pending)
        return replace(self, hessian=(hessian + hessian.T) / 2, gradient=gradient, sandwich=sandwich)

    def cost(self, shift: Array) -> float:
        """Returns the cost of a change `shift` (6 P + E,); inf for a step that is not finite, which rejects it."""
        if not np.isfinite(shift).all():
            return float("inf")
        return float(0.5 * shift @ self.hessian @ shift + self.gradient @ shift) + self.constant


def anchored(rotation: Array, translation: Array, extra_sigma: Array, sigma: float = 1e-6) -> Prior:
    """Returns the prior that fixes the first pose, with standard deviation `sigma` [m, rad]."""
    information = np.concatenate([np.full(POSE, sigma**-2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0])
    zeros, fixed = np.zeros(len(information)), np.diag(information)
    sandwich = Sandwich(fixed, fixed)
    return Prior(rotation[None], translation[None], np.zeros(len(extra_sigma)), fixed, zeros, sandwich=sandwich)
