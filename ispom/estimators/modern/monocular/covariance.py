"""Covariances of the monocular estimator: of its keyframes, of frames localised in the map, and of its scale.

All are first order, from the sandwich covariance of the window (`solvers.window.covariance`), in the gauge of the map:
the pose of its first frame is the world, the distance to the last frame of its initialisation the unit.

A frame localised in the map is one more view of the same tracks. The error of a track is mostly the same as in the last
keyframe, and has already moved the map. So both contributions of a track are added before they are squared. As
independent ones they overestimated the precision of poses ahead of a young map by a quarter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.untriangulated import UntriangulatedTracks
from ispom.geometry import Array
from ispom.numerics.reprojection import reprojected
from ispom.numerics.robust import robust_weights
from ispom.solvers.localisation import PoseFit
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.covariance import WindowCovariance, inverse_curvature
from ispom.solvers.window.kernels import LEAST_SHARE
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
    covariance: Array
    """(D, D) covariance of these parameters."""
    by_tracks: Array
    """(M, D) change of these parameters by the errors of each point's track."""
    inflation: float
    """Factor of the squared scores of tracks, see WindowCovariance."""
    pose: Array
    """(6, 6) covariance of the last keyframe's pose, right twist of world_from_camera."""
    scale_sigma: float
    """Standard deviation of ln of the last step's length, between keyframes, in the gauge of the map."""
    step_scale_sigma: float
    """The same for the ratio to the step before; `scale_sigma` if there is none."""
    depth_sigma: float
    """Median standard deviation of ln depth of the points that the last keyframe observes, in the gauge of the map,
    without the points' own errors; infinite if there are none."""
    relative_depth_sigma: float
    """The same for ln of depth over the last step's length, which does not depend on the gauge."""

    @staticmethod
    def of(window: Window, key_times_ns: tuple[int, ...], ids: NDArray[np.int64], width: float) -> MapUncertainty:
        """Computes the uncertainty of a window with points `ids` (M,); `width` of the loss, normalised."""
        c, young = len(window.rotations), np.zeros(len(ids), bool)
        young[window.owners[window.cameras == c - 1]] = True
        found = WindowCovariance.of(window, ids, width)
        covariance, last = found.whole, slice(POSE * (c - 1), POSE * c)
        by_poses = found.point_jacobians(young)
        depths, last_step = _depth_rows(window, window.points[young], by_poses), _step_row(window, c - 1)
        return MapUncertainty(
            key_times_ns,
            ids[young],
            by_poses,
            covariance,
            -found.left_out[young] @ found.inverse,
            found.inflation,
            covariance[last, last],
            *_of_steps(window, covariance),
            _median_sigma(depths, covariance),
            _median_sigma(depths - last_step, covariance),
        )

    @property
    def lens(self) -> Array:
        """(2, 2) covariance of the lens corrections."""
        return self.covariance[-LENS:, -LENS:]

    def of_pose(
        self,
        ids: NDArray[np.int64],
        xyz: Array,
        seen: Array,
        fit: PoseFit,
        scale: float,
        untriangulated: UntriangulatedTracks | None = None,
    ) -> Array:
        """Returns the covariance (6, 6), right twist, of a pose from points (N,), at (N, 3), observed at (N, 2).

        `scale`: width of the loss used for the pose, normalised; `untriangulated`: the tracks without a point that were
        also used. Returns the covariance of the last keyframe if that observes none of the points.
        """
        index = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        use, pose = fit.inliers & (self.ids[index] == ids), fit.camera_from_world
        if not use.any():
            return self.pose
        index, in_camera, n = index[use], pose.apply(xyz[use]), int(use.sum())
        by_place, by_pose, by_extra = _derivatives(in_camera)
        errors = in_camera[:, :2] / in_camera[:, 2:] - seen[use]
        weighted = by_pose * robust_weights((errors**2).sum(axis=1), scale)[:, None, None]
        design, scores = weighted.reshape(2 * n, POSE), (errors[:, None] @ weighted)[:, 0]
        gain = np.swapaxes(weighted, 1, 2) @ (by_place @ pose.rotation)
        follow = gain.transpose(1, 0, 2).reshape(POSE, 3 * n) @ self.by_poses[index].reshape(3 * n, -1)
        follow[:, -LENS:] += design.T @ by_extra.reshape(2 * n, LENS)
        fixed, by_tracks = by_pose.reshape(2 * n, POSE).T @ design, self.by_tracks[index]
        if untriangulated is not None:
            more_fixed, more = untriangulated.scores(pose, scale)
            fixed, scores = fixed + more_fixed, np.concatenate([scores, more])
            by_tracks = np.concatenate([by_tracks, np.zeros((len(more), by_tracks.shape[1]))])
            if untriangulated.key_ns in self.key_times_ns:
                at = POSE * self.key_times_ns.index(untriangulated.key_ns)
                follow[:, at : at + POSE] -= more_fixed @ (pose @ untriangulated.world_from_key).adjoint
        inverse = inverse_curvature(fixed - 2 / scale**2 * scores.T @ scores, fixed)
        # Six degrees of freedom of the errors were used by the pose.
        scores /= np.sqrt(max(1 - POSE / (n + len(scores)), LEAST_SHARE))
        both, own = scores.T @ by_tracks @ follow.T, scores.T @ scores
        return inverse @ (follow @ self.covariance @ follow.T + self.inflation * (own + both + both.T)) @ inverse


