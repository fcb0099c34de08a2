"""Adjustment of the joint problem: robust first, then without what does not fit; with covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.problem import Estimate, NormalEquations, Observations, Unknowns, moved, normal_equations
from ispom.geometry import Array
from ispom.numerics.levenberg_marquardt import minimise

HUBER = 2.0
"""Residuals beyond so many sigmas count linearly while outliers are looked for."""
OUTLIER = 5.0
"""A point farther off than this, in sigmas of all, is rejected,"""
WORST_VIEW = 3.0
"""and a view whose residuals are so many times those of the median view."""
LEAST_PX = 0.05
"""Residuals below are never outliers: they are finer than any detector."""
ROUNDS = 6
ITERATIONS = 60
TOLERANCE, ROUGH_TOLERANCE = 1e-9, 1e-4
"""Of the cost, in the end and while outliers are looked for."""
LEAST_IN_VIEW = 6
"""Points that keep a view."""


@dataclass(frozen=True, eq=False)
class Solution:
    """An adjusted estimate."""

    estimate: Estimate
    seen: Observations
    """What it is adjusted to: all that was not rejected."""
    unknowns: Unknowns
    residuals_px: Array
    """(M, 2) predicted minus seen."""
    unit_sigma: float
    """How much larger the residuals are than their sigmas say."""
    covariance: Array
    """(G, G) of the shared parameters, in the order of `unknowns.places`; scaled by `unit_sigma`. Infinite on the
    diagonal where a parameter is not determined."""
    equations: NormalEquations

    @property
    def rms_px(self) -> float:
        """Root mean square distance of predicted from seen points, as OpenCV's calibrateCamera returns it."""
        return float(np.sqrt((self.residuals_px**2).sum(1).mean()))

    def view_uncertainties(self) -> tuple[Array, Array]:
        """Of each view's pose (left twist of rig_from_board: [m], [rad]): its covariance (V, 6, 6) where the shared
        parameters are given, and (V, 6, G) how it follows them."""
        _, _, inverse = self.equations.reduced(0.0)
        return self.unit_sigma**2 * inverse, -np.einsum("vij,vgj->vig", inverse, self.equations.mixed)


def adjusted(
    start: Estimate,
    seen: Observations,
    unknowns: Unknowns,
    huber: float | None = None,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Estimate:
    """The estimate of least cost; with `huber` (in sigmas of the observations) large residuals count linearly."""
    inverse_variance = 1 / seen.sigma_px**2

    def sizes(estimate: Estimate) -> Array:
        """(M,) in sigmas; large behind a camera."""
        away = np.linalg.norm(estimate.residuals_px(seen), axis=1)
        return np.nan_to_num(away, nan=1e4) / seen.sigma_px

    def cost(estimate: Estimate) -> float:
        size = sizes(estimate)
        if huber is None:
            return float((size**2).sum())
        return float(np.where(size <= huber, size**2, huber * (2 * size - huber)).sum())

    def stepped(estimate: Estimate, damping: float) -> Estimate:
        weights = inverse_variance
        if huber is not None:
            weights = weights * np.minimum(1, huber / np.maximum(sizes(estimate), 1e-12))
        return moved(estimate, unknowns, *normal_equations(estimate, seen, unknowns, weights).step(damping))

    return minimise(start, cost, stepped, iterations, tolerance, highest=1e8).values


def solve(start: Estimate, seen: Observations, unknowns: Unknowns) -> tuple[Solution, NDArray[np.bool_]]:
    """The solution, and (M,) which observations it is of: the others do not fit and are rejected."""
    keep = np.ones(len(seen), bool)
    estimate = start
    for _ in range(ROUNDS):
        part = seen.select(keep)
        scale = _scale(estimate.residuals_px(part), part.sigma_px)
        estimate = adjusted(estimate, part, unknowns, HUBER * scale, tolerance=ROUGH_TOLERANCE)
        fits = _fitting(estimate.residuals_px(seen), seen)
        if (fits == keep).all():
            break
        keep = fits
    part = seen.select(keep)
    return solution(adjusted(estimate, part, unknowns), part, unknowns), keep


def solution(estimate: Estimate, seen: Observations, unknowns: Unknowns) -> Solution:
    """The estimate with its covariance, at the least cost."""
    residuals = estimate.residuals_px(seen)
    views = len(np.unique(seen.view))
    freedom = 2 * len(seen) - unknowns.count - 6 * views
    chi2 = float(((residuals / seen.sigma_px[:, None]) ** 2).sum())
    unit = float(np.sqrt(chi2 / max(freedom, 1)))
    equations = normal_equations(estimate, seen, unknowns, 1 / seen.sigma_px**2)
    return Solution(estimate, seen, unknowns, residuals, unit, unit**2 * _inverse(equations), equations)


def _inverse(equations: NormalEquations) -> Array:
    """Of the reduced matrix; infinite on the diagonal where a parameter takes part in a direction without weight."""
    matrix = equations.reduced(0.0)[0]
    if not len(matrix):
        return matrix
    scale = 1 / np.sqrt(np.maximum(np.diag(equations.shared), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    weak = values < 1e-13 * max(float(values[-1]), 1e-300)
    inverse = (vectors[:, ~weak] / values[~weak]) @ vectors[:, ~weak].T * np.outer(scale, scale)
    lost = (np.abs(vectors[:, weak]) > 1e-3).any(axis=1)
    inverse[lost, lost] = np.inf
    return inverse


def _scale(residuals_px: Array, sigma_px: Array) -> float:
    """Standard deviation of residuals in sigmas, by their median (of a Rayleigh distribution)."""
    away = np.nan_to_num(np.linalg.norm(residuals_px, axis=1), nan=np.inf) / sigma_px
    middle = float(np.median(away)) / 1.1774
    return middle if np.isfinite(middle) and middle > 0 else 1.0


def _fitting(residuals_px: Array, seen: Observations) -> NDArray[np.bool_]:
    """(M,) which observations fit: neither their view nor they themselves stand out."""
    away = np.nan_to_num(np.linalg.norm(residuals_px, axis=1), nan=np.inf)
    size = away / seen.sigma_px
    group = seen.view * (int(seen.camera.max()) + 1) + seen.camera
    groups, index = np.unique(group, return_inverse=True)
    middles = np.array([np.median(size[index == g]) for g in range(len(groups))])
    good_views = (middles <= WORST_VIEW * np.median(middles)) | (
        np.array([np.median(away[index == g]) for g in range(len(groups))]) < LEAST_PX
    )
    keep = good_views[index]
    scale = _scale(residuals_px[keep], seen.sigma_px[keep]) if keep.any() else 1.0
    keep &= (size <= OUTLIER * scale) | (away < LEAST_PX)
    enough = np.bincount(index[keep], minlength=len(groups)) >= LEAST_IN_VIEW
    return keep & enough[index]
