"""Covariances of the monocular estimator: of its keyframes, of frames localised in the map, and of its scale.

All are first order, from the curvature of the window's cost and the scatter of its gradient (`scatter`), in the gauge
of the map: the pose of its first frame is the world, the distance to the last frame of its initialisation the unit.

A frame localised in the map is one more view of the same tracks. The error of a track is mostly the same as in the last
keyframe, and has already moved the map. So both contributions of a track are added before they are squared. As
independent ones they overestimated the precision of poses ahead of a young map by a quarter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.scatter import LEAST_SHARE, Curvature, Spread
from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import cauchy_weights
from ispom.solvers.localisation import PoseFit
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import LENS, POSE


@dataclass(frozen=True, eq=False)
class MapUncertainty:
    """Uncertainty of a map until it changes."""

    key_times_ns: tuple[int, ...]
    """Times of its C keyframes."""
    ids: NDArray[np.int64]
    """(M,) ids, ascending, of the points that the last keyframe observes."""
    by_poses: Array
    """(M, 3, D) Jacobian of each of these points with respect to poses and lens corrections."""
    spread: Spread
    """Covariance of these parameters; its `pulls` (M, D) are those of the points' tracks."""
    pose: Array
    """(6, 6) covariance of the last keyframe's pose, right twist of world_from_camera."""
    scale_sigma: float
    """Standard deviation of ln of the last step's length, between keyframes, in the gauge of the map."""
    step_scale_sigma: float
    """The same for the ratio to the step before; `scale_sigma` if there is none."""
    depth_sigma: float
    """Median standard deviation of ln depth of the points that the last keyframe observes, in the gauge of the map,
    without the points' own errors; infinite if there are none."""

    @staticmethod
    def of(
        window: Window, key_times_ns: tuple[int, ...], ids: NDArray[np.int64], sigma: float, shared: float
    ) -> MapUncertainty:
        """Computes the uncertainty of a window with points `ids` (M,); `sigma`: width of the loss, normalised."""
        c, young = len(window.rotations), np.zeros(len(ids), bool)
        young[window.owners[window.cameras == c - 1]] = True
        curved = Curvature.of(window, sigma)
        spread = curved.spread(sigma, shared)
        all_poses = spread.root @ spread.root.T
        last = slice(POSE * (c - 1), POSE * c)
        by_poses = -(curved.found.conditional[young] @ curved.found.mixed[young])
        return MapUncertainty(
            key_times_ns,
            ids[young],
            by_poses,
            replace(spread, pulls=spread.pulls[young]),
            all_poses[last, last],
            *_of_steps(window, all_poses),
            _of_depths(window, window.points[young], by_poses, spread.root),
        )

    @property
    def lens(self) -> Array:
        """(2, 2) covariance of the lens corrections."""
        root = self.spread.root[-LENS:]
        return root @ root.T

    def of_pose(
        self,
        ids: NDArray[np.int64],
        xyz: Array,
        seen: Array,
        motion: PoseFit,
        scale: float,
        untriangulated: UntriangulatedTracks | None = None,
    ) -> Array:
        """Returns the covariance (6, 6), right twist, of a pose from points (N,), at (N, 3), observed at (N, 2).

        `scale`: width of the loss used for the pose, normalised; `untriangulated`: the tracks without a point that were
        also used. Returns the covariance of the last keyframe if that observes none of the points.
        """
        place = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        use, pose = motion.inliers & (self.ids[place] == ids), motion.camera_from_world
        if not use.any():
            return self.pose
        place, in_camera, n = place[use], pose.apply(xyz[use]), int(use.sum())
        by_place, by_pose, by_extra = _derivatives(in_camera)
        errors = in_camera[:, :2] / in_camera[:, 2:] - seen[use]
        weighted = by_pose * cauchy_weights((errors**2).sum(axis=1), scale)[:, None, None]
        design, slopes = weighted.reshape(2 * n, POSE), (errors[:, None] @ weighted)[:, 0]
        gain = np.swapaxes(weighted, 1, 2) @ (by_place @ pose.rotation)
        follow = gain.transpose(1, 0, 2).reshape(POSE, 3 * n) @ self.by_poses[place].reshape(3 * n, -1)
        follow[:, -LENS:] += design.T @ by_extra.reshape(2 * n, LENS)
        held, pulls = by_pose.reshape(2 * n, POSE).T @ design, self.spread.pulls[place]
        if untriangulated is not None:
            curved, more = untriangulated.slopes(pose, scale)
            held, slopes = held + curved, np.concatenate([slopes, more])
            pulls = np.concatenate([pulls, np.zeros((len(more), pulls.shape[1]))])
            if untriangulated.key_ns in self.key_times_ns:
                at = POSE * self.key_times_ns.index(untriangulated.key_ns)
                follow[:, at : at + POSE] -= curved @ (pose @ untriangulated.world_from_key).adjoint
        own = _inverse(held, 2 / scale**2 * slopes.T @ slopes)
        # Six degrees of freedom of the errors were used by the pose.
        slopes /= np.sqrt(max(1 - POSE / (n + len(slopes)), LEAST_SHARE))
        both, of_map = slopes.T @ pulls @ follow.T, follow @ self.spread.root
        return own @ (of_map @ of_map.T + self.spread.wider * (slopes.T @ slopes + both + both.T)) @ own


def _of_depths(window: Window, xyz: Array, by_poses: Array, root: Array) -> float:
    """Returns the median standard deviation of ln depth of points (M, 3) in the last camera; `by_poses` (M, 3, D) is
    their Jacobian with respect to poses and corrections."""
    rotation, last = window.rotations[-1], POSE * (len(window.rotations) - 1)
    near = xyz @ rotation.T + window.translations[-1]
    rows = np.einsum("k,mkd->md", rotation[2], by_poses)
    # A left twist of the camera's pose moves the point by rho + phi x near.
    rows[:, last + 2] += 1
    rows[:, last + 3] += near[:, 1]
    rows[:, last + 4] -= near[:, 0]
    front = near[:, 2] > 0
    sigmas = np.linalg.norm(rows[front] / near[front, 2:] @ root, axis=1)
    return float(np.median(sigmas)) if len(sigmas) else np.inf


def _inverse(held: Array, bent: Array) -> Array:
    """Inverts the second derivatives held - bent; each direction keeps at least LEAST_SHARE of `held`, which is
    positive semidefinite, and null directions of `held` get 0."""
    values, vectors = np.linalg.eigh(held)
    known = values > 1e-15 * values[-1]
    root = vectors[:, known] / np.sqrt(values[known])
    share, turn = np.linalg.eigh(np.eye(root.shape[1]) - root.T @ bent @ root)
    found = root @ turn
    return found / np.maximum(share, LEAST_SHARE) @ found.T


def _derivatives(in_camera: Array) -> tuple[Array, Array, Array]:
    """Returns the Jacobians of the normalised coordinates of points (N, 3): with respect to position (N, 2, 3), left
    twist of camera_from_world (N, 2, 6), and lens corrections (N, 2, 2)."""
    uv, by_place, by_twist = reprojected(in_camera)
    return by_place, by_twist, np.stack([uv, uv * (uv**2).sum(axis=1, keepdims=True)], axis=2)


def _of_steps(window: Window, all_poses: Array) -> tuple[float, float]:
    """Returns the standard deviations of ln of the last step's length: of itself, and of its ratio to the step
    before."""
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
