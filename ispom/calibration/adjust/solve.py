"""Adjustment of the joint problem: initial values, robust solution, rejection of outliers, covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import Model, as_model
from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns, board_problem
from ispom.geometry import Array, Pose
from ispom.solvers.least_squares import NormalEquations, adjust, normal_equations, quadratic
from ispom.solvers.least_squares import huber as huber_loss
from ispom.types import Camera

FOCALS = np.geomspace(0.25, 6.0, 20)
"""Focal lengths that are tried, as shares of the image's longer side."""
TRIED_VIEWS = 12
HUBER_SIGMAS = 20.0


def start_of(seen: Observations, size: tuple[int, int], model: Model) -> Estimate:
    """Returns initial values of one camera with an image (width, height), slightly refined, and the views' poses.

    `seen` has this camera only, its views numbered without gaps.
    """
    views = int(seen.view.max()) + 1
    some = np.unique(np.linspace(0, views - 1, min(views, TRIED_VIEWS)).astype(int))
    few = seen.of_views(some)
    best = min((_candidate(few, size, model, float(f)) for f in FOCALS), key=lambda found: found[0])[1]
    simple: Model = "fisheye" if model == "fisheye" else "pinhole"
    for each in dict.fromkeys((simple, "radtan" if simple == "pinhole" else simple, model)):
        if simple == "pinhole" and model == "pinhole" and each != "pinhole":
            continue
        camera = as_model(best.cameras[0], each)
        free = np.arange(4 + len(camera.distortion)) if each != "pinhole" or model == "pinhole" else np.array([0, 1])
        start = replace(best, cameras=(camera,))
        best = adjust_views(start, few, Unknowns((free,), (False,)), HUBER_SIGMAS, iterations=25)
    return with_views(best.cameras[0], seen)


def with_views(camera: Camera, seen: Observations) -> Estimate:
    """Returns the camera, with the pose of each view of one camera's observations."""
    return Estimate.of((camera,), (Pose(),), board_poses(camera, seen))


def board_poses(camera: Camera, seen: Observations) -> list[Pose]:
    """camera_from_board of each view (0 to the last; identity 1 m ahead where a view has too few points)."""
    return [_pose(camera, seen.select(seen.view == v))[0] for v in range(int(seen.view.max()) + 1)]


def _candidate(seen: Observations, size: tuple[int, int], model: Model, share: float) -> tuple[float, Estimate]:
    """Returns the median error [px], and a camera of this focal length with the poses that fit it best."""
    focal = share * max(size)
    camera = as_model(Camera(*size, focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2), model)
    found = [_pose(camera, seen.select(seen.view == v)) for v in range(int(seen.view.max()) + 1)]
    error = float(np.median([away for _, away in found]))
    return error, Estimate.of((camera,), (Pose(),), [pose for pose, _ in found])


