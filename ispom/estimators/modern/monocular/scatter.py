"""What the covariance of a window is made of: how its cost curves, and how far its gradient scatters.

A sandwich (Huber 1967; White 1982): an estimate is off by H^-1 g, so its covariance is H^-1 S H^-1, with S the
covariance of the gradient g where the truth is. The normal equations alone take all errors to be independent and of one
size, and hold the loss's weights: they take some directions for sure by half as much again as they are. For what
says most of how far a camera went are the nearest points, and just these have the largest errors. So H has the loss's
own second derivatives, and S is the sum of what each track says by itself: whatever its errors are, and however they
hang together from view to view, they are in it.
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
"""Of the curvature with weights held: a point that keeps less says nothing of poses, and no direction keeps less."""


@dataclass(frozen=True, eq=False)
class Spread:
    """How far poses and corrections are off."""

    root: Array
    """(D, D) how they move with D independent unit errors: times itself transposed it is their covariance."""
    pulls: Array
    """(M, D) how each track moves them, with all its errors."""
    wider: float
    """How many times as much as each by itself tracks move them together, by what they share and leave open."""


@dataclass(frozen=True, eq=False)
class Curvature:
    """Derivatives of the cost of a window's observations, D = 6 C + 2: by left twists of poses, and by corrections."""

    window: Window
    observed: Observed
    """The window's arrays."""
    found: Curved

    @staticmethod
    def of(window: Window, sigma: float) -> Curvature:
        """`sigma`: width of the loss, normalised."""
        arrays = window.observed
        return Curvature(window, arrays, curved(arrays, sigma, LEAST_SHARE))

    def sandwich(self, shared: float) -> Sandwich:
        """With that of the window's prior; tracks pull together `shared` times as much as each by itself."""
        return Sandwich(self._curvature(), self._scatter(self.found.scores, shared))

    def spread(self, sigma: float, shared: float) -> Spread:
        """With the window's prior; tracks pull together `shared` times as much as each by itself."""
        root, middle = self._factors(sigma)
        inverse = root.T @ middle @ root
        scores, last = self.left_out(inverse), POSE * len(self.window.rotations)
        wider = shared * small_sample_factor(scores @ inverse[:, last - POSE : last], shared)
        scatter = self._scatter(scores, wider)
        # By the normal equations: beside what is held, 1e12 times as sure, the digits of all else would be lost.
        values, vectors = np.linalg.eigh(root @ scatter @ root.T)
        return Spread(root.T @ middle @ (vectors * np.sqrt(np.maximum(values, 0.0))), -scores @ inverse, wider)

    def inverse(self, sigma: float) -> Array:
        """(D, D) of the second derivatives, those of the window's prior included."""
        root, middle = self._factors(sigma)
        return root.T @ middle @ root

    def _curvature(self) -> Array:
        """(D, D) with that of the prior."""
        prior = self.window.prior
        if prior is None:
            return self.found.reduced.copy()
        kept = prior.hessian if prior.sandwich is None else prior.sandwich.curvature
        return self._with_prior(self.found.reduced, prior, kept)

    def _scatter(self, scores: Array, shared: float) -> Array:
        """(D, D) of the gradient, with that of the prior."""
        prior, own = self.window.prior, shared * scores.T @ scores
        if prior is None:
            return own
        return self._with_prior(own, prior, prior.hessian if prior.sandwich is None else prior.sandwich.scatter)

    @staticmethod
    def _with_prior(own: Array, prior: Prior, kept: Array) -> Array:
        """(D, D) `own` plus what is kept of the prior's poses, which are the first, and of the corrections."""
        at = np.concatenate([np.arange(POSE * len(prior.rotations)), np.arange(len(own) - LENS, len(own))])
        out = own.copy()
        out[np.ix_(at, at)] += kept
        return out

    def _factors(self, sigma: float) -> tuple[Array, Array]:
        """(D, D) each, of `inverse`: the first that of the normal equations' Cholesky factor."""
        held = Equations.of(self.window, sigma).symmetric
        found = self._curvature()
        fixed = np.flatnonzero(self.window.extra_sigma <= 0) + len(found) - LENS
        found[fixed, fixed] = held[fixed, fixed]
        try:
            root = np.linalg.inv(np.linalg.cholesky(held))
        except np.linalg.LinAlgError:  # no minimum, to the last digits: then neither is said to be one
            return np.eye(len(held)), np.linalg.inv(held)
        share, turn = np.linalg.eigh(root @ found @ root.T)
        return root, turn / np.maximum(share, LEAST_SHARE) @ turn.T

    def left_out(self, inverse: Array) -> Array:
        """(M, D) scores as they would be, to first order, had each track had no part in the poses, with the `inverse`
        of all second derivatives: few tracks tell much of some directions, and leave little there."""
        return left_out(self.observed, self.found, self.found.scores @ inverse)
