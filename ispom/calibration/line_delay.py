"""The line delay of a rolling shutter: by how much later each row of an image is exposed than the one above it.

How the board moved in each view, by the images right before and after it, says how far a corner went between the
exposure of the middle row and that of its own (Ait-Aider et al. 2006; Oth et al. 2013). The delay that explains the
residuals best is found by one linear step, in which interior and poses are free as well. Noise of the velocities would
draw it towards 0 (Fuller 1987, section 1.2): what it adds to the normal equation is taken away again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import projected
from ispom.calibration.adjust.problem import Observations, normal_equations
from ispom.calibration.adjust.solve import Solution, adjusted, solution
from ispom.calibration.motion.course import Between
from ispom.calibration.result import LineDelay
from ispom.geometry import Array, skew

ROUNDS = 3
RELATIVE = 0.02
"""Systematic error: over simulated films of a hand-held camera the delay comes out 1 to 2 % too small."""


def with_line_delay(found: Solution, moves: Between, view_of: NDArray[np.int64]) -> tuple[Solution, LineDelay | None]:
    """Of one camera: the solution for its corners as a shutter that does not roll would have them, and the delay.

    `moves` are those of the camera before the board at the times of views; `view_of` (E,) says which views. Without
    views that move, nothing changes and the delay is None; nor does anything where it is not significant.
    """
    rates = np.zeros((len(found.estimate.rotations), 6))
    rates[view_of[moves.known]] = moves.rates[moves.known]
    noise = np.zeros(len(rates))
    noise[view_of[moves.known]] = (moves.slopes[moves.known] ** 2).sum(1)
    if not rates.any():
        return found, None
    height = found.estimate.cameras[0].height
    filmed, delay_s = found.seen, 0.0
    best, told = found, LineDelay(0.0, np.inf, height)
    for _ in range(ROUNDS):
        shift = _per_second(best, filmed, rates)
        step_s, error_s = _step(best, shift, _by_noise(best, noise))
        delay_s += step_s
        told = LineDelay(delay_s, float(np.hypot(error_s, RELATIVE * delay_s)), height)
        if not told.rolls:
            return found, told
        part = filmed.with_uv(filmed.uv - delay_s * shift)
        best = solution(adjusted(best.estimate, part, best.unknowns), part, best.unknowns)
    return best, told


def _per_second(found: Solution, filmed: Observations, rates: Array) -> Array:
    """(M, 2) by how many pixels a corner is off for each second of delay from row to row."""
    camera = found.estimate.cameras[0]
    _, in_camera = found.estimate.in_camera(filmed, 0, np.ones(len(filmed), bool))
    rate = rates[filmed.view]
    moving = -rate[:, :3] - np.cross(rate[:, 3:], in_camera)  # the camera moves, the board stands still
    rows = filmed.uv[:, 1:] - (camera.height - 1) / 2
    return rows * (projected(camera, in_camera)[1] @ moving[..., None])[..., 0]


def _by_noise(found: Solution, noise: Array) -> float:
    """What the noise of the velocities adds to the square of the shift, beside what the poses take up of it.

    `noise` (V,) [1/s^2] is their variance in those of the poses, which are as uncertain around a view as in it.
    """
    seen, estimate, camera = found.seen, found.estimate, found.estimate.cameras[0]
    own, _ = found.view_uncertainties()
    _, in_camera = estimate.in_camera(seen, 0, np.ones(len(seen), bool))
    by_point = projected(camera, in_camera)[1] / seen.sigma_px[:, None, None]
    by_pose = np.concatenate([by_point, -by_point @ skew(in_camera)], axis=2)
    rows = seen.uv[:, 1] - (camera.height - 1) / 2
    total = 0.0
    for v in np.flatnonzero(noise).tolist():
        mine = seen.view == v
        if not mine.any():
            continue
        moves, shifts = by_pose[mine].reshape(-1, 6), (rows[mine, None, None] * by_pose[mine]).reshape(-1, 6)
        left = shifts - moves @ np.linalg.lstsq(moves, shifts, rcond=None)[0]
        total += noise[v] * float(np.trace(own[v] @ (left.T @ left)))
    return total


def _step(found: Solution, shift: Array, by_noise: float) -> tuple[float, float]:
    """By how much the delay [s] is still off, and its standard error: least squares over all unknowns."""
    seen, estimate = found.seen, found.estimate
    weights = 1 / seen.sigma_px**2
    predicted = seen.uv + found.residuals_px
    # Residuals that are the shift itself: their gradient is what interior and poses can make of it.
    equations = normal_equations(estimate, seen.with_uv(predicted - shift), found.unknowns, weights)
    shared, views = equations.step(0.0)
    alone = float((weights[:, None] * shift**2).sum())
    alone += float(equations.shared_gradient @ shared + (equations.view_gradients * views).sum())
    pulled = float((weights[:, None] * shift * found.residuals_px).sum())
    pulled += float(found.equations.shared_gradient @ shared + (found.equations.view_gradients * views).sum())
    true = alone - by_noise
    if true <= 0:
        return 0.0, np.inf
    return -pulled / true, found.unit_sigma * float(np.sqrt(alone)) / true
