"""Relative poses that two views allow: by the essential matrix, and by the homography of a plane."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.essential import inlier_distances, relative_pose


@dataclass(frozen=True, eq=False)
class Hypotheses:
    second_from_first: tuple[Pose, ...]
    """Of length 1."""
    planar_share: float
    """Inliers of the homography over those of the essential matrix: near 1 on a plane and on a pure rotation."""
    essential: int = 0
    """So many of the poses, the first ones, are the essential matrix's; the others are the homography's."""


def hypotheses(x1: Array, x2: Array, threshold: float) -> Hypotheses:
    """From normalised coordinates (N, 2) in two views.

    Of the homography's four decompositions (Malis & Vargas 2007) those stay that have most points before the plane.
    `threshold` is the inlier distance in normalised units. No pose with fewer than 8 points. Deterministic.
    """
    if len(x1) < 8:
        return Hypotheses((), 0.0)
    general = relative_pose(x1, x2, threshold)
    poses = [] if general is None else [general.second_from_first]
    essential = len(poses)
    scaled1, scaled2 = inlier_distances(x1, threshold), inlier_distances(x2, threshold)
    homography, mask = cv2.findHomography(scaled1, scaled2, cv2.USAC_MAGSAC, 1.0, maxIters=2000, confidence=0.999)
    if homography is None or mask is None:
        return Hypotheses(tuple(poses), 0.0, essential)
    planar = mask.ravel() > 0
    share = float(planar.sum() / max(1, 0 if general is None else general.inliers.sum()))
    if planar.sum() >= 8:
        scale = np.diag([threshold, threshold, 1.0])
        poses += _decomposed(scale @ np.asarray(homography, float) @ np.linalg.inv(scale), x1[planar])
    return Hypotheses(tuple(poses), min(share, 2.0), essential)


def _decomposed(homography: Array, x1: Array) -> list[Pose]:
    count, rotations, translations, normals = cv2.decomposeHomographyMat(homography, np.eye(3))
    rays = np.concatenate([x1, np.ones((len(x1), 1))], axis=1)
    found = []
    for i in range(count):
        t, normal = np.asarray(translations[i], float).ravel(), np.asarray(normals[i], float).ravel()
        length = np.linalg.norm(t)
        if length > 1e-6 and (rays @ normal > 0).mean() > 0.9:
            found.append(Pose(np.asarray(rotations[i], float), t / length))
    return found
