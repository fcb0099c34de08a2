"""The rigid transformation R(i-1,i), T(i-1,i) between the clouds of two pairs (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.stereo.state import Cloud
from ispom.solvers.rigid import RigidMotion, rigid_motion
from ispom.types import Rig

FARTHER = (2, 4)
"""Times the depth limit, where too few points are nearer; beyond, one pixel of disparity is most of a point's depth."""
ENOUGH = 3
"""Times the least number of inliers: with fewer near points farther ones are taken as well."""


@dataclass(frozen=True, eq=False)
class CommonPoints:
    """The points that two clouds have in common, near enough to count; indices (K,) into each."""

    reference: NDArray[np.int64]
    cloud: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cloud)


def common_points(reference: Cloud | None, cloud: Cloud, limit_m: float, min_inliers: int) -> CommonPoints:
    """Up to the depth `limit_m` in both, or farther where those are too few."""
    if reference is None:
        return CommonPoints(np.zeros(0, np.int64), np.zeros(0, np.int64))
    _, old, new = np.intersect1d(reference.ids, cloud.ids, assume_unique=True, return_indices=True)
    depth = np.maximum(reference.xyz_in_left[old, 2], cloud.xyz_in_left[new, 2])
    near = depth <= limit_m
    for factor in FARTHER:
        if near.sum() < ENOUGH * min_inliers:
            near = depth <= factor * limit_m
    return CommonPoints(old[near], new[near])


def transformation(
    rig: Rig, reference: Cloud | None, cloud: Cloud, common: CommonPoints, inlier_disparity_px: float
) -> RigidMotion | None:
    """reference_left_from_left; a point fits within the depth error that a disparity error makes."""
    if reference is None:
        return None
    source, target = cloud.xyz_in_left[common.cloud], reference.xyz_in_left[common.reference]
    per_px = inlier_disparity_px / (rig.camera("left").fx * rig.baseline_m)
    lateral = 2 * inlier_disparity_px / rig.camera("left").fx
    tolerance = per_px * (source[:, 2] ** 2 + target[:, 2] ** 2) + lateral * target[:, 2]
    return rigid_motion(source, target, tolerance)
