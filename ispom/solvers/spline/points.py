"""The points of a spline's bundle adjustment: their steps, derivatives and scores, from those of knots and rig."""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel, part
from ispom.solvers.spline.normal_equations import fill_by_rig, gain, spread_over_knots
from ispom.solvers.spline.observation import MIN_DEPTH, RIG, empty_rows, linearise, placed


@kernel()
def point_steps(step, knots, exposures, owners, eliminated):
    """Back-substitution: returns the points' steps (M, 3) for a step (n,) of spline and rig."""
    poses, left = np.zeros((len(knots.first), 6)), eliminated.sides.copy()
    for e in range(len(poses)):
        _step_of_pose(poses[e], e, knots, step)
    for o in range(len(owners)):
        _subtract(left[owners[o]], eliminated.mixed[o], poses[exposures[o]])
    for m in range(len(left)):
        _subtract(left[m], eliminated.mixed_rig[m], step[6 * knots.count :])
        _multiply(left[m], eliminated.inverses[m])
    return left


@part
def _step_of_pose(out, e, knots, step):
    for q in range(4):
        base, turn, weight = 6 * (knots.first[e] + q), knots.rotation_jacobians[e, q], knots.weights[e, q]
        for k in range(3):
            out[k] += turn[k, 0] * step[base] + turn[k, 1] * step[base + 1] + turn[k, 2] * step[base + 2]
            out[3 + k] += weight * step[base + 3 + k]


@part
def _subtract(left, mixed, step):
    """Subtracts M' step from left (3,)."""
    for j in range(3):
        for k in range(len(mixed)):
            left[j] -= mixed[k, j] * step[k]


@part
def _multiply(left, block):
    """Replaces left (3,) by V^-1 left, V^-1 a symmetric block (3, 3)."""
    left[0], left[1], left[2] = gain(block, left[0], left[1], left[2])


@kernel()
def views_moved(moves, knots, observed, with_rig):
    """Returns the shifts (O, 3) of observations by their own points' `moves` (M, n) of spline and rig, for fixed
    points."""
    out, rows, by_rig, pose = np.zeros((len(observed.owners), 3)), empty_rows(), np.empty((2, RIG)), np.empty(6)
    for o in range(len(out)):
        rig, camera = placed(observed, o)
        if camera[2] > MIN_DEPTH:
            e, step, pose[:] = observed.exposures[o], moves[observed.owners[o]], 0.0
            _step_of_pose(pose, e, knots, step)
            count = linearise(rows, observed, o, rig, camera)
            for i in range(count):
                for k in range(6):
                    out[o, i] += rows.by_pose[i, k] * pose[k]
            if with_rig and observed.cameras[o] == 0:
                fill_by_rig(by_rig, rows, camera, observed.points[observed.owners[o], 2], knots.rates, e)
                for i in range(2):
                    for k in range(RIG):
                        out[o, i] += by_rig[i, k] * step[6 * knots.count + k]
            for i in range(count):
                out[o, i] /= observed.inverse_sigma[o, i]
    return out


@kernel()
def point_sensitivity(chosen, knots, exposures, owners, eliminated):
    """Returns the derivatives (K, 3, n) of the chosen points (K,) by the unknowns of spline and rig."""
    g, number = 6 * knots.count, np.full(len(eliminated.inverses), -1)
    out = np.zeros((len(chosen), 3, g + RIG))
    for i in range(len(chosen)):
        number[chosen[i]] = i
        for j in range(3):
            for k in range(RIG):
                out[i, j, g + k] = eliminated.mixed_rig[chosen[i], k, j]
    for o in range(len(exposures)):
        if number[owners[o]] >= 0:
            spread_over_knots(out[number[owners[o]]], knots, exposures[o], eliminated.mixed[o])
    for i in range(len(chosen)):
        for k in range(g + RIG):
            a, b, c = gain(eliminated.inverses[chosen[i]], out[i, 0, k], out[i, 1, k], out[i, 2, k])
            out[i, 0, k], out[i, 1, k], out[i, 2, k] = -a, -b, -c
    return out


@kernel()
def point_scores(knots, exposures, owners, eliminated):
    """Returns the scores (M, n): each point's negative gradient by spline and rig, with the point eliminated."""
    g, steps = 6 * knots.count, eliminated.sides.copy()
    out, score = np.zeros((len(steps), g + RIG)), np.empty(6)
    for m in range(len(steps)):
        _multiply(steps[m], eliminated.inverses[m])
        for k in range(RIG):
            out[m, g + k] = _left(eliminated.scores_rig[m, k], eliminated.mixed_rig[m, k], steps[m])
    for o in range(len(owners)):
        for k in range(6):
            score[k] = _left(eliminated.scores[o, k], eliminated.mixed[o, k], steps[owners[o]])
        _add_to_knots(out[owners[o]], exposures[o], knots, score)
    return out


@part
def _left(score, mixed, step):
    """Returns a component of a score after the point's step (3,)."""
    return score - mixed[0] * step[0] - mixed[1] * step[1] - mixed[2] * step[2]


@part
def _add_to_knots(out, e, knots, score):
    """Adds the score (6,) by the pose at exposure e to the scores by its knots."""
    for q in range(4):
        base, turn, weight = 6 * (knots.first[e] + q), knots.rotation_jacobians[e, q], knots.weights[e, q]
        for k in range(3):
            out[base + k] += turn[0, k] * score[0] + turn[1, k] * score[1] + turn[2, k] * score[2]
            out[base + 3 + k] += weight * score[3 + k]
