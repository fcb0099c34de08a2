"""Uncertainty of the monocular estimator: of its key frames, of frames located in the map, and of its unit.

All to first order, by how the cost of the window curves and how far its gradient scatters (`scatter`), in the gauge
that the map holds: the pose of its first frame is the world, the distance to the last frame of its start the unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.scatter import Curvature
from ispom.estimators.modern.noise import TrackNoise
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.solvers.motion_only import PoseFit
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import LENS, POSE

LOSS = 1.5
"""Width of the robust loss, in deviations of a tracked place."""


@dataclass(frozen=True, eq=False)
class MapUncertainty:
    """The uncertainty of a map, as long as it stays as it is."""

    ids: NDArray[np.int64]
    """(M,) ascending, of the points that the last key frame sees."""
    conditional: Array
    """(M, 3, 3) covariance of each point where poses and camera are given."""
    sensitivity: Array
    """(M, 3, D) how each point moves with D independent unit errors of poses and camera."""
    extra: Array
    """(2, D) how the camera's correction does."""
    pose: Array
    """(6, 6) covariance of the last key frame's pose, twist on the right of world_from_camera."""
    scale_sigma: float
    """Deviation of the logarithm of the last step's length, between key frames, in the unit that the map holds."""
    step_scale_sigma: float
    """The same against the step before; `scale_sigma` where there is none."""

    @staticmethod
    def of(window: Window, ids: NDArray[np.int64], sigma: float, noise: TrackNoise, setting: float) -> MapUncertainty:
        """Of a window with points `ids` (M,); `sigma`: width of the loss, `setting`: error of a track before any data;
        normalised."""
        c, young = len(window.rotations), np.zeros(len(ids), bool)
        young[window.owners[window.cameras == c - 1]] = True
        curved = Curvature.of(window, sigma)
        root = curved.spread(sigma, noise.shared)
        all_poses = root @ root.T
        conditional, mixed = curved.found.conditional[young], curved.found.mixed[young]
        sensitivity = -(conditional @ mixed).reshape(-1, mixed.shape[2]) @ root
        last = slice(POSE * (c - 1), POSE * c)
        return MapUncertainty(
            ids[young],
            conditional * noise.variance(setting) / sigma**2,
            sensitivity.reshape(mixed.shape),
            root[-LENS:],
            all_poses[last, last],
            *_of_steps(window, all_poses),
        )

    def of_pose(self, ids: NDArray[np.int64], xyz: Array, motion: PoseFit, noise: float) -> Array:
        """(6, 6) covariance of a pose located by points (N,), at (N, 3), with errors `noise`; twist on the right.

        That of the last key frame, which it is no less, where none of the points was seen there.
        """
        place = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        use = motion.inliers & (self.ids[place] == ids)
        if not use.any():
            return self.pose
        place, in_camera = place[use], motion.camera_from_world.apply(xyz[use])
        by_place, by_pose, by_extra = _derivatives(in_camera)
        n = len(place)
        design = by_pose.reshape(2 * n, POSE)
        own = _inverse(design.T @ design)
        gain = np.swapaxes(by_pose, 1, 2) @ (by_place @ motion.camera_from_world.rotation)
        shared = gain.transpose(1, 0, 2).reshape(POSE, 3 * n) @ self.sensitivity[place].reshape(3 * n, -1)
        shared += design.T @ by_extra.reshape(2 * n, LENS) @ self.extra
        alone = (gain @ self.conditional[place] @ np.swapaxes(gain, 1, 2)).sum(axis=0)
        return own * noise**2 + own @ (alone + shared @ shared.T) @ own


def _inverse(information: Array) -> Array:
    """Of a symmetric matrix that has no negative eigenvalues, but for directions in which it is 0."""
    values, vectors = np.linalg.eigh(information)
    known = values > 1e-15 * values[-1]
    return vectors[:, known] / values[known] @ vectors[:, known].T


def _derivatives(in_camera: Array) -> tuple[Array, Array, Array]:
    """Of normalised coordinates of points (N, 3): by their place (N, 2, 3), by a left twist of camera_from_world
    (N, 2, 6), by the camera's correction (N, 2, 2)."""
    uv, by_place, by_twist = reprojected(in_camera)
    return by_place, by_twist, np.stack([uv, uv * (uv**2).sum(axis=1, keepdims=True)], axis=2)


def _of_steps(window: Window, all_poses: Array) -> tuple[float, float]:
    """Deviations of the logarithm of the last step's length: by itself, and against the step before."""
    count = len(window.rotations)
    centres = -np.einsum("cji,cj->ci", window.rotations, window.translations)
    rows = []
    for i in range(max(1, count - 2), count):
        step = centres[i] - centres[i - 1]
        row = np.zeros(len(all_poses))
        for j, sign in ((i, 1.0), (i - 1, -1.0)):  # a left twist's rho moves the centre by -R' rho
            row[POSE * j : POSE * j + 3] = -sign * (window.rotations[j] @ step) / max(float(step @ step), 1e-24)
        rows.append(row)
    against = rows[-1] - rows[0] if len(rows) > 1 else rows[-1]
    unit, step = (float(np.sqrt(max(row @ all_poses @ row, 0.0))) for row in (rows[-1], against))
    return unit, step
