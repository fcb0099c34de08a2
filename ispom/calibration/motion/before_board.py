"""The video camera's pose on the rig from views of one target that the cameras took at times of their own.

The board is the world of both. Each stereo pose is compared with the video's interpolated pose at that time, as one
least-squares problem: its noise follows from that of the corners and of the interiors, correlations included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.solve import Solution
from ispom.calibration.motion.course import Between, Course
from ispom.geometry import Array, Pose, so3_log

ITERATIONS = 12
ROUNDS = 4
OUTLIER = 5.0
"""A stereo pose farther off than this, in sigmas of all, is rejected."""
LEAST_POSES = 6
CONVERGED = 1e-8
SIZE = 7
"""Number of unknowns: left twist of video_from_left (rho [m], phi [rad]), and the clock offset [s]."""


@dataclass(frozen=True, eq=False)
class Placed:
    """The video camera on the rig."""

    video_from_left: Pose
    offset_s: float
    """The video's time stamps are to be increased by it."""
    covariance: Array
    """(7, 7) of the left twist of video_from_left [m, rad] and the offset [s]; includes that of the interiors."""
    with_shared: Array
    """(7, G) covariance with the parameters that the solution's views share."""
    used: NDArray[np.int64]
    """(U,) which of the stereo poses were used."""
    residuals: Array
    """(U, 6) residual twists [m, rad] of the stereo poses, in the left camera."""
    unit_sigma: float
    """Ratio of the residuals to the corners' noise."""


@dataclass(frozen=True, eq=False)
class Views:
    """The views of one camera or pair in a solution."""

    course: Course
    """board_from_camera."""
    covariances: Array
    """(V, 6, 6) of each pose for given interiors: left twist of camera_from_board, which is minus a right one of its
    inverse."""
    by_shared: Array
    """(V, 6, G) how it follows the parameters that all views share."""


def views_of(found: Solution, chosen: NDArray[np.int64], times_s: Array) -> Views:
    """Takes the chosen views (V,) of a solution, at increasing times (V,)."""
    own, by_shared = found.view_uncertainties()
    inverse = np.swapaxes(found.estimate.rotations[chosen], 1, 2)
    positions = -(inverse @ found.estimate.positions[chosen][..., None])[..., 0]
    return Views(Course(times_s, inverse, positions), own[chosen], by_shared[chosen])


def placed(left: Views, video: Views, shared: Array, start: Pose, offset_s: float) -> Placed | None:
    """Refines initial values of video_from_left and the offset; `shared` (G, G) is the covariance of what views
    share.

    None where fewer than LEAST_POSES stereo poses have video poses around them.
    """
    pose, keep = start, np.ones(len(left.course), bool)
    step = np.zeros(SIZE)
    for _ in range(ROUNDS):
        for _ in range(ITERATIONS):
            problem = _problem(left, video, shared, pose, offset_s, keep)
            if len(problem.index) < LEAST_POSES:
                return None
            step = problem.step()
            pose, offset_s = Pose.exp(step[:6]) @ pose, offset_s + float(step[6])
            if float(step @ step) < CONVERGED**2:
                break
        problem = _problem(left, video, shared, pose, offset_s, keep)
        fits = keep.copy()
        fits[problem.index] = problem.fitting()
        if (fits == keep).all() or fits.sum() < LEAST_POSES:
            break
        keep = fits
    return problem.result(pose, offset_s, shared)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Linear about the values at hand."""

    index: NDArray[np.int64]
    """(U,) of the stereo poses."""
    residuals: Array
    """(U, 6)."""
    jacobian: Array
    """(6 U, 7)."""
    noise: Array
    """(6 U, 6 U) covariance."""
    by_shared: Array
    """(6 U, G)."""

    def step(self) -> Array:
        return -self._gain()[0] @ self.residuals.ravel()

    def fitting(self) -> NDArray[np.bool_]:
        """(U,) which do not stand out."""
        blocks = self.noise.reshape(len(self.index), 6, len(self.index), 6)
        own = np.stack([blocks[k, :, k] for k in range(len(self.index))])
        size = np.sqrt(np.einsum("ui,ui->u", self.residuals, np.linalg.solve(own, self.residuals[..., None])[..., 0]))
        return size <= OUTLIER * max(float(np.median(size)), 1e-12)

    def result(self, pose: Pose, offset_s: float, shared: Array) -> Placed:
        gain, covariance = self._gain()
        flat = self.residuals.ravel()
        unit2 = float(flat @ np.linalg.solve(self.noise, flat)) / max(len(flat) - SIZE, 1)
        unit2 = max(unit2, 1.0)  # few poses that fit well by chance are no better than their corners
        across = -gain @ self.by_shared @ shared
        return Placed(pose, offset_s, unit2 * covariance, across, self.index, self.residuals, float(np.sqrt(unit2)))

    def _gain(self) -> tuple[Array, Array]:
        """(7, 6 U) of the least-squares estimate, and its covariance (7, 7)."""
        weighted = np.linalg.solve(self.noise, self.jacobian)
        scale = 1 / np.sqrt(np.maximum(np.einsum("ij,ij->j", weighted, self.jacobian), 1e-300))
        information = (weighted * scale).T @ (self.jacobian * scale)
        covariance = np.linalg.pinv(information, hermitian=True) * np.outer(scale, scale)
        return covariance @ weighted.T, covariance


def _problem(
    left: Views, video: Views, shared: Array, pose: Pose, offset_s: float, keep: NDArray[np.bool_]
) -> _Problem:
    seen = video.course.at(left.course.times_s - offset_s)
    index = np.flatnonzero(seen.known & keep)
    turn = pose.inverse().adjoint
    count = len(index)
    jacobian = np.concatenate([np.broadcast_to(turn, (count, 6, 6)), -(seen.rates[index] @ turn.T)[..., None]], axis=2)
    # A video pose's error counts by its weight in the poses between; that of a stereo pose as it is.
    spread = np.zeros((count, 6, len(video.course), 6))
    for k in range(seen.index.shape[1]):
        weight = seen.weights[index, k]
        spread[np.arange(count), :, seen.index[index, k]] -= weight[:, None, None] * turn
    spread = spread.reshape(6 * count, -1)
    of_video = _blocks_applied(spread, video.covariances) @ spread.T
    by_shared = left.by_shared[index].reshape(6 * count, -1) + spread @ video.by_shared.reshape(spread.shape[1], -1)
    noise = of_video + by_shared @ shared @ by_shared.T
    blocks = noise.reshape(count, 6, count, 6)
    for k, j in enumerate(index):
        blocks[k, :, k] += left.covariances[j]
    return _Problem(
        index, _residuals(left.course.select(index), seen, index, pose), jacobian.reshape(-1, SIZE), noise, by_shared
    )


def _blocks_applied(spread: Array, covariances: Array) -> Array:
    """spread (R, 6 V) @ blockdiag(covariances (V, 6, 6))."""
    rows = spread.reshape(len(spread), -1, 6)
    return np.einsum("rvi,vij->rvj", rows, covariances).reshape(len(spread), -1)


def _residuals(left: Course, seen: Between, index: NDArray[np.int64], pose: Pose) -> Array:
    """Returns right twists (U, 6) from the stereo poses to those that the video camera predicts."""
    rotations = seen.rotations[index] @ pose.rotation
    positions = seen.rotations[index] @ pose.translation + seen.positions[index]
    inverse = np.swapaxes(left.rotations, 1, 2)
    shift = (inverse @ (positions - left.positions)[..., None])[..., 0]
    return np.concatenate([shift, so3_log(inverse @ rotations)], axis=1)
