"""Keyframes, points and their one lens (focal length, principal point, k1, k2), and their bundle adjustment.

Points are homogeneous (Triggs et al. 2000, section 2.3), so that those at infinity, which separate rotations from the
focal length, are as good as any other. The loss is the robust one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.tracked import projection
from ispom.geometry import Array
from ispom.numerics.robust import robust_loss
from ispom.numerics.twist import moved
from ispom.solvers.least_squares import Derivatives, Family, Loss, Prior, Problem, adjust
from ispom.types import Camera

LENS, POSE = 5, 6
"""Unknowns of the lens: logarithm of the focal length, principal point [px], k1, k2; and of a pose."""


@dataclass(frozen=True, eq=False)
class LensPrior:
    """Prior of the lens."""

    mean: Array
    """(5,)."""
    sigma: Array
    """(5,) 0 fixes a value."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Where points were observed."""

    view: NDArray[np.int64]
    """(K,)."""
    point: NDArray[np.int64]
    """(K,)."""
    uv: Array
    """(K, 2) [px]."""

    def select(self, keep: NDArray) -> Observations:
        """Selects observations by a boolean mask or index array."""
        return Observations(self.view[keep], self.point[keep], self.uv[keep])


@dataclass(frozen=True, eq=False)
class Scene:
    """Values to be adjusted; views and points are numbered as the observations have them."""

    lens: Array
    """(5,) log f, cx, cy, k1, k2."""
    rotations: Array
    """(V, 3, 3) camera_from_world and"""
    translations: Array
    """(V, 3)."""
    points: Array
    """(M, 4) homogeneous, of length 1."""

    @property
    def camera(self) -> Camera:
        """The lens as a camera; the size of its images is not known here."""
        focal, cx, cy, k1, k2 = float(np.exp(self.lens[0])), *self.lens[1:].tolist()
        return Camera(1, 1, focal, focal, cx, cy, (k1, k2, 0.0, 0.0))

    def in_camera(self, seen: Observations) -> Array:
        """Returns points (K, 3) in their cameras, up to scale."""
        x = self.points[seen.point]
        rotated = (self.rotations[seen.view] @ x[:, :3, None])[..., 0]
        return rotated + x[:, 3:] * self.translations[seen.view]

    def residuals_px(self, seen: Observations) -> Array:
        """Returns predicted minus observed pixels (K, 2); NaN behind a camera."""
        at = self.lens, self.rotations, self.translations, self.points
        return projection.errors(*map(np.ascontiguousarray, (*at, seen.view, seen.point, seen.uv)))

    def errors_px(self, seen: Observations) -> Array:
        """Returns distances (K,) of predicted from observed pixels; large behind a camera."""
        return np.nan_to_num(np.linalg.norm(self.residuals_px(seen), axis=1), nan=1e9)


def scene_problem(scene: Scene, seen: Observations, prior: LensPrior, width_px: float | Array) -> Problem[Scene]:
    """Bundle adjustment of lens, points, and all poses but the first. `width_px`: of the loss, for all observations or
    (K,) for each."""
    free = Free(prior.sigma > 0, np.arange(len(scene.rotations)) > 0)
    lens = Prior[Scene](
        lambda values: (values.lens - prior.mean)[free.lens], prior.sigma[free.lens], np.arange(free.lens.sum())
    )
    points = ImagePoints(seen, free.columns(seen.view), np.broadcast_to(width_px, len(seen.uv)))
    return Problem((points, lens), free.moved, free.count, len(scene.points), 3)


def localisation(scene: Scene, seen: Observations, width_px: float) -> Problem[Scene]:
    """Adjustment of all poses; lens and points are known."""
    free = Free(np.zeros(LENS, bool), np.ones(len(scene.rotations), bool))
    points = ImagePoints(seen, free.columns(seen.view), np.full(len(seen.uv), width_px), points_known=True)
    return Problem((points,), free.moved, free.count)


