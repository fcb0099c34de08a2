"""Whether two sights are of one place: by descriptors, resection, and what else must be there; and the way between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.estimators.modern.loops.sight import Eye, Sight
from ispom.estimators.modern.verification import Candidate, Verification, View
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.motion_only import fit_pose
from ispom.solvers.pose_graph import FREEDOM

FEWEST = 25
"""Points that agree: of 735 pairs of sights of unlike places in three towns one had 16, and one 61, of two facades that
are alike. That odometry can have come back there, and that views agree, is asked besides (find.py)."""
MATCHED, MATCHED_TOGETHER = 12, 15
"""Of them, those that are found by their descriptors alone; the second of what several key frames show together, where
chance has more to match: of 1750 pairs of unlike places one had 13, one 12, three 11."""
INLIER = 4.0
"""Deviations of a feature's place within which it agrees with a pose."""
FEWEST_SCALES = 12
"""Points with a depth in both sights, for the ratio of their units."""
FARTHEST = 0.75
"""Depths of half of the points by which two views of one place may lie apart: with more the way is hardly known."""
SURE_DEPTH, SURE_RAD, SURE_SCALE = 1e-3, 5e-4, 5e-3
"""What a way between two sights is never surer than, as points of one sight err alike: in depths, [rad], ln unit."""


@dataclass(frozen=True, eq=False)
class Way:
    """From an earlier sight to a later one."""

    first_from_then: Similarity
    covariance: Array
    """(7, 7) as that of a pose_graph.Edge."""
    count: int
    """Points that agree."""


def way_between(eye: Eye, first: Sight, then: Sight, together: bool = False) -> Way | None:
    """The relative pose, where both show one place; `together`: the first one is what several key frames show."""
    known = first.with_depth()
    xyz, limit, least = known.xyz.astype(float), INLIER * eye.sigma, MATCHED_TOGETHER if together else MATCHED
    verification = Verification(eye.matcher, limit, (eye.fx * limit,), least, FEWEST, measure_chance=False)
    # What several keyframes show of one point is expected, and found, as often as they show it.
    candidate = Candidate(known.features(eye.fx), lambda index: xyz[index], repeated=together)
    now = then.features(eye.fx)
    view = View(now, lambda index: then.x[index].astype(float), lambda points: eye.fx * eye.in_sight(points))
    found = verification.verify(candidate, view)
    if found is None:
        return None
    seen = found.pairs[:, 1]
    return _measured(
        eye, first, found.xyz, then.x[seen].astype(float), then.xyz[seen].astype(float), found.camera_from_world
    )


def _measured(eye: Eye, first: Sight, xyz: Array, x: Array, own: Array, guess: Pose) -> Way | None:
    """By points (N, 3) of the first sight, where (N, 2) the later one has them, and its own points (N, 3), or NaN."""
    seen = x
    if eye.baseline:
        with np.errstate(invalid="ignore"):
            seen = np.column_stack([x, x[:, 0] - eye.baseline / own[:, 2]])
    fit = fit_pose(xyz, seen, guess, eye.sigma, INLIER * eye.sigma, eye.baseline)
    depth = first.depth
    if fit is None or fit.inliers.sum() < FEWEST:
        return None
    if np.linalg.norm(fit.camera_from_world.inverse().translation) > FARTHEST * depth:
        return None
    scale, of_scale = 1.0, 0.0
    if not eye.baseline:
        measured = _scale(own[fit.inliers, 2] / fit.camera_from_world.apply(xyz[fit.inliers])[:, 2])
        if measured is None:
            return None
        scale, of_scale = measured
    # A left twist of then_from_first is one on the right of first_from_then, the other way.
    into = np.diag(np.repeat([scale, 1.0], 3))
    covariance = np.zeros((FREEDOM, FREEDOM))
    covariance[:6, :6] = into @ np.linalg.inv(fit.information) @ into.T
    sure = np.array([scale * SURE_DEPTH * depth] * 3 + [SURE_RAD] * 3 + [SURE_SCALE])
    covariance += np.diag(sure**2)
    covariance[6, 6] += of_scale**2
    first_from_then = Similarity(1 / scale, fit.camera_from_world.inverse())
    return Way(first_from_then, covariance, int(fit.inliers.sum()))


def _scale(ratios: Array) -> tuple[float, float] | None:
    """The later unit's number of a length over the earlier one's, and the deviation of its logarithm."""
    logs = np.log(ratios[np.isfinite(ratios) & (ratios > 0)])
    if len(logs) < FEWEST_SCALES:
        return None
    middle = float(np.median(logs))
    deviation = 1.4826 * float(np.median(np.abs(logs - middle)))
    return float(np.exp(middle)), 1.25 * deviation / len(logs) ** 0.5
