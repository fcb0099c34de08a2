"""One trajectory as a spline through the raw observations of all cameras of a rig, each at its own time.

Bundle adjustment in continuous time (Furgale et al. 2012): a metric stereo pair and a video camera whose exposures need
not coincide share one spline. Points are inverse depths (Civera et al. 2008) in a frame that stays where it was put, so
that far points, and those whose depth is not known yet, are as well-behaved as near ones. The pose of the video camera
in the rig and the offset of its clock can be unknowns too. Levenberg-Marquardt, Cauchy loss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.cholesky import factor, inverse_factored, solve_factored
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.lie import logs
from ispom.numerics.robust import cauchy_weights
from ispom.solvers.spline.curve import Sampled, add_smoothness
from ispom.solvers.spline.normal_equations import Eliminated, Knots, reduce
from ispom.solvers.spline.observation import RIG, Observed, slope, squared_errors
from ispom.solvers.spline.points import point_pulls, point_sensitivity, point_steps, views_moved
from ispom.solvers.spline.problem import LEFT, VIDEO, PosePrior, RigModel, SplineProblem

Tried = tuple[SplineProblem, Sampled, float]
"""Values, their poses at the exposures, and their cost."""
LONGER = 2.0
"""Steps with the weights of a loss at hand fall short where it flattens: one so many times as long is tried, too, which
costs little, and taken where it is better (over-relaxation). Four such steps come as far as six others."""
WIDER = 3
"""At most so often a loss that is too narrow for the errors is widened."""
HIGHEST_DAMPING = 1e4
NOT_MOVED = np.zeros((0, 3))
UNSEEN = 1e-6
"""Information of a knot that nothing was seen from: it is known to a kilometre, or not at all as an angle."""


@dataclass(frozen=True, eq=False)
class PointUncertainty:
    """How points follow what they were triangulated from: sensitivity @ z (3,), z being the error of spline and rig.

    What else is wrong with a point is seen where it is seen again, by an error of its own.
    """

    sensitivity: Array
    """(K, 3, n)."""
    parameters: Array
    """(n, n) covariance of z."""
    shared: Array
    """(K, 3, S) how they follow errors that the observations share, such as of the lens: spline and rig with them."""
    moves: Array
    """(K, n) how each, by its own observations, moves spline and rig: part of `parameters`."""

    def select(self, index: NDArray) -> PointUncertainty:
        return PointUncertainty(self.sensitivity[index], self.parameters, self.shared[index], self.moves[index])


@dataclass(frozen=True, eq=False)
class Solution:
    problem: SplineProblem
    sampled: Sampled
    hessian: Array
    """(n, n) of knots and rig at the end, points and undamped, with nothing that holds the world in its place."""
    eliminated: Eliminated
    """What the points were eliminated with."""
    errors_before: Array
    """(O,) reprojection errors [standard deviations] that it began with."""
    errors: Array
    """(O,) at the end."""
    cost_before: float
    cost_after: float
    iterations: int

    def parameter_covariance(self, held: PosePrior) -> Array:
        """(n, n) covariance of knots and rig where a pose is known as `held` says; zero for what is not free."""
        knots = 6 * len(self.problem.spline)
        j = self.sampled.jacobian(held.exposure, len(self.problem.spline))
        hessian, free = self.hessian.copy(), _free(self.problem)
        hessian[:knots, :knots] += j.T @ held.information @ j
        full = np.zeros_like(hessian)
        full[np.ix_(free, free)] = covariance_of(hessian[np.ix_(free, free)])
        return full

    def sandwich_covariance(self, parameters: Array) -> tuple[Array, Array]:
        """(n, n) `parameters`, and (M, n) how each point moves them, where observations are as far off as they turned
        out to be, whatever their weights say.

        The sandwich H^-1 M H^-1 (Huber 1981, section 7.6) with M the sum over points of the squares of what each adds
        to the right side: errors along a track may be alike, as those of one that drifts are (Liang and Zeger 1986).
        Each as it would be, to first order, had the point had no part in the estimate (a jackknife: Bell & McCaffrey
        2002): knots are many, and follow the errors that a track keeps. What is believed beforehand is as sure as it
        says.
        """
        p, o, spline, n = self.problem, self.problem.observations, self.problem.spline, len(parameters)
        pulls = point_pulls(_knots(p, self.sampled), o.exposure, o.owner, self.eliminated)
        pulls -= self._pulls_of(pulls @ parameters)
        weights, slopes = cauchy_weights(self.errors**2, p.loss), np.ones(len(pulls))
        for camera, images in ((VIDEO, 2), (LEFT, 3)):
            its = o.camera == camera
            slopes[o.owner[its]] = slope(weights[its], images)
        pulls /= slopes[:, None]
        believed = np.zeros((n, n))
        add_smoothness(spline.rotations, spline.positions, spline.spacing_s, *p.smoothness, believed, np.zeros(n))
        believed[-RIG:, -RIG:] += p.rig_prior.information
        moves = pulls @ parameters
        return parameters + moves.T @ moves - parameters @ (self.hessian - believed) @ parameters, moves

    def _pulls_of(self, moves: Array) -> Array:
        """(M, n) what each point adds to the right side as it moves spline and rig by `moves` (M, n)."""
        p, o, knots = self.problem, self.problem.observations, _knots(self.problem, self.sampled)
        moved = views_moved(moves, knots, _observed(p, self.sampled), bool(p.rig.free.any()))
        return point_pulls(knots, o.exposure, o.owner, self._where_moved(-moved)[2])

    def _where_moved(self, moved: Array) -> tuple[Array, Array, Eliminated]:
        """As `_reduced`, of observations that are off by `moved` (O, 3) alone."""
        p = self.problem
        at = np.column_stack([p.points.values[:, 2], p.depth_prior[:, 1]])
        return _reduced(replace(p, depth_prior=at), self.sampled, 0.0, np.ascontiguousarray(moved))

    def follows(self, moved: Array, parameters: Array) -> tuple[Array, Array]:
        """How knots and rig (n, S), and points (M, 3, S), follow what moves all observations by (O, 3, S)."""
        p, o, steps, points = self.problem, self.problem.observations, list[Array](), list[Array]()
        for way in np.moveaxis(moved, 2, 0):
            _, right, pulled = self._where_moved(way)
            steps.append(parameters @ right)
            points.append(point_steps(steps[-1], _knots(p, self.sampled), o.exposure, o.owner, pulled))
        return np.stack(steps, axis=1), np.stack(points, axis=2)

    def pose_covariance(self, e: int, parameters: Array) -> Array:
        """(6, 6) of the pose at exposure e, a twist (rho, phi) on its right; `parameters` as `parameter_covariance`."""
        s, k = self.sampled, 6 * int(self.sampled.first[e])
        j = s.jacobian(e, len(self.problem.spline))[:, k : k + 24]
        turn = np.vstack([s.rotations[e].T @ j[3:], j[:3]])
        return turn @ parameters[k : k + 24, k : k + 24] @ turn.T

    def point_uncertainty(self, chosen: NDArray[np.int64], parameters: Array, moves: Array) -> PointUncertainty:
        """Of the chosen points (K,), in their values; the others as of `sandwich_covariance`."""
        o, knots = self.problem.observations, _knots(self.problem, self.sampled)
        sensitivity = point_sensitivity(chosen, knots, o.exposure, o.owner, self.eliminated)
        none = np.zeros((len(chosen), 3, 0))
        return PointUncertainty(sensitivity, parameters, none, moves[chosen])

    def refined_rig(self, parameters: Array) -> RigModel:
        """The rig as estimated, with the information that its covariance leaves."""
        free, rig = np.flatnonzero(self.problem.rig.free), self.problem.rig
        information = rig.information.copy()
        information[np.ix_(free, free)] = np.linalg.inv(parameters[-RIG:, -RIG:][np.ix_(free, free)])
        return replace(rig, information=information)


def covariance_of(information: Array) -> Array:
    """(n, n) inverse of an information matrix; of what it says nothing of, the variance is large, and finite."""
    found = inverse_factored(factor(information))
    if (found.diagonal() < 1 / UNSEEN).all():  # not for NaN either
        return found
    return inverse_factored(factor(information + UNSEEN * np.eye(len(information))))


def solve(problem: SplineProblem, iterations: int = 8, tolerance: float = 1e-3) -> Solution:
    """Minimises the robust reprojection errors.

    Ends early when a step lowers the cost by less than the share `tolerance`. Where the errors are much wider than the
    loss (a wrong clock or rig), the loss is first as wide as they are: from there all observations pull.
    """
    begun, done = problem.sampled(), 0
    before, errors_before = _cost(problem, begun), np.sqrt(_squares(problem, begun))
    for _ in range(WIDER):
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
    """Median error [standard deviations] of the camera that fits worst."""
    errors, camera = np.sqrt(_squares(problem, problem.sampled())), problem.observations.camera
    return max((float(np.median(errors[camera == c])) for c in np.unique(camera)), default=0.0)


def _descended(problem: SplineProblem, iterations: int, tolerance: float) -> tuple[SplineProblem, Sampled, float, int]:
    """With better values, sampled, the cost, and the steps that it took."""

    def stepped(values: Tried, damping: float) -> Tried:
        now, sampled, _ = values
        step, point_step = _step(now, sampled, damping)
        once, longer = (_tried(_moved(now, share * step, share * point_step)) for share in (1.0, LONGER))
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
    """Unknowns that may change."""
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
    """(6,) of the pose that holds the world: rotation in the rig, position."""
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
    """As `normal_equations.reduce` says."""
    knots, with_rig = _knots(problem, sampled), bool(problem.rig.free.any())
    return reduce(knots, _observed(problem, sampled), problem.depth_prior, problem.loss, damping, with_rig, moved)


def _normal_equations(problem: SplineProblem, sampled: Sampled, damping: float) -> tuple[Array, Array, Eliminated]:
    """Reduced Hessian and right side, with all priors; and what finds the points' step."""
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
    """One damped step: (n,) of knots and rig, (M, 3) of the points."""
    hessian, right, points = _normal_equations(problem, sampled, damping)
    free, step = _free(problem), np.zeros(len(right))
    reduced = hessian[np.ix_(free, free)]
    reduced[np.diag_indices_from(reduced)] *= 1 + damping
    step[free] = solve_factored(factor(reduced), right[free])
    o = problem.observations
    return step, point_steps(step, _knots(problem, sampled), o.exposure, o.owner, points)
