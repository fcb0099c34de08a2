"""The video camera's pose on the rig and its clock from the motions of video and stereo pair, each by its own
images.

Hand-eye calibration (Park & Martin 1994), with an unknown clock offset and an unknown, slowly drifting scale of the
video's trajectory. The motions from one stereo pose to the next are compared, A X = X B: neither world matters, and
drift of either camera only within these motions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from ispom.calibration.motion.course import Course, Start
from ispom.geometry import Array, Pose, skew, so3_log

SIZE = 7
"""Number of unknowns: left twist of video_from_left (rho [m], phi [rad]), and the clock offset [s]."""
SCALE_S = 2.0
"""Interval of the values of the video's scale [s]; linear between them."""
WIDE = np.array([10.0] * 3 + [3.0] * 3 + [10.0])
"""Prior standard deviations [m, rad, s]: without information in the motion the result is as vague as this."""
RATIOS = np.array([0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0])
"""Ratios that are tried of the variance of a random-walk step to that of a single pose."""
PLAUSIBLE = 2.7
"""Twice the log-likelihood may be less than its maximum by this: independent errors would overrate a steady motion
(one-sided, 95 %)."""
ROUNDS, ITERATIONS = 5, 12
OUTLIER = 4.5
"""A motion farther off than this, in sigmas of all, is rejected."""
LEAST_MOTIONS = 10
CONVERGED = 1e-9


@dataclass(frozen=True, eq=False)
class HandEye:
    """The result of the motions."""

    video_from_left: Pose
    offset_s: float
    """The video's time stamps are to be increased by it."""
    covariance: Array
    """(7, 7) of the left twist of video_from_left [m, rad] and the offset [s]."""
    scale: float
    """Metres per unit of the video's trajectory, at the median."""
    used: NDArray[np.int64]
    """(U,) which motions were used: i is that from stereo pose i to the next."""
    residuals: Array
    """(U, 6) residual twists [m, rad], in the left camera."""
    turned_rad: Array
    """(3,) root mean square of the rotations from one stereo pose to the next, about the axes of the least, middle
    and largest ones, and"""
    axes: Array
    """(3, 3) these axes as rows, in the left camera."""


def hand_eye(left: Course, video: Course, joined: NDArray[np.bool_], start: Start) -> HandEye | None:
    """Calibrates by world_from_left [m] and world_from_video [own unit].

    `joined` (N - 1,) is False where either trajectory restarted between two stereo poses. None where fewer than
    LEAST_MOTIONS motions can be compared.
    """
    pose, offset_s = Pose(start.left_from_video.T), start.offset_s
    scales: Array | None = None
    keep = joined.copy()
    noise = (_Noise(1e-3, 0.0), _Noise(1e-2, 0.0))
    problem = _problem(left, video, keep, pose, offset_s, scales)
    for round_number in range(ROUNDS):
        for _ in range(ITERATIONS):
            problem = _problem(left, video, keep, pose, offset_s, scales)
            if len(problem.index) < LEAST_MOTIONS:
                return None
            step = problem.step(noise)
            pose, offset_s = Pose.exp(step[:6]) @ pose, offset_s + float(step[6])
            scales = problem.scales * np.exp(step[SIZE:])
            if float(step @ step) < CONVERGED**2:
                break
        problem = _problem(left, video, keep, pose, offset_s, scales)
        fits = keep.copy()
        fits[problem.index] = problem.fitting()
        noise = problem.noises()
        if round_number > 1 and (fits == keep).all():
            break
        keep = fits
    return problem.result(pose, offset_s, noise, left)


@dataclass(frozen=True)
class _Noise:
    """Noise of motions between poses: each pose has an error of its own, and each step adds a lasting one."""

    sigma: float
    """Standard deviation of a pose."""
    ratio: float
    """Variance of what a step adds, over that of a pose."""

    def root(self, index: NDArray[np.int64]) -> Array:
        """(U, U) lower triangle L with L L^T the covariance of motions; neighbours share a pose."""
        return self.sigma * _correlated(index, self.ratio)


