"""Estimates a trajectory as a spline from the observations of all cameras of a rig, each at its own time.

Bundle adjustment in continuous time (Furgale et al. 2012): a metric stereo pair and a video camera whose frames need
not coincide share one spline. Points are inverse depths (Civera et al. 2008) in fixed coordinate frames, so far points
and those of unknown depth converge as well as near ones. The pose of the video camera in the rig and its time offset
can be unknowns, too. Uses Levenberg-Marquardt and the robust loss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.cholesky import factor, inverse_factored, solve_factored
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.lie import logs
from ispom.numerics.robust import robust_weights
from ispom.solvers.spline.curve import Sampled, add_smoothness
from ispom.solvers.spline.normal_equations import Eliminated, Knots, reduce
from ispom.solvers.spline.observation import RIG, Observed, slope, squared_errors
from ispom.solvers.spline.points import point_scores, point_sensitivity, point_steps, views_moved
from ispom.solvers.spline.problem import LEFT, VIDEO, PosePrior, RigModel, SplineProblem

Tried = tuple[SplineProblem, Sampled, float]
"""Values, their poses at the frames, and their cost."""
OVER_RELAXATION = 2.0
"""Factor of a second, longer step (over-relaxation), taken if its cost is lower. With fixed weights, steps are too
short where the loss flattens; trying it is cheap, and four such steps achieve as much as six others."""
MAX_WIDENINGS = 3
"""Largest number of times that the loss is widened if it is too narrow for the errors."""
HIGHEST_DAMPING = 1e4
"""Damping at which no step is expected to lower the cost."""
NOT_MOVED = np.zeros((0, 3))
MIN_INFORMATION = 1e-6
"""Information of a knot without observations: standard deviations of 1 km and of 1000 rad, which is any angle."""


@dataclass(frozen=True, eq=False)
class PointUncertainty:
    """Errors of points from those of spline and rig, z: sensitivity @ z (3,). Other errors of a point are separate."""

    sensitivity: Array
    """(K, 3, n) derivative of the points by z."""
    parameters: Array
    """(n, n) covariance of z."""
    shared: Array
    """(K, 3, S) total derivative of the points, through spline and rig as well, by errors that observations share, such
    as of the lens."""
    moves: Array
    """(K, n) change of spline and rig by each point's own observations: part of `parameters`."""

    def select(self, index: NDArray) -> PointUncertainty:
        return PointUncertainty(self.sensitivity[index], self.parameters, self.shared[index], self.moves[index])


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimised problem, with the data from which its covariances are computed."""

    problem: SplineProblem
    sampled: Sampled
    hessian: Array
    """(n, n) reduced Hessian of knots and rig at the end, undamped, without the prior that fixes the world."""
    eliminated: Eliminated
    """Data of the elimination of the points."""
    errors_before: Array
    """(O,) reprojection errors [standard deviations] at the start."""
    errors: Array
    """(O,) reprojection errors [standard deviations] at the end."""
    cost_before: float
    cost_after: float
    iterations: int

    def parameter_covariance(self, reference: PosePrior) -> Array:
        """Returns the covariance (n, n) of knots and rig with a `reference` pose; zero for fixed ones."""
        knots = 6 * len(self.problem.spline)
        j = self.sampled.jacobian(reference.exposure, len(self.problem.spline))
        hessian, free = self.hessian.copy(), _free(self.problem)
        hessian[:knots, :knots] += j.T @ reference.information @ j
        full = np.zeros_like(hessian)
        full[np.ix_(free, free)] = covariance_of(hessian[np.ix_(free, free)])
        return full

    def sandwich_covariance(self, parameters: Array) -> tuple[Array, Array]:
        """Returns the covariance (n, n) of knots and rig by actual residuals, and each point's changes of them (M, n).

        It is the sandwich of `window.covariance`, with scores as if left out, as the many knots follow the errors of
        tracks; the loss's own curvature is approximated by its mean over each camera's observations (`slope`; Huber
        1981, section 7.6). Priors keep their covariance. `parameters` is as of `parameter_covariance`.
        """
        p, o, spline, n = self.problem, self.problem.observations, self.problem.spline, len(parameters)
        scores = point_scores(_knots(p, self.sampled), o.exposure, o.owner, self.eliminated)
        scores -= self._score_changes(scores @ parameters)
        weights, slopes = robust_weights(self.errors**2, p.loss), np.ones(len(scores))
        for camera, images in ((VIDEO, 2), (LEFT, 3)):
            its = o.camera == camera
            slopes[o.owner[its]] = slope(weights[its], images)
        scores /= slopes[:, None]
        prior_matrix = np.zeros((n, n))
        add_smoothness(spline.rotations, spline.positions, spline.spacing_s, *p.smoothness, prior_matrix, np.zeros(n))
        prior_matrix[-RIG:, -RIG:] += p.rig_prior.information
        moves = scores @ parameters
        return parameters + moves.T @ moves - parameters @ (self.hessian - prior_matrix) @ parameters, moves

    def _score_changes(self, moves: Array) -> Array:
        """Returns the change (M, n) of each point's score as it moves spline and rig by `moves` (M, n)."""
        p, o, knots = self.problem, self.problem.observations, _knots(self.problem, self.sampled)
        moved = views_moved(moves, knots, _observed(p, self.sampled), bool(p.rig.free.any()))
        return point_scores(knots, o.exposure, o.owner, self._where_moved(-moved)[2])

    def _where_moved(self, moved: Array) -> tuple[Array, Array, Eliminated]:
        """Returns the result of `_reduced` for residuals `moved` (O, 3) only."""
        p = self.problem
        at = np.column_stack([p.points.values[:, 2], p.depth_prior[:, 1]])
        return _reduced(replace(p, depth_prior=at), self.sampled, 0.0, np.ascontiguousarray(moved))

    def follows(self, moved: Array, parameters: Array) -> tuple[Array, Array]:
        """Returns the changes of knots and rig (n, S) and of points (M, 3, S) if observations move by (O, 3, S)."""
        p, o, steps, points = self.problem, self.problem.observations, list[Array](), list[Array]()
        for way in np.moveaxis(moved, 2, 0):
            _, right, pulled = self._where_moved(way)
            steps.append(parameters @ right)
            points.append(point_steps(steps[-1], _knots(p, self.sampled), o.exposure, o.owner, pulled))
        return np.stack(steps, axis=1), np.stack(points, axis=2)

    def pose_covariance(self, e: int, parameters: Array) -> Array:
        """Returns the covariance (6, 6) of the pose at frame e, a right twist (rho, phi), from that of `parameters`."""
        s, k = self.sampled, 6 * int(self.sampled.first[e])
        j = s.jacobian(e, len(self.problem.spline))[:, k : k + 24]
        turn = np.vstack([s.rotations[e].T @ j[3:], j[:3]])
        return turn @ parameters[k : k + 24, k : k + 24] @ turn.T

    def point_uncertainty(self, chosen: NDArray[np.int64], parameters: Array, moves: Array) -> PointUncertainty:
        """Returns the uncertainty of the chosen points (K,), in their values; for `moves` see `sandwich_covariance`."""
        o, knots = self.problem.observations, _knots(self.problem, self.sampled)
        sensitivity = point_sensitivity(chosen, knots, o.exposure, o.owner, self.eliminated)
        none = np.zeros((len(chosen), 3, 0))
        return PointUncertainty(sensitivity, parameters, none, moves[chosen])

    def refined_rig(self, parameters: Array) -> RigModel:
        """Returns the estimated rig, with the information from its covariance."""
        free, rig = np.flatnonzero(self.problem.rig.free), self.problem.rig
        information = rig.information.copy()
        information[np.ix_(free, free)] = np.linalg.inv(parameters[-RIG:, -RIG:][np.ix_(free, free)])
        return replace(rig, information=information)


