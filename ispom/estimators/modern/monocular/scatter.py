"""Covariance of a window from the curvature of its cost and the scatter of its gradient.

It is the sandwich H^-1 S H^-1 (Huber 1967; White 1982): the error of an estimate is H^-1 g, and S is the covariance of
the gradient g at the true value. The normal equations alone assume independent errors of one size and fixed weights of
the loss: they overestimate the precision, in some directions by half. The nearest points, which constrain the
translation most, have the largest errors. So H uses the second derivatives of the loss, and S is the sum over tracks of
their squared scores: it contains any size of their errors, and any correlation between frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.solvers.neighbours import small_sample_factor
from ispom.solvers.window.adjustment import Equations, Window
from ispom.solvers.window.curvature import Curved, curved, left_out
from ispom.solvers.window.observation import Observed
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich

LEAST_SHARE = 0.1
"""Least curvature relative to that with fixed weights: a point with less constrains no poses, and each direction keeps
at least this share."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariance of poses and corrections, as factors."""

    root: Array
    """(D, D) square root of the covariance: times its own transpose it is the covariance."""
    pulls: Array
    """(M, D) change of poses and corrections by the errors of each track."""
    wider: float
    """Factor on the variance of the tracks' errors, for their correlation and the small sample."""


@dataclass(frozen=True, eq=False)
class Curvature:
    """Derivatives of the cost of a window's observations, D = 6 C + 2: by left twists of poses, and by corrections."""

    window: Window
    observed: Observed
    """The window's arrays."""
    found: Curved

    @staticmethod
    def of(window: Window, sigma: float) -> Curvature:
        """Computes the derivatives; `sigma`: width of the loss, normalised."""
        arrays = window.observed
        return Curvature(window, arrays, curved(arrays, sigma, LEAST_SHARE))

    def sandwich(self, shared: float) -> Sandwich:
        """Returns the factors of the sandwich, including the window's prior; `shared` is the variance factor of
        correlated tracks."""
        return Sandwich(self._curvature(), self._scatter(self.found.scores, shared))

    def spread(self, sigma: float, shared: float) -> Spread:
        """Returns the covariance, including the window's prior; `shared` is the variance factor of correlated
        tracks."""
        root, middle = self._factors(sigma)
        inverse = root.T @ middle @ root
        scores, last = self.left_out(inverse), POSE * len(self.window.rotations)
        wider = shared * small_sample_factor(scores @ inverse[:, last - POSE : last], shared)
        scatter = self._scatter(scores, wider)
        # Scaled by the normal equations: the gauge prior, 1e12 times as precise, would leave no digits for the rest.
        values, vectors = np.linalg.eigh(root @ scatter @ root.T)
        return Spread(root.T @ middle @ (vectors * np.sqrt(np.maximum(values, 0.0))), -scores @ inverse, wider)

    def inverse(self, sigma: float) -> Array:
        """Returns the inverse (D, D) of the second derivatives, including those of the window's prior."""
        root, middle = self._factors(sigma)
        return root.T @ middle @ root

    def _curvature(self) -> Array:
        """Returns the curvature (D, D), including that of the prior."""
        prior = self.window.prior
        if prior is None:
            return self.found.reduced.copy()
        kept = prior.hessian if prior.sandwich is None else prior.sandwich.curvature
        return self._with_prior(self.found.reduced, prior, kept)

    def _scatter(self, scores: Array, shared: float) -> Array:
        """Returns the scatter (D, D) of the gradient, including that of the prior."""
        prior, own = self.window.prior, shared * scores.T @ scores
        if prior is None:
            return own
        return self._with_prior(own, prior, prior.hessian if prior.sandwich is None else prior.sandwich.scatter)

    @staticmethod
    def _with_prior(own: Array, prior: Prior, kept: Array) -> Array:
        """Adds the prior's part `kept` to `own` (D, D), at the prior's poses, which are the first, and at the
        corrections."""
        at = np.concatenate([np.arange(POSE * len(prior.rotations)), np.arange(len(own) - LENS, len(own))])
        out = own.copy()
        out[np.ix_(at, at)] += kept
        return out

    def _factors(self, sigma: float) -> tuple[Array, Array]:
        """Returns the factors (D, D) of `inverse`; the first is the inverse Cholesky factor of the normal equations."""
        held = Equations.of(self.window, sigma).symmetric
        found = self._curvature()
        fixed = np.flatnonzero(self.window.extra_sigma <= 0) + len(found) - LENS
        found[fixed, fixed] = held[fixed, fixed]
        try:
            root = np.linalg.inv(np.linalg.cholesky(held))
        except np.linalg.LinAlgError:  # no numerical minimum: the normal equations are used
            return np.eye(len(held)), np.linalg.inv(held)
        share, turn = np.linalg.eigh(root @ found @ root.T)
        return root, turn / np.maximum(share, LEAST_SHARE) @ turn.T

    def left_out(self, inverse: Array) -> Array:
        """Returns the scores (M, D) that each track would have, to first order, if it had not influenced the poses;
        `inverse` is that of all second derivatives. A few tracks dominate some directions, and leave small residuals
        there."""
        return left_out(self.observed, self.found, self.found.scores @ inverse)
