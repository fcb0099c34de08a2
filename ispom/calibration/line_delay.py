"""The line delay of a rolling shutter: the delay of each row of an image after the one above it.

The motion of the board in each view, by the images right before and after it, gives the displacement of a corner
between the times of the middle row and its own (Ait-Aider et al. 2006; Oth et al. 2013). The delay that explains the
residuals best follows from one linear step, in which interior and poses are free as well, repeated with the corners of
all images corrected by it. Noise of the velocities would bias it towards 0 (Fuller 1987, section 1.2): its contribution
to the normal equation is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.calibration.adjust.problem import Observations, Unknowns, board_problem, by_twist
from ispom.calibration.adjust.solve import Solution, adjust_views, solution, with_views
from ispom.calibration.motion.course import NEIGHBOURS, Course
from ispom.calibration.result import LineDelay, Views
from ispom.calibration.targets.target import Target
from ispom.cameras import project_with_derivatives
from ispom.geometry import Array
from ispom.solvers.least_squares import normal_equations
from ispom.types import Camera

ROUNDS = 3
HUBER_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Film:
    """Images around the views, in which the board was detected."""

    seen: Observations
    """Views count these images."""
    times_s: Array
    """(N,) increasing."""

    @staticmethod
    def of(target: Target, around: Views, zero_ns: int) -> Film | None:
        """Collects the images; times count from `zero_ns`. None where they are too few."""
        good = [i for i, d in enumerate(around.detections) if not d.reason]
        if len(good) < NEIGHBOURS:
            return None
        seen = Observations.of(target, [[around.detections[i] for i in good]])
        return Film(seen, (around.known_times_ns[good] - zero_ns) * 1e-9)

    def solved(self, camera: Camera, delay_s: float, before: Solution | None) -> Solution:
        """Returns the board's poses before the camera, with corners corrected by the delay as it moved `before`."""
        if before is None:
            seen, start = self.seen, with_views(camera, self.seen)
        else:
            rates, _ = self.moves(before, self.times_s)
            seen = self.seen.with_uv(self.seen.uv - delay_s * _per_second(before, self.seen, rates))
            start = replace(before.estimate, cameras=(camera,))
        unknowns = Unknowns.all_of(start, interior=False)
        return solution(adjust_views(start, seen, unknowns, HUBER_SIGMAS), seen, unknowns)

    def moves(self, solved: Solution, at_s: Array) -> tuple[Array, Array]:
        """Returns velocities (V, 6) [m/s] and [rad/s] of the camera at times (V,), and their covariances (V, 6, 6).

        Both as left twists of camera_from_board; 0 where they are not known.
        """
        poses = [solved.estimate.rig_from_board(v).inverse() for v in range(len(self.times_s))]
        course = Course(self.times_s, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
        between = course.at(at_s, one_sided=True)
        own, _ = solved.view_uncertainties()
        spread = np.einsum("vk,vkij->vij", between.slopes**2, own[between.index])
        known = between.known
        return np.where(known[:, None], between.rates, 0.0), np.where(known[:, None, None], spread, 0.0)


def with_line_delay(found: Solution, film: Film, times_s: Array) -> tuple[Solution, LineDelay | None]:
    """Estimates the delay of one camera; returns the solution for its corners as with a global shutter, and the
    delay.

    `times_s` (V,) are those of its views, on the film's clock. Without views that move, nothing changes and the delay
    is None; nor does anything where it is not significant.
    """
    height = found.estimate.cameras[0].height
    filmed, delay_s = found.seen, 0.0
    best, delay, around = found, LineDelay(0.0, np.inf, height), None
    for _ in range(ROUNDS):
        around = film.solved(best.estimate.cameras[0], delay_s, around)
        rates, covariance = film.moves(around, times_s)
        if not rates.any():
            return found, None
        shift = _per_second(best, filmed, rates)
        step_s, error_s = _step(best, shift, _by_noise(best, covariance))
        delay_s += step_s
        delay = LineDelay(delay_s, error_s, height)
        if not delay.rolls:
            return found, delay
        part = filmed.with_uv(filmed.uv - delay_s * shift)
        best = solution(adjust_views(best.estimate, part, best.unknowns), part, best.unknowns)
    return best, delay


def _per_second(found: Solution, filmed: Observations, rates: Array) -> Array:
    """Returns the displacement of corners (M, 2) [px] per second of delay from row to row."""
    camera = found.estimate.cameras[0]
    _, in_camera = found.estimate.in_camera(filmed, 0, np.ones(len(filmed), bool))
    rate = rates[filmed.view]
    moving = -rate[:, :3] - np.cross(rate[:, 3:], in_camera)  # the camera moves, the board stands still
    rows = filmed.uv[:, 1:] - (camera.height - 1) / 2
    return rows * (project_with_derivatives(camera, in_camera)[1] @ moving[..., None])[..., 0]


def _by_noise(found: Solution, covariance: Array) -> float:
    """Returns what the noise of the velocities, with covariance (V, 6, 6), adds to the square of the displacement,
    less what the poses absorb of it."""
    seen, estimate, camera = found.seen, found.estimate, found.estimate.cameras[0]
    _, in_camera = estimate.in_camera(seen, 0, np.ones(len(seen), bool))
    by_point = project_with_derivatives(camera, in_camera)[1] / seen.sigma_px[:, None, None]
    by_pose = by_twist(by_point, in_camera)
    rows = seen.uv[:, 1] - (camera.height - 1) / 2
    total = 0.0
    for v in np.flatnonzero(covariance.any((1, 2))).tolist():
        mine = seen.view == v
        if not mine.any():
            continue
        moves, shifts = by_pose[mine].reshape(-1, 6), (rows[mine, None, None] * by_pose[mine]).reshape(-1, 6)
        left = shifts - moves @ np.linalg.lstsq(moves, shifts, rcond=None)[0]
        total += float(np.trace(covariance[v] @ (left.T @ left)))
    return total


def _step(found: Solution, shift: Array, by_noise: float) -> tuple[float, float]:
    """Returns the correction of the delay [s], and its standard error: least squares over all unknowns."""
    seen, estimate = found.seen, found.estimate
    weights = 1 / seen.sigma_px**2
    predicted = seen.uv + found.residuals_px
    # Residuals that are the shift itself: their gradient is what interior and poses can make of it.
    problem = board_problem(seen.with_uv(predicted - shift), found.unknowns, estimate.views)
    equations = normal_equations(problem, estimate)
    shared, views = equations.step(0.0)
    alone = float((weights[:, None] * shift**2).sum())
    alone += float(equations.shared_gradient @ shared + (equations.block_gradients * views).sum())
    pulled = float((weights[:, None] * shift * found.residuals_px).sum())
    pulled += float(found.equations.shared_gradient @ shared + (found.equations.block_gradients * views).sum())
    true = alone - by_noise
    if true <= 0:
        return 0.0, np.inf
    return -pulled / true, found.unit_sigma * float(np.sqrt(alone)) / true
