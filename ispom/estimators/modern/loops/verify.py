"""Whether two sights are of one place: by descriptors, resection, and what else must be there; and the way between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.loops.sight import Eye, Sight
from ispom.estimators.modern.places import confirmed, plausible
from ispom.features.descriptors import each_once, near
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.motion_only import fit_pose
from ispom.solvers.multiview.resection import refine_pose, resect
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
    before, now, xyz = known.features(eye.fx), then.features(eye.fx), known.xyz.astype(float)
    limit, least = INLIER * eye.sigma, MATCHED_TOGETHER if together else MATCHED
    pairs = eye.matcher.match(before, now)
    found = resect(xyz[pairs[:, 0]], then.x[pairs[:, 1]].astype(float), limit)
    if found is None or _good(found.inliers, xyz[pairs[:, 0]], found.camera_from_world).sum() < least:
        return None
    expected = eye.in_sight(found.camera_from_world.apply(xyz))
    found_near, similarity = eye.matcher.match_where(before, now, near(eye.fx * expected, now.uv, eye.fx * limit))
    pairs = each_once(found_near, similarity)
    points, x = xyz[pairs[:, 0]], then.x[pairs[:, 1]].astype(float)
    found = refine_pose(points, x, found.camera_from_world, limit)
    if found is None:
        return None
    good = _good(found.inliers, points, found.camera_from_world)
    # What several show of one point is expected, and found, as often as they show it.
    matched = found_near[:, 0] if together else pairs[good, 0]
    if good.sum() < FEWEST or not confirmed(matched, expected, FEWEST):
        return None
    return _measured(eye, first, points[good], x[good], then.xyz[pairs[good, 1]].astype(float), found.camera_from_world)


def _good(agreeing: NDArray[np.bool_], xyz: Array, pose: Pose) -> NDArray[np.bool_]:
    return plausible(agreeing, xyz[:, 2], pose.apply(xyz)[:, 2])


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
