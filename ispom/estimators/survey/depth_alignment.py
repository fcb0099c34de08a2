"""The pose of an image relative to a depth field whose inverse depths are free within their standard deviations: both
are found together (photometric bundle adjustment of one image with a prior for the depths; Engel, Koltun and Cremers,
Direct Sparse Odometry, 2016, with the depths eliminated).

An alignment that takes the depths as exact gives their errors to the pose, and the next depths, searched along the
lines of that pose, get them back: the field agrees with any slightly wrong pose that made it. What depths cannot
explain are displacements of the patches across their lines. Here these decide the rotation and the direction of the
translation, and displacements along the lines count only as far as the depths are known.

Each patch of the field is compared in a frame of two axes, along its line and across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.estimators.survey.depth_field import FAR, LEAST_PX, STEP_PX, DepthField, Lines, directions
from ispom.estimators.survey.photometric import FREEDOM, LEAST_SCALE, MIN_CORRELATION, correlations
from ispom.geometry import Array, Pose, skew
from ispom.numerics.reductions import median
from ispom.types import Camera, Check, Image

ITERATIONS = 6
"""Most iterations of Gauss-Newton; two to four are usual."""
CONVERGED_PX = 0.01
"""Displacement of the pixels (root mean square) by an iteration at which the iteration ends: a tenth of how exactly a
patch is placed, `LEAST_PX`."""
MEDIAN_SQUARE = 0.455
"""Median of the square of a standard normal variable."""
DAMPING = 1e-9
"""Added to the normalised information: keeps it invertible where the scale is not observed."""

LINES = Check(
    "line_error", "displacement of the patches across their lines", "requirement", "Located?", relation="<=",
    unit="px", topic="pose",
    passes="The pose fits the images: they place the patches {value:.2f} px off their lines (limit {threshold} px).",
    fails="Lost: the images place the patches {value:.2f} px off their lines (limit {threshold} px). The pose "
    "contradicts the images, or too few patches show it, and depths from it would be wrong.",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Joint:
    """A pose, found together with the inverse depths."""

    pose: Pose
    """image_from_key."""
    line_error_px: float
    """Root mean square of the displacements across the lines by which the patches would move if only these decided the
    rotation and the direction of the translation; inf where they do not decide them."""
    parallax_px: float
    """Median displacement of the patches by the translation."""

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the logarithm of the scale that depths from this pose get, relative to those of the
        field: images that contradict a pose by some pixels across the lines, where no depth can explain it, may
        do so as much along them, where depths take it up."""
        return self.line_error_px / max(self.parallax_px, self.line_error_px, 1e-9)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of N patches on their displacements along their epipolar lines and across them."""

    information: Array
    """(N, 2, 2) [1/px^2]; 0 where a patch does not look the same."""
    gradient: Array
    """(N, 2) information times displacement [1/px]."""
    speed: Array
    """(N,) derivative of the displacement along the line by the inverse depth [px per unit of it]."""
    by_twist: Array
    """(N, 2, 6) derivative of the displacement by a left twist of the pose."""

    @staticmethod
    def of(lines: Lines, inverse: Array) -> Evidence:
        """Compares the patches at inverse depths (N,)."""
        values, along, across = lines.slopes(inverse, lines.patches(inverse))
        residuals = lines.intensity - values
        similar = (correlations(lines.intensity, values) >= MIN_CORRELATION) & np.isfinite(along + across).all(axis=1)
        noise = np.maximum(LEAST_SCALE**2, (np.where(similar[:, None], residuals, 0.0) ** 2).mean(axis=1))
        slopes = np.where(similar[:, None, None], np.stack([along, across], axis=1), 0.0)
        information = slopes @ slopes.swapaxes(1, 2) / noise[:, None, None]
        gradient = (slopes * np.where(similar[:, None], residuals, 0.0)[:, None]).sum(axis=2) / noise[:, None]
        # The lens and interpolation are no more exact than LEAST_PX.
        limit = np.linalg.inv(np.eye(2) + LEAST_PX**2 * information)
        velocity = lines.velocity(inverse)
        axes = np.stack([directions(velocity), directions(velocity)[:, ::-1] * (-1.0, 1.0)], axis=1)
        return Evidence(
            limit @ information,
            (limit @ gradient[..., None])[..., 0],
            np.linalg.norm(velocity, axis=1),
            axes @ _by_twist(lines, inverse),
        )

    def eliminated(self, depth_information: Array, depth_gradient: Array) -> Eliminated:
        """Returns the evidence after each inverse depth is eliminated. `depth_information` (N,) and `depth_gradient`
        (N,) are their prior."""
        by_depth = self.information[:, :, 0] * self.speed[:, None]
        power = np.maximum(self.speed * by_depth[:, 0] + depth_information, 1e-30)
        pull = self.speed * self.gradient[:, 0] + depth_gradient
        return Eliminated(
            self.information - by_depth[:, :, None] * by_depth[:, None] / power[:, None, None],
            self.gradient - by_depth * (pull / power)[:, None],
            pull / power,
            np.einsum("ni,nij->nj", by_depth, self.by_twist) / power[:, None],
        )


@dataclass(frozen=True, eq=False)
class Eliminated:
    """Evidence without the inverse depths of N pixels."""

    information: Array
    """(N, 2, 2)."""
    gradient: Array
    """(N, 2)."""
    step: Array
    """(N,) steps of the inverse depths for a constant pose."""
    step_by_twist: Array
    """(N, 6) decrease of that step by a twist of the pose."""


def jointly_aligned(field: DepthField, camera: Camera, image: Image, image_from_key: Pose) -> Joint:
    """Returns the pose of an image near a pose, found together with the inverse depths of a field."""
    pose, inverse = image_from_key, field.inverse
    prior = field.sigma**-2
    for _ in range(ITERATIONS):
        lines = lines_of(field, camera, image, pose)
        evidence = Evidence.of(lines, inverse)
        left = evidence.eliminated(prior, prior * (field.inverse - inverse))
        information, gradient = _normal_equations(evidence, left, _weights(evidence, left))
        twist = _solved(information, gradient)
        pose = Pose.exp(twist) @ pose
        most = 2 * STEP_PX / np.maximum(evidence.speed, 1e-9)
        step = np.clip(left.step - left.step_by_twist @ twist, -most, most)
        inverse = np.maximum(inverse + step, FAR * field.typical)
        if _moved_px(evidence, twist) < CONVERGED_PX:
            break
    evidence = Evidence.of(lines_of(field, camera, image, pose), inverse)
    similar = evidence.information[:, 1, 1] > 0
    parallax_px = median((evidence.speed * inverse)[similar]) if similar.any() else 0.0
    return Joint(pose, _line_error_px(evidence), parallax_px)


def lines_of(field: DepthField, camera: Camera, image: Image, image_from_key: Pose) -> Lines:
    """Returns the lines of the pixels of a field in an image of full size."""
    return Lines.of(field, 0, field.grey, camera, image, image_from_key)


def _by_twist(lines: Lines, inverse: Array) -> Array:
    """Returns the displacements (N, 2, 6) [px] by a twist on the left of image_from_key."""
    scaled = lines.rays[:, 0] + inverse[:, None] * lines.step
    by_xyz = np.nan_to_num(lines.camera.project_jacobian(scaled))
    return np.concatenate([by_xyz * inverse[:, None, None], -by_xyz @ skew(scaled)], axis=2)


def _weights(evidence: Evidence, left: Eliminated) -> Array:
    """Returns the weights (N,) of a t-distribution of the displacements, whose scale is measured."""
    sharp = evidence.information[:, 1, 1] > 0
    across = left.gradient[:, 1] ** 2 / np.where(sharp, np.maximum(left.information[:, 1, 1], 1e-9), 1.0)
    width = max(1.0, median(across[sharp]) / MEDIAN_SQUARE) if sharp.any() else 1.0
    return (FREEDOM + 1) / (FREEDOM + across / width) / width


def _normal_equations(evidence: Evidence, left: Eliminated, weights: Array) -> tuple[Array, Array]:
    """Returns the information (6, 6) on the twist and the gradient (6,)."""
    weighted = weights[:, None, None] * evidence.by_twist
    information = np.einsum("nij,nik,nkl->jl", weighted, left.information, evidence.by_twist, optimize=True)
    return information, np.einsum("nij,ni->j", weighted, left.gradient)


def _solved(information: Array, gradient: Array) -> Array:
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    normalised = information * scale[:, None] * scale + DAMPING * np.eye(6)
    return scale * np.linalg.solve(normalised, scale * gradient)


def _moved_px(evidence: Evidence, twist: Array) -> float:
    """Returns by how much a twist displaces the patches that look the same [px], root mean square."""
    similar = evidence.information[:, 1, 1] > 0
    moved = evidence.by_twist[similar] @ twist
    return float(np.sqrt((moved**2).sum(axis=1).mean())) if similar.any() else 0.0


def _line_error_px(evidence: Evidence) -> float:
    """Returns the line error of a pose: see Joint."""
    free = np.zeros(len(evidence.speed))
    left = evidence.eliminated(free, free)
    weights = _weights(evidence, left)
    information, gradient = _normal_equations(evidence, left, weights)
    total = float((weights * left.information[:, 1, 1]).sum())
    twist = _solved(information, gradient)
    return float(np.sqrt(max(0.0, twist @ information @ twist) / total)) if total > 0 else np.inf
