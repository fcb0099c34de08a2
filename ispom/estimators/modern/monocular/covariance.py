"""Uncertainty of the monocular estimator: of its key frames, of frames located in the map, and of its unit.

All to first order, by how the cost of the window curves and how far its gradient scatters (`scatter`), in the gauge
that the map holds: the pose of its first frame is the world, the distance to the last frame of its start the unit.

A frame that is located in the map is one more view of the same tracks. What is wrong with a track there mostly was so
in the last key frame, too, and has moved the map the same way: so each track says all that it has to say, by way of the
map and in the frame, before its square is taken. By the two apart, poses ahead of a young map were taken for sure by a
quarter too much.
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
    """The uncertainty of a map, as long as it stays as it is."""

    key_times_ns: tuple[int, ...]
    """Of its C key frames."""
    ids: NDArray[np.int64]
    """(M,) ascending, of the points that the last key frame sees."""
    by_poses: Array
    """(M, 3, D) how each point moves with poses and camera."""
    spread: Spread
    """Of these; `pulls` (M, D) are those of the tracks of the points."""
    pose: Array
    """(6, 6) covariance of the last key frame's pose, twist on the right of world_from_camera."""
    scale_sigma: float
    """Deviation of the logarithm of the last step's length, between key frames, in the unit that the map holds."""
    step_scale_sigma: float
    """The same against the step before; `scale_sigma` where there is none."""
    depth_sigma: float
    """Median deviation of the logarithm of the depth of the points that the last key frame sees, in the unit that the
    map holds, but for what each point is off by itself; infinite where it sees none."""

    @staticmethod
    def of(
        window: Window, key_times_ns: tuple[int, ...], ids: NDArray[np.int64], sigma: float, shared: float
    ) -> MapUncertainty:
        """Of a window with points `ids` (M,); `sigma`: width of the loss, normalised."""
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
        """(2, 2) covariance of the camera's correction."""
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
        """(6, 6) covariance of a pose located by points (N,), at (N, 3), seen at (N, 2); twist on the right.

        `scale`: width of the loss by which it was located, normalised; `untriangulated`: the tracks without a point
        that had their part in it. That of the last key frame, which it is no less, where none of the points was seen
        there.
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
        # Six of the errors' degrees of freedom went into the pose.
        slopes /= np.sqrt(max(1 - POSE / (n + len(slopes)), LEAST_SHARE))
        both, of_map = slopes.T @ pulls @ follow.T, follow @ self.spread.root
        return own @ (of_map @ of_map.T + self.spread.wider * (slopes.T @ slopes + both + both.T)) @ own


def _of_depths(window: Window, xyz: Array, by_poses: Array, root: Array) -> float:
    """Median deviation of the logarithm of the depth of points (M, 3) in the last camera, which move with poses and
    corrections by `by_poses` (M, 3, D)."""
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
    """Of the second derivatives held - bent; a direction keeps at least LEAST_SHARE of `held`, which has no negative
    eigenvalues, and none where that is 0."""
    values, vectors = np.linalg.eigh(held)
    known = values > 1e-15 * values[-1]
    root = vectors[:, known] / np.sqrt(values[known])
    share, turn = np.linalg.eigh(np.eye(root.shape[1]) - root.T @ bent @ root)
    found = root @ turn
    return found / np.maximum(share, LEAST_SHARE) @ found.T


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