def covariance_of(information: Array) -> Array:
    """Returns the inverse (n, n) of an information matrix; undetermined parameters get a large, finite variance."""
    found = inverse_factored(factor(information))
    if (found.diagonal() < 1 / MIN_INFORMATION).all():  # not for NaN either
        return found
    return inverse_factored(factor(information + MIN_INFORMATION * np.eye(len(information))))


def solve(problem: SplineProblem, iterations: int = 8, tolerance: float = 1e-3) -> Solution:
    """Minimises the robust reprojection errors.

    Ends early when a step lowers the cost by less than the share `tolerance`. If the errors are much larger than the
    loss scale (wrong time offset or rig), the loss is first widened to them, so that all observations have weight.
    """
    begun, done = problem.sampled(), 0
    before, errors_before = _cost(problem, begun), np.sqrt(_squares(problem, begun))
    for _ in range(MAX_WIDENINGS):
        typical = _typical(problem)
        if not typical > 2 * problem.loss:
            break
        wide, _, _, steps = _descended(replace(problem, loss=typical), iterations, tolerance)
        problem, done = replace(wide, loss=problem.loss), done + steps
    problem, sampled, cost, steps = _descended(problem, iterations, tolerance)
    done += steps
    hessian, _, points = _normal_equations(
        replace(problem, prior=replace(problem.prior, information=np.zeros((6, 6)))), sampled, 0.0
    )
    errors = np.sqrt(_squares(problem, sampled))
    return Solution(problem, sampled, hessian, points, errors_before, errors, before, cost, done)


def _typical(problem: SplineProblem) -> float:
    """Returns the largest median error [standard deviations] of a camera."""
    errors, camera = np.sqrt(_squares(problem, problem.sampled())), problem.observations.camera
    return max((float(np.median(errors[camera == c])) for c in np.unique(camera)), default=0.0)