@dataclass(frozen=True, eq=False)
class Free:
    """Which of the shared unknowns are free."""

    lens: NDArray[np.bool_]
    """(5,)."""
    views: NDArray[np.bool_]
    """(V,)."""

    @property
    def _all(self) -> NDArray[np.bool_]:
        return np.concatenate([self.lens, np.repeat(self.views, POSE)])

    @property
    def count(self) -> int:
        return int(self._all.sum())

    def columns(self, view: NDArray[np.int64]) -> NDArray[np.int64]:
        """(K, 11) of the lens and the pose of each observation's view."""
        number = np.where(self._all, np.cumsum(self._all) - 1, -1)
        lens = np.broadcast_to(number[:LENS], (len(view), LENS))
        return np.concatenate([lens, number[LENS:].reshape(-1, POSE)[view]], axis=1)

    def moved(self, values: Scene, shared: Array, blocks: Array) -> Scene:
        """Adds to the lens, moves poses by left twists, and points (M, 3), if any, along their unit sphere."""
        step = np.zeros(len(self._all))
        step[self._all] = shared
        points = values.points
        if len(blocks):
            normals = _normals(points)
            points = points - 2 * (normals[:, :3] * blocks).sum(1, keepdims=True) * normals
            points[:, :3] += blocks
            points /= np.linalg.norm(points, axis=1, keepdims=True)
        rotations, translations = moved(values.rotations, values.translations, step[LENS:].reshape(-1, POSE))
        return Scene(values.lens + step[:LENS], rotations, translations, points)


@dataclass(frozen=True, eq=False)
class ImagePoints(Family[Scene]):
    """Errors of points in the images [px]."""

    seen: Observations
    columns: NDArray[np.int64]
    """(K, 11) which of the shared unknowns the lens and the view's pose are."""
    widths: Array
    points_known: bool = False
    loss: Loss = robust_loss

    def residuals(self, values: Scene) -> Array:
        return values.residuals_px(self.seen)

    def derivatives(self, values: Scene) -> Derivatives:
        at = values.lens, values.rotations, values.translations, values.points, _normals(values.points)
        found = projection.slopes(*map(np.ascontiguousarray, (*at, self.seen.view, self.seen.point)))
        if self.points_known:
            return Derivatives.of_shared(found[0], self.columns)
        return Derivatives(found[0], self.columns, found[1], self.seen.point)


def adjust_scene(
    scene: Scene,
    seen: Observations,
    prior: LensPrior,
    width_px: float | Array,
    iterations: int,
    tolerance: float = 1e-4,
    curved: bool = False,
) -> tuple[Scene, float]:
    """Adjusts lens, views up to the last observed one, and the points observed at least twice.

    Returns the scene of least cost, and that cost. `curved` as in `least_squares.adjust`, until the lens has settled.
    """
    often = (np.bincount(seen.point, minlength=len(scene.points)) >= 2)[seen.point]
    width_px = np.broadcast_to(width_px, len(often))[often]
    seen = seen.select(often)
    points, owner = np.unique(seen.point, return_inverse=True)
    views = int(seen.view.max()) + 1
    part = Scene(scene.lens, scene.rotations[:views], scene.translations[:views], scene.points[points])
    problem = scene_problem(part, Observations(seen.view, owner, seen.uv), prior, width_px)
    sought = int((prior.sigma > 0).sum()) if curved else 0
    found = adjust(problem, part, iterations, tolerance, curved=curved, sought=sought)
    rotations, translations, places = scene.rotations.copy(), scene.translations.copy(), scene.points.copy()
    rotations[:views], translations[:views] = found.values.rotations, found.values.translations
    places[points] = found.values.points
    return Scene(found.values.lens, rotations, translations, places), found.cost


def _normals(points: Array) -> Array:
    """Returns the normals (M, 4) of the Householder reflections that map unit vectors (M, 4) to the last axis."""
    normals = points.copy()
    normals[:, 3] += np.where(points[:, 3] < 0, -1.0, 1.0)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
