"""Finds candidate relative poses of two views: from the essential matrix, and from the homography of a plane."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.essential import inlier_distances, relative_pose


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Candidate relative poses of two views."""

    second_from_first: tuple[Pose, ...]
    """Candidate poses; their translations have length 1."""
    planar_share: float
    """Ratio of the inliers of homography and essential matrix: near 1 for a plane or a pure rotation."""
    essential: int = 0
    """Number of poses from the essential matrix, which come first; the others are from the homography."""


def hypotheses(x1: Array, x2: Array, threshold: float) -> Hypotheses:
    """Finds candidate poses from normalised coordinates (N, 2) in two views.

    Of the homography's four decompositions (Malis & Vargas 2007) those with most points in front of the plane are kept.
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