def _descended(problem: SplineProblem, iterations: int, tolerance: float) -> tuple[SplineProblem, Sampled, float, int]:
    """Optimises the values; returns them, their poses, the cost, and the number of steps."""

    def stepped(values: Tried, damping: float) -> Tried:
        now, sampled, _ = values
        step, point_step = _step(now, sampled, damping)
        once, longer = (_tried(_moved(now, share * step, share * point_step)) for share in (1.0, OVER_RELAXATION))
        return longer if longer[2] < once[2] else once

    found = minimise(_tried(problem), lambda tried: tried[2], stepped, iterations, tolerance, HIGHEST_DAMPING)
    return *found.values, found.iterations


def _moved(problem: SplineProblem, step: Array, point_step: Array) -> SplineProblem:
    points = replace(problem.points, values=problem.points.values + point_step)
    return replace(problem, spline=problem.spline.moved(step[:-RIG]), rig=problem.rig.moved(step[-RIG:]), points=points)


def _tried(problem: SplineProblem) -> Tried:
    sampled = problem.sampled()
    return problem, sampled, _cost(problem, sampled)


def _free(problem: SplineProblem) -> NDArray[np.int64]:
    """Returns the indices of the free unknowns."""
    return np.flatnonzero(np.concatenate([np.ones(6 * len(problem.spline), bool), problem.rig.free]))


def _observed(problem: SplineProblem, sampled: Sampled) -> Observed:
    o, p, rig = problem.observations, problem.points, problem.rig
    return Observed.of(
        sampled.rotations, sampled.positions, *rig.arrays(), rig.baseline_m, o.exposure, o.camera, o.owner, o.seen,
        o.inverse_sigma, p.anchors_r, p.anchors_t, p.values,
    )  # fmt: skip


def _knots(problem: SplineProblem, sampled: Sampled) -> Knots:
    return Knots(len(problem.spline), sampled.first, sampled.rotation_jacobians, sampled.weights, sampled.rates)


def _squares(problem: SplineProblem, sampled: Sampled) -> Array:
    return squared_errors(_observed(problem, sampled))


def _prior_residual(problem: SplineProblem, sampled: Sampled) -> Array:
    """Returns the residual (6,) of the pose prior: rotation in the rig [rad], position [m]."""
    e, pose = problem.prior.exposure, problem.prior.world_from_rig
    turn = logs((pose.rotation.T @ sampled.rotations[e])[None])[0]
    return np.concatenate([turn, sampled.positions[e] - pose.translation])


def _cost(problem: SplineProblem, sampled: Sampled) -> float:
    squares, c2 = _squares(problem, sampled), problem.loss**2
    cost = 0.5 * c2 * float(np.log1p(squares / c2).sum())
    depth = problem.points.values[:, 2] - problem.depth_prior[:, 0]
    cost += 0.5 * float((problem.depth_prior[:, 1] * depth**2).sum())
    n = 6 * len(problem.spline) + RIG
    spline = problem.spline
    cost += add_smoothness(
        spline.rotations, spline.positions, spline.spacing_s, *problem.smoothness, np.zeros((n, n)), np.zeros(n)
    )
    r, g = _prior_residual(problem, sampled), problem.rig.minus(problem.rig_prior)
    return cost + 0.5 * float(r @ problem.prior.information @ r) + 0.5 * float(g @ problem.rig_prior.information @ g)


def _reduced(
    problem: SplineProblem, sampled: Sampled, damping: float, moved: Array = NOT_MOVED
) -> tuple[Array, Array, Eliminated]:
    """Returns the result of `normal_equations.reduce`."""
    knots, with_rig = _knots(problem, sampled), bool(problem.rig.free.any())
    return reduce(knots, _observed(problem, sampled), problem.depth_prior, problem.loss, damping, with_rig, moved)


def _normal_equations(problem: SplineProblem, sampled: Sampled, damping: float) -> tuple[Array, Array, Eliminated]:
    """Returns the reduced Hessian and right side, with all priors, and the data for the points' step."""
    spline, (hessian, right, points) = problem.spline, _reduced(problem, sampled, damping)
    add_smoothness(spline.rotations, spline.positions, spline.spacing_s, *problem.smoothness, hessian, right)
    j, r = sampled.jacobian(problem.prior.exposure, len(spline)), _prior_residual(problem, sampled)
    shaping = slice(0, 6 * len(spline))
    hessian[shaping, shaping] += j.T @ problem.prior.information @ j
    right[shaping] -= j.T @ (problem.prior.information @ r)
    hessian[-RIG:, -RIG:] += problem.rig_prior.information
    right[-RIG:] -= problem.rig_prior.information @ problem.rig.minus(problem.rig_prior)
    return hessian, right, points


def _step(problem: SplineProblem, sampled: Sampled, damping: float) -> tuple[Array, Array]:
    """Returns one damped step of knots and rig (n,), and of the points (M, 3)."""
    hessian, right, points = _normal_equations(problem, sampled, damping)
    free, step = _free(problem), np.zeros(len(right))
    reduced = hessian[np.ix_(free, free)]
    reduced[np.diag_indices_from(reduced)] *= 1 + damping
    step[free] = solve_factored(factor(reduced), right[free])
    o = problem.observations
    return step, point_steps(step, _knots(problem, sampled), o.exposure, o.owner, points)
