"""What is known of the poses of a window, and of its correction, besides the observations in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.lie import logs
from ispom.numerics.places import places

POSE = 6
"""Unknowns of a pose: left twist (rho, phi) of camera_from_world."""
LENS = 2
"""Unknowns of what is wrong with one lens, or with both of a pair: see window.Window.extra."""
LEAST_SIGMA = 1e-6
"""Of a correction [rad, share, s], before any data: less than a thousandth of a pixel, as good as exact."""


@dataclass(frozen=True, eq=False)
class PendingScores:
    """What tracks that go on have said of the slope of the cost: it is squared together with what they say later."""

    ids: NDArray[np.int64]
    """(T,) ascending."""
    slopes: Array
    """(T, D)."""

    @staticmethod
    def none(size: int) -> PendingScores:
        """Of no track, by so many unknowns."""
        return PendingScores(np.zeros(0, np.int64), np.zeros((0, size)))

    def and_of(self, ids: NDArray[np.int64], slopes: Array) -> PendingScores:
        """With (N, D) `slopes` of tracks (N,) more, each of which is in it once at most."""
        at = places(self.ids, ids)
        known, own = at >= 0, self.slopes.copy()
        own[at[known]] += slopes[known]
        every = np.concatenate([self.ids, ids[~known]])
        order = np.argsort(every, kind="stable")
        return PendingScores(every[order], np.concatenate([own, slopes[~known]])[order])

    def without(self, gain: Array, gone: NDArray[np.bool_]) -> PendingScores:
        """See Sandwich.without."""
        return PendingScores(self.ids, self.slopes[:, ~gone] - self.slopes[:, gone] @ gain.T)


def _without(form: Array, gain: Array, gone: NDArray[np.bool_]) -> Array:
    """A symmetric matrix (D, D), see Sandwich.without."""
    rows = form[gone]
    taken = gain @ (rows[:, ~gone] - rows[:, gone] @ gain.T / 2)
    return form[np.ix_(~gone, ~gone)] - taken - taken.T


@dataclass(frozen=True, eq=False)
class Evidence:
    """What else the corrections show in: `design` times them is `seen`, in deviations, by Cauchy's weights."""

    design: Array
    """(N, E)."""
    seen: Array
    """(N,)."""
    left: Array
    """(N,) what the rows are off by where the weights are of."""
    ids: NDArray[np.int64]
    """(N,) of the tracks that say it, each once."""


@dataclass(frozen=True, eq=False)
class Sandwich:
    """A covariance is H^-1 S H^-1; both are the same where all errors are independent and as large as the loss says."""

    curvature: Array
    """H (D, D), second derivatives of the cost: its loss's own, where `Prior.hessian` holds the weights."""
    scatter: Array
    """S (D, D), the covariance of the cost's gradient, but for what `lasting` tracks make of it."""
    lasting: PendingScores | None = None

    def without(self, gain: Array, gone: NDArray[np.bool_]) -> Sandwich:
        """Of what is left when the unknowns `gone` (D,) are eliminated: `gain` (D - G, G) times their gradient is taken
        from that of the others."""
        lasting = None if self.lasting is None else self.lasting.without(gain, gone)
        return Sandwich(_without(self.curvature, gain, gone), _without(self.scatter, gain, gone), lasting)

    def times(self, factor: float) -> Sandwich:
        """In a unit of the cost in which there is so many times as much of it."""
        lasting = None if self.lasting is None else replace(self.lasting, slopes=factor * self.lasting.slopes)
        return Sandwich(factor * self.curvature, factor**2 * self.scatter, lasting)

    def with_evidence(self, evidence: Evidence) -> Sandwich:
        """The loss's second derivatives by what a row is off by are its weight times 1 - 2 left^2."""
        design, left, size = evidence.design, evidence.left, len(self.curvature)
        corrections = slice(size - design.shape[1], size)
        curvature, slopes = self.curvature.copy(), np.zeros((len(design), size))
        curvature[corrections, corrections] += design.T @ (design * (1 - 2 * left**2)[:, None])
        slopes[:, corrections] = design * left[:, None]
        return Sandwich(
            curvature, self.scatter, (self.lasting or PendingScores.none(size)).and_of(evidence.ids, slopes)
        )


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

    def times(self, factor: float) -> Prior:
        """The same in another unit of the cost: so many times all of it, and the same covariance."""
        sandwich = self.sandwich or Sandwich(self.hessian, self.hessian)
        return replace(
            self,
            hessian=factor * self.hessian,
            gradient=factor * self.gradient,
            constant=factor * self.constant,
            sandwich=sandwich.times(factor),
        )

    def with_evidence(self, evidence: Evidence) -> Prior:
        """With what else the corrections show in."""
        hessian, gradient, e, design = self.hessian.copy(), self.gradient.copy(), len(self.extra), evidence.design
        error = design @ self.extra - evidence.seen
        hessian[-e:, -e:] += design.T @ design
        gradient[-e:] += design.T @ error
        sandwich = None if self.sandwich is None else self.sandwich.with_evidence(evidence)
        constant = self.constant + 0.5 * float(error @ error)
        return replace(self, hessian=hessian, gradient=gradient, constant=constant, sandwich=sandwich)

    def aged(self, kept: float, sigma: Array) -> Prior:
        """Of the corrections a while later: `kept` of each is left, and as much has come that its deviation returns to
        `sigma` (E,) if nothing is seen (a Gauss-Markov process); 0 holds one.
        """
        poses, size = len(self.hessian) - len(sigma), len(self.hessian)
        now = np.flatnonzero(sigma > 0) + poses
        if not 0 <= kept < 1 or not len(now):
            return self
        came = 1 / ((1 - kept**2) * sigma[now - poses] ** 2)
        # now = kept * then + what came; the values then, at the end, are eliminated
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
            lasting = sandwich.lasting
            if lasting is not None:
                slopes = lasting.slopes - lasting.slopes[:, now] @ gain.T
                slopes[:, now] -= lasting.slopes[:, now]
                lasting = PendingScores(lasting.ids, slopes)
            own = Sandwich(with_then(sandwich.curvature), with_then(sandwich.scatter))
            sandwich = replace(own.without(gain, np.arange(len(both)) >= size), lasting=lasting)
        return replace(self, hessian=(hessian + hessian.T) / 2, gradient=gradient, sandwich=sandwich)

    def cost(self, shift: Array) -> float:
        """Of a change `shift` (6 P + E,); inf where a step ended at no number, so that it is not taken."""
        if not np.isfinite(shift).all():
            return float("inf")
        return float(0.5 * shift @ self.hessian @ shift + self.gradient @ shift) + self.constant


def anchored(rotation: Array, translation: Array, extra_sigma: Array, sigma: float = 1e-6) -> Prior:
    """The prior that makes the first pose the world: known to `sigma`."""
    information = np.concatenate([np.full(POSE, sigma**-2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0])
    zeros, held = np.zeros(len(information)), np.diag(information)
    sandwich = Sandwich(held, held)
    return Prior(rotation[None], translation[None], np.zeros(len(extra_sigma)), held, zeros, sandwich=sandwich)
