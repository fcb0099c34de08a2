"""Fits splines to poses at known times by least squares, as a start for an optimisation, and returns residuals."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, so3_exp
from ispom.numerics.cholesky import factor, solve_factored
from ispom.numerics.lie import logs
from ispom.solvers.spline.curve import ORDER, Spline

STIFFNESS = 1e-4
"""Weight of the knots' second differences, relative to the poses: it matters only where there are no poses."""


def fitted(times_s: Array, rotations: Array, positions: Array, spacing_s: float, passes: int = 2) -> Spline:
    """Fits a spline to poses (E, 3, 3), (E, 3) [m] at ascending times (E,) [s], with knots every `spacing_s`."""
    spline = _on_the_way(times_s, rotations, positions, spacing_s)
    knots, bend = len(spline), np.diff(np.eye(len(spline)), 2, axis=0)
    sampled = spline.at(times_s)
    basis = np.zeros((len(times_s), knots))
    for k in range(ORDER):
        basis[np.arange(len(times_s)), sampled.first + k] = sampled.weights[:, k]
    lower = factor(basis.T @ basis + STIFFNESS * bend.T @ bend)
    for _ in range(passes):
        # The rotation of a knot affects the poses near it with about the same weights as its position.
        turns = logs(np.swapaxes(sampled.rotations, 1, 2) @ rotations)
        sides = basis.T @ np.column_stack([turns, positions - sampled.positions])
        steps = np.stack([solve_factored(lower, np.ascontiguousarray(side)) for side in sides.T], axis=1)
        spline = spline.moved(steps.ravel())
        sampled = spline.at(times_s)
    return spline


def misfits(spline: Spline, times_s: Array, rotations: Array, positions: Array) -> Array:
    """Returns residuals (E, 6): right twists (rho, phi) from the spline's poses to the given ones."""
    sampled = spline.at(times_s)
    inverse = np.swapaxes(sampled.rotations, 1, 2)
    shift = np.einsum("eij,ej->ei", inverse, positions - sampled.positions)
    return np.column_stack([shift, logs(inverse @ rotations)])


def _on_the_way(times_s: Array, rotations: Array, positions: Array, spacing_s: float) -> Spline:
    """Returns a spline whose knots are interpolated linearly between the poses."""
    start = times_s[0] - 0.25 * spacing_s
    count = int(np.floor((times_s[-1] - start) / spacing_s)) + ORDER
    at = np.clip(start + spacing_s * (np.arange(count) - 1), times_s[0], times_s[-1])
    turns = logs(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])
    before = np.clip(np.searchsorted(times_s, at, "right") - 1, 0, len(turns) - 1)
    share = (at - times_s[before]) / np.diff(times_s)[before]
    turned = rotations[before] @ so3_exp(share[:, None] * turns[before])
    moved = np.column_stack([np.interp(at, times_s, positions[:, k]) for k in range(3)])
    # The spline misses a knot by a sixth of the second difference there.
    steps = logs(np.swapaxes(turned[:-1], 1, 2) @ turned[1:])
    turned[1:-1] = turned[1:-1] @ so3_exp(-np.diff(steps, axis=0) / 6)
    moved[1:-1] -= np.diff(moved, 2, axis=0) / 6
    return Spline(float(start), spacing_s, np.ascontiguousarray(turned), moved)