def _pose(camera: Camera, seen: Observations) -> tuple[Pose, float]:
    """camera_from_board of one view, and its error [px]: of the two poses that a plane allows, the better one."""
    nowhere = Pose(translation=np.array([0, 0, 1.0]))
    rays = camera.normalise(seen.uv)
    good = np.isfinite(rays).all(1) & (np.abs(rays) < 20).all(1)
    if good.sum() < 4:
        return nowhere, np.inf
    board, rays = np.ascontiguousarray(seen.xyz_in_board[good]), np.ascontiguousarray(rays[good])
    centre = board.mean(0)
    found, turns, moves, _ = cv2.solvePnPGeneric(
        (board - centre)[:, None], rays[:, None], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    poses = (
        [
            Pose.from_rotvec(np.asarray(r, float), np.asarray(t, float)) @ Pose(translation=-centre)
            for r, t in zip(turns, moves, strict=True)
        ]
        if found
        else []
    )
    errors = [_error_px(camera, pose, seen) for pose in poses]
    if not errors or not np.isfinite(min(errors)):
        return nowhere, np.inf
    best = int(np.argmin(errors))
    return poses[best], errors[best]


def _error_px(camera: Camera, camera_from_board: Pose, seen: Observations) -> float:
    away: Array = camera.project(camera_from_board.apply(seen.xyz_in_board)) - seen.uv
    distances = np.linalg.norm(away, axis=1)
    return float(np.sqrt((distances**2).mean())) if np.isfinite(distances).all() else np.inf


HUBER = 2.0
"""Residuals beyond this many sigmas have linear cost while outliers are searched."""
OUTLIER = 5.0
"""A point farther off than this, in sigmas of all, is rejected,"""
WORST_VIEW = 3.0
"""and a view whose residuals exceed this multiple of the median view's."""
LEAST_PX = 0.05
"""Residuals below are never outliers: they are finer than any detector."""
ROUNDS = 6
ITERATIONS = 60
TOLERANCE, ROUGH_TOLERANCE = 1e-9, 1e-4
"""Tolerances of the cost, in the end and while outliers are searched."""
LEAST_IN_VIEW = 6
"""Points that keep a view."""


@dataclass(frozen=True, eq=False)
class Solution:
    """An adjusted estimate."""

    estimate: Estimate
    seen: Observations
    """The inliers to which it is adjusted."""
    unknowns: Unknowns
    residuals_px: Array
    """(M, 2) predicted minus observed."""
    unit_sigma: float
    """Ratio of the residuals to their sigmas."""
    covariance: Array
    """(G, G) of the shared parameters, in the order of `unknowns.slices`; scaled by `unit_sigma`. Infinite on the
    diagonal where a parameter is not determined."""
    equations: NormalEquations

    @property
    def rms_px(self) -> float:
        """Root mean square distance of predicted from observed points, as OpenCV's calibrateCamera returns it."""
        return float(np.sqrt((self.residuals_px**2).sum(1).mean()))

    def view_uncertainties(self) -> tuple[Array, Array]:
        """Returns each view's covariance (V, 6, 6) for given shared parameters, and its derivative (V, 6, G) by
        these.

        Both are of the left twist of rig_from_board: [m], [rad].
        """
        inverse = self.equations.eliminated(0.0).inverse
        return self.unit_sigma**2 * inverse, -inverse @ self.equations.mixed


def adjust_views(
    start: Estimate,
    seen: Observations,
    unknowns: Unknowns,
    huber: float | None = None,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Estimate:
    """Returns the estimate of least cost; with `huber` (in sigmas of the observations) large residuals have linear
    cost."""
    loss = quadratic if huber is None else huber_loss(huber)
    return adjust(board_problem(seen, unknowns, start.views, loss), start, iterations, tolerance).values


def solve(start: Estimate, seen: Observations, unknowns: Unknowns) -> tuple[Solution, NDArray[np.bool_]]:
    """Returns the solution, and (M,) which observations it is of: the others do not fit and are rejected."""
    keep = np.ones(len(seen), bool)
    estimate = start
    for _ in range(ROUNDS):
        part = seen.select(keep)
        scale = _scale(estimate.residuals_px(part), part.sigma_px)
        estimate = adjust_views(estimate, part, unknowns, HUBER * scale, tolerance=ROUGH_TOLERANCE)
        fits = _fitting(estimate.residuals_px(seen), seen)
        if (fits == keep).all():
            break
        keep = fits
    part = seen.select(keep)
    return solution(adjust_views(estimate, part, unknowns), part, unknowns), keep


def solution(estimate: Estimate, seen: Observations, unknowns: Unknowns) -> Solution:
    """Returns the estimate with its covariance, at the least cost."""
    residuals = estimate.residuals_px(seen)
    views = len(np.unique(seen.view))
    freedom = 2 * len(seen) - unknowns.count - 6 * views
    chi2 = float(((residuals / seen.sigma_px[:, None]) ** 2).sum())
    unit = float(np.sqrt(chi2 / max(freedom, 1)))
    equations = normal_equations(board_problem(seen, unknowns, estimate.views), estimate)
    return Solution(
        estimate=estimate,
        seen=seen,
        unknowns=unknowns,
        residuals_px=residuals,
        unit_sigma=unit,
        covariance=unit**2 * _inverse(equations),
        equations=equations,
    )


def _inverse(equations: NormalEquations) -> Array:
    """Inverts the reduced matrix; infinite on the diagonal where a parameter is part of an undetermined direction."""
    matrix = equations.eliminated(0.0).matrix
    if not len(matrix):
        return matrix
    scale = 1 / np.sqrt(np.maximum(np.diag(equations.shared), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    weak = values < 1e-13 * max(float(values[-1]), 1e-300)
    inverse = (vectors[:, ~weak] / values[~weak]) @ vectors[:, ~weak].T * np.outer(scale, scale)
    lost = (np.abs(vectors[:, weak]) > 1e-3).any(axis=1)
    inverse[lost, lost] = np.inf
    return inverse


def _scale(residuals_px: Array, sigma_px: Array) -> float:
    """Standard deviation of residuals in sigmas, by their median (of a Rayleigh distribution)."""
    away = np.nan_to_num(np.linalg.norm(residuals_px, axis=1), nan=np.inf) / sigma_px
    middle = float(np.median(away)) / 1.1774
    return middle if np.isfinite(middle) and middle > 0 else 1.0


def _fitting(residuals_px: Array, seen: Observations) -> NDArray[np.bool_]:
    """Returns which observations (M,) are inliers, in views that are."""
    away = np.nan_to_num(np.linalg.norm(residuals_px, axis=1), nan=np.inf)
    size = away / seen.sigma_px
    group = seen.view * (int(seen.camera.max()) + 1) + seen.camera
    groups, index = np.unique(group, return_inverse=True)
    middles = np.array([np.median(size[index == g]) for g in range(len(groups))])
    good_views = (middles <= WORST_VIEW * np.median(middles)) | (
        np.array([np.median(away[index == g]) for g in range(len(groups))]) < LEAST_PX
    )
    keep = good_views[index]
    scale = _scale(residuals_px[keep], seen.sigma_px[keep]) if keep.any() else 1.0
    keep &= (size <= OUTLIER * scale) | (away < LEAST_PX)
    enough = np.bincount(index[keep], minlength=len(groups)) >= LEAST_IN_VIEW
    return keep & enough[index]