def _depth_rows(window: Window, xyz: Array, by_poses: Array) -> Array:
    """Returns the derivatives (K, D) of ln depth of those of points (M, 3) that are in front of the last camera;
    `by_poses` (M, 3, D) is their Jacobian with respect to poses and corrections."""
    rotation, last = window.rotations[-1], POSE * (len(window.rotations) - 1)
    near = xyz @ rotation.T + window.translations[-1]
    rows = np.einsum("k,mkd->md", rotation[2], by_poses)
    # A left twist of the camera's pose moves the point by rho + phi x near.
    rows[:, last + 2] += 1
    rows[:, last + 3] += near[:, 1]
    rows[:, last + 4] -= near[:, 0]
    front = near[:, 2] > 0
    return rows[front] / near[front, 2:]


def _median_sigma(rows: Array, covariance: Array) -> float:
    """Returns the median standard deviation of quantities with these derivatives (K, D); infinite without any."""
    variances = ((rows @ covariance) * rows).sum(axis=1)
    return float(np.sqrt(np.median(np.maximum(variances, 0.0)))) if len(variances) else np.inf


def _derivatives(in_camera: Array) -> tuple[Array, Array, Array]:
    """Returns the Jacobians of the normalised coordinates of points (N, 3): with respect to position (N, 2, 3), left
    twist of camera_from_world (N, 2, 6), and lens corrections (N, 2, 2)."""
    uv, by_place, by_twist = reprojected(in_camera)
    return by_place, by_twist, np.stack([uv, uv * (uv**2).sum(axis=1, keepdims=True)], axis=2)


def _of_steps(window: Window, covariance: Array) -> tuple[float, float]:
    """Returns the standard deviations of ln of the last step's length: of itself, and of its ratio to the step
    before."""
    count = len(window.rotations)
    rows = [_step_row(window, i) for i in range(max(1, count - 2), count)]
    against = rows[-1] - rows[0] if len(rows) > 1 else rows[-1]
    scale, step = (float(np.sqrt(max(row @ covariance @ row, 0.0))) for row in (rows[-1], against))
    return scale, step


def _step_row(window: Window, i: int) -> Array:
    """Returns the derivative (D,) of ln of the length of the step to camera i from the one before."""
    rotations, translations = window.rotations[i - 1 : i + 1], window.translations[i - 1 : i + 1]
    before, after = -np.einsum("cji,cj->ci", rotations, translations)
    step, row = after - before, np.zeros(POSE * len(window.rotations) + LENS)
    for j, sign in ((i, 1.0), (i - 1, -1.0)):  # a left twist's rho moves the centre by -R' rho
        row[POSE * j : POSE * j + 3] = -sign * (window.rotations[j] @ step) / max(float(step @ step), 1e-24)
    return row