def _correlated(index: NDArray[np.int64], ratio: float) -> Array:
    matrix = (2.0 + ratio) * np.eye(len(index))
    beside = np.flatnonzero(np.diff(index) == 1)
    matrix[beside, beside + 1] = matrix[beside + 1, beside] = -1.0
    return np.asarray(cholesky(matrix, lower=True))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Linear about the values at hand."""

    index: NDArray[np.int64]
    """(U,) of the motions."""
    residuals: Array
    """(U, 6)."""
    jacobian: Array
    """(U, 6, 7 + K)."""
    scales: Array
    """(K,)."""

    def step(self, noise: tuple[_Noise, _Noise]) -> Array:
        return -self._solved(noise)[0]

    def _solved(self, noise: tuple[_Noise, _Noise]) -> tuple[Array, Array]:
        """(7 + K,) minus the step, and the covariance."""
        a, b = self._whitened(noise)
        information = a.T @ a
        information[np.diag_indices(SIZE)] += WIDE**-2
        scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        covariance = np.linalg.pinv(information * np.outer(scale, scale), rcond=1e-14, hermitian=True)
        covariance = covariance * np.outer(scale, scale)
        return covariance @ (a.T @ b), covariance

    def _whitened(self, noise: tuple[_Noise, _Noise]) -> tuple[Array, Array]:
        """Jacobian (6 U, 7 + K) and residuals (6 U,) in independent standard deviations."""
        rows, sides = [], []
        for part, each in zip((slice(0, 3), slice(3, 6)), noise, strict=True):
            root = each.root(self.index)
            jacobian, residuals = self.jacobian[:, part], self.residuals[:, part]
            rows.append(_applied(root, jacobian.reshape(len(self.index), -1)).reshape(-1, self.jacobian.shape[2]))
            sides.append(_applied(root, residuals).ravel())
        return np.concatenate(rows), np.concatenate(sides)

    def noises(self) -> tuple[_Noise, _Noise]:
        """Returns the noise of positions and of rotations: of the plausible ones, that whose errors accumulate most."""
        return self._noise(slice(0, 3)), self._noise(slice(3, 6))

    def _noise(self, part: slice) -> _Noise:
        """Estimates the noise by restricted likelihood, which accounts for the unknowns."""
        count = len(self.index)
        columns = self.jacobian[:, part].reshape(3 * count, -1)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        u, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        space = u[:, sizes > 1e-6 * sizes[0]]
        both = np.column_stack([space, self.residuals[:, part].ravel()]).reshape(count, -1)
        freedom = max(3 * count - space.shape[1], 1)
        tried: list[tuple[float, _Noise]] = []
        for ratio in RATIOS:
            root = _correlated(self.index, float(ratio))
            triangle = np.linalg.qr(_applied(root, both).reshape(3 * count, -1), mode="r")
            size = np.maximum(np.abs(np.diag(triangle)), 1e-150)
            sigma2 = max(float(size[-1] ** 2) / freedom, 1e-24)
            cost = (
                freedom * np.log(sigma2) + 6 * float(np.log(np.diag(root)).sum()) + 2 * float(np.log(size[:-1]).sum())
            )
            tried.append((cost, _Noise(float(np.sqrt(sigma2)), float(ratio))))
        least = min(cost for cost, _ in tried)
        return [each for cost, each in tried if cost <= least + PLAUSIBLE][-1]

    def fitting(self) -> NDArray[np.bool_]:
        """Returns which motions (U,) are inliers, in translation and in rotation."""
        good = np.ones(len(self.index), bool)
        for part in (slice(0, 3), slice(3, 6)):
            size = np.linalg.norm(self.residuals[:, part], axis=1)
            good &= size <= OUTLIER * max(float(np.median(size)) / 1.538, 1e-12)  # of a Maxwell distribution
        return good

    def result(self, pose: Pose, offset_s: float, noise: tuple[_Noise, _Noise], left: Course) -> HandEye:
        _, covariance = self._solved(noise)
        turns = so3_log(np.swapaxes(left.rotations[self.index], 1, 2) @ left.rotations[self.index + 1])
        moments, axes = np.linalg.eigh(turns.T @ turns / len(turns))
        return HandEye(
            video_from_left=pose,
            offset_s=offset_s,
            covariance=covariance[:SIZE, :SIZE],
            scale=float(np.median(self.scales)),
            used=self.index,
            residuals=self.residuals,
            turned_rad=np.sqrt(np.maximum(moments, 0)),
            axes=axes.T,
        )


def _applied(root: Array, values: Array) -> Array:
    return np.asarray(solve_triangular(root, values, lower=True))


def _problem(
    left: Course, video: Course, keep: NDArray[np.bool_], pose: Pose, offset_s: float, given: Array | None
) -> _Problem:
    """Computes the residuals of motions: log(A^-1 X B X^-1), with X = left_from_video; in the left camera at its
    end."""
    seen = video.at(left.times_s - offset_s)
    index = np.flatnonzero(keep & seen.known[:-1] & seen.known[1:])
    here, there = index, index + 1
    inverse = np.swapaxes(seen.rotations, 1, 2)
    video_rotation = inverse[here] @ seen.rotations[there]
    displacement = (inverse[here] @ (seen.positions[there] - seen.positions[here])[..., None])[..., 0]
    own = np.swapaxes(left.rotations[here], 1, 2)
    left_rotation = own @ left.rotations[there]
    left_displacement = (own @ (left.positions[there] - left.positions[here])[..., None])[..., 0]
    basis = _basis(left.times_s[here], left.times_s)
    x = pose.inverse()
    scales = given if given is not None else _one_scale(left_displacement, displacement, basis.shape[1])
    displacement = (basis @ scales)[:, None] * displacement
    # X B X^-1
    rotation = x.rotation @ video_rotation @ x.rotation.T
    shift = displacement @ x.rotation.T + x.translation - (rotation @ x.translation)
    back = np.swapaxes(left_rotation, 1, 2)
    residual_rotation = so3_log(back @ rotation)
    residual_shift = (back @ (shift - left_displacement)[..., None])[..., 0]
    jacobian = np.zeros((len(index), 6, SIZE + basis.shape[1]))
    # A small left twist of video_from_left multiplies X by its inverse on the right: X exp(-d) B exp(d) X^-1.
    x_adjoint = x.adjoint
    after = _adjoints(video_rotation, displacement)  # of B^-1
    jacobian[:, :, :6] = x_adjoint @ (np.eye(6) - after)
    # A later offset takes the video at an earlier stamp, at both ends of the motion.
    rates = seen.rates.copy()
    rates[here, :3] *= (basis @ scales)[:, None]
    at_end = seen.rates[there].copy()
    at_end[:, :3] *= (basis @ scales)[:, None]
    jacobian[:, :, 6] = -(at_end - (after @ rates[here][..., None])[..., 0]) @ x_adjoint.T
    along = np.zeros((len(index), 6))
    along[:, :3] = (np.swapaxes(video_rotation, 1, 2) @ displacement[..., None])[..., 0]
    share = basis * scales / np.maximum(basis @ scales, 1e-12)[:, None]
    jacobian[:, :, SIZE:] = (along @ x_adjoint.T)[..., None] * share[:, None, :]
    return _Problem(index, np.concatenate([residual_shift, residual_rotation], axis=1), jacobian, scales)


def _one_scale(left_displacement: Array, displacement: Array, count: int) -> Array:
    """Returns the ratio of all lengths, K times."""
    own = float(np.linalg.norm(displacement, axis=1).sum())
    return np.full(count, float(np.linalg.norm(left_displacement, axis=1).sum()) / own if own > 0 else 1.0)


def _adjoints(video_rotation: Array, displacement: Array) -> Array:
    """(U, 6, 6) of the inverses of motions."""
    inverse = np.swapaxes(video_rotation, 1, 2)
    out = np.zeros((len(video_rotation), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = inverse
    out[:, :3, 3:] = skew(-(inverse @ displacement[..., None])[..., 0]) @ inverse
    return out


def _basis(at_s: Array, all_s: Array) -> Array:
    """(U, K) of a piecewise linear function over the times of all."""
    count = max(1, round((all_s[-1] - all_s[0]) / SCALE_S)) + 1 if len(all_s) > 1 else 1
    if count == 1:
        return np.ones((len(at_s), 1))
    place = (at_s - all_s[0]) / max(all_s[-1] - all_s[0], 1e-9) * (count - 1)
    low = np.clip(place.astype(int), 0, count - 2)
    out = np.zeros((len(at_s), count))
    out[np.arange(len(at_s)), low] = 1 - (place - low)
    out[np.arange(len(at_s)), low + 1] += place - low
    return out
