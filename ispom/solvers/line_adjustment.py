"""Lines in three and more views: displacements from known rotations, and bundle adjustment of poses and lines.

Three planes through one line of the scene are linearly dependent. With rotations known, that is one linear equation in
the centres of the cameras for each line (Spetsakis and Aloimonos, Structure from motion using line correspondences,
IJCV 1990; Taylor and Kriegman, PAMI 1995). Two views of a line do not constrain the motion.

In the bundle adjustment a line is the segment that its first view observed, with one inverse depth at each end.
Residuals are
distances of the observed ends from the projected line (Bartoli and Sturm, Structure-from-motion using lines, CVIU
2005), so that a line without parallax, or one that reaches behind a camera, is no special case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.robust import robust_cost, robust_weights
from ispom.solvers.lines import KnownDirections, direction_steps

SAMPLES, SAMPLE_SIZE = 500, 5
"""Number of RANSAC samples, and lines of each: five equations fix two displacements up to their common scale."""
MAX_ITERATIONS, TOLERANCE = 25, 1e-4
"""Largest number of steps, and the relative decrease of the cost that ends them."""


def displacements(normals: Array, limit: float, seed: int = 0) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the centres (2, 3) of the second and third camera in the first one, and the mask (N,) of inlier lines.

    The centres have joint length 1; their common sign is not determined. `normals` (3, N, 3): normals of the lines'
    planes in the three views, all rotated into the first camera. `limit`: largest error [rad] of an inlier's normal.
    """
    m = normals
    direction = np.linalg.svd(np.moveaxis(m, 0, 1))[2][:, -1]
    a = np.stack([np.einsum("ni,ni->n", np.cross(m[j], m[k]), direction) for j, k in ((2, 0), (0, 1))])
    rows = np.concatenate([a[0, :, None] * m[1], a[1, :, None] * m[2]], axis=1)
    # An error of a normal moves its equation by the displacement times the coefficient.
    size = np.maximum(np.hypot(a[0], a[1]), 1e-9)
    rows /= size[:, None]
    rng, count = np.random.default_rng(seed), len(rows)
    if count < SAMPLE_SIZE:
        return np.zeros((2, 3)), np.zeros(count, bool)
    chosen = np.stack([rng.choice(count, SAMPLE_SIZE, replace=False) for _ in range(SAMPLES)])
    candidates = np.linalg.svd(rows[chosen])[2][:, -1]
    errors = np.minimum(np.abs(rows @ candidates.T) / limit, 1.0) ** 2
    best = candidates[int(errors.sum(axis=0).argmin())]
    for _ in range(3):
        fits = np.abs(rows @ best) < limit
        if fits.sum() < SAMPLE_SIZE:
            break
        best = np.linalg.eigh(rows[fits].T @ rows[fits])[1][:, 0]
    return best.reshape(2, 3), np.abs(rows @ best) < limit


@dataclass(frozen=True, eq=False)
class LineViews:
    """N lines in K views, with M observations besides those of the first view of each line."""

    poses: tuple[Pose, ...]
    """camera_from_world of each view."""
    anchor: NDArray[np.int64]
    """(N,) the first view of each line."""
    x: Array
    """(N, 2, 2) the line's ends in that view, normalised."""
    rho: Array
    """(N, 2) inverse depths of both ends in that view."""
    line: NDArray[np.int64]
    """(M,) line of each observation."""
    view: NDArray[np.int64]
    """(M,) view of each observation."""
    ends: Array
    """(M, 2, 2) observed ends, normalised."""

    @property
    def xyz(self) -> Array:
        """(N, 2, 3) both ends in the world; NaN where an inverse depth is not positive."""
        rays = _rays(self.x) / np.where(self.rho > 0, self.rho, np.nan)[..., None]
        back = [pose.inverse() for pose in self.poses]
        rotation, origin = (np.stack([getattr(p, n) for p in back])[self.anchor] for n in ("rotation", "translation"))
        return np.einsum("nij,nej->nei", rotation, rays) + origin[:, None]


def _rays(x: Array) -> Array:
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, eq=False)
class _Projected:
    """Residuals and derivatives of M observations."""

    residual: Array
    """(M, 2) distances of the observed ends from the projected line, normalised."""
    by_ends: Array
    """(M, 2, 2, 3) derivative of each residual by each projected end (scaled by its inverse depth)."""
    q: Array
    """(M, 2, 3) the projected ends times their inverse depths."""
    rotation: Array
    """(M, 3, 3) view_from_anchor."""
    translation: Array
    """(M, 3) view_from_anchor."""


def _projected(views: LineViews) -> _Projected:
    rotations, translations = (np.stack([getattr(p, n) for p in views.poses]) for n in ("rotation", "translation"))
    a, k, n = views.anchor[views.line], views.view, views.line
    rotation = rotations[k] @ rotations[a].transpose(0, 2, 1)
    translation = translations[k] - np.einsum("mij,mj->mi", rotation, translations[a])
    q = np.einsum("mij,mej->mei", rotation, _rays(views.x[n])) + views.rho[n][..., None] * translation[:, None]
    line = np.cross(q[:, 0], q[:, 1])
    size = np.maximum(np.linalg.norm(line[:, :2], axis=1), 1e-12)
    seen = _rays(views.ends)
    residual = np.einsum("mi,mei->me", line, seen) / size[:, None]
    flat = np.concatenate([line[:, :2] / size[:, None], np.zeros((len(line), 1))], axis=1)
    by_line = (seen - residual[..., None] * flat[:, None]) / size[:, None, None]
    by_ends = np.stack([np.cross(q[:, None, 1], by_line), np.cross(by_line, q[:, None, 0])], axis=2)
    return _Projected(residual, by_ends, q, rotation, translation)


def line_residuals(views: LineViews) -> Array:
    """Returns the distances (M, 2) of observed ends from projected lines, normalised."""
    return _projected(views).residual


def adjusted(views: LineViews, directions: list[KnownDirections], sigma: float, width: float, fixed: int) -> LineViews:
    """Optimises all poses but the first `fixed`, and all inverse depths, by Levenberg-Marquardt with the robust loss.

    `directions`: segments of known direction in each view. `sigma`: standard deviation of an observed end, normalised;
    `width` of the loss, in standard deviations. With one fixed pose the distance between the first two views is kept.
    """
    count = len(views.poses)
    n, k, a = views.line, views.view, views.anchor[views.line]

    def cost(v: LineViews) -> float:
        total = robust_cost((line_residuals(v) / sigma).ravel() ** 2, width)
        for pose, known in zip(v.poses, directions, strict=True):
            if len(known.seen):
                total += robust_cost((direction_steps(pose.rotation, known)[0] / known.sigma) ** 2, width)
        return total

    def stepped(v: LineViews, damping: float) -> LineViews:
        p = _projected(v)
        residual, by_ends = p.residual / sigma, p.by_ends / sigma
        weight = robust_weights(residual**2, width)
        rho = v.rho[n][:, None, :, None]
        own = np.concatenate([rho * by_ends, np.cross(p.q[:, None], by_ends)], axis=3).sum(axis=2)
        back = -np.einsum("mefi,mij->mefj", by_ends, p.rotation)
        of_anchor = np.concatenate([rho * back, np.cross(_rays(v.x[n])[:, None], back)], axis=3).sum(axis=2)
        by_rho = np.einsum("mefi,mi->mef", by_ends, p.translation)

        normal, side = np.zeros((count, count, 6, 6)), np.zeros((count, 6))
        parts = ((k, own), (a, of_anchor))
        for i, left in parts:
            np.add.at(side, i, -np.einsum("mei,me,me->mi", left, weight, residual))
            for j, right in parts:
                np.add.at(normal, (i, j), np.einsum("mei,me,mej->mij", left, weight, right))
        for i, (pose, known) in enumerate(zip(v.poses, directions, strict=True)):
            if len(known.seen):
                r, by = direction_steps(pose.rotation, known)
                r, by = r / known.sigma, by / known.sigma[:, None]
                w = robust_weights(r**2, width)
                normal[i, i, 3:, 3:] += (by * w[:, None]).T @ by
                side[i, 3:] -= by.T @ (w * r)
        lines = len(v.rho)
        depth, depth_side, mixed = np.zeros((lines, 2, 2)), np.zeros((lines, 2)), np.zeros((lines, count, 6, 2))
        np.add.at(depth, n, np.einsum("mei,me,mej->mij", by_rho, weight, by_rho))
        np.add.at(depth_side, n, -np.einsum("mei,me,me->mi", by_rho, weight, residual))
        for i, part in parts:
            np.add.at(mixed, (n, i), np.einsum("mei,me,mej->mij", part, weight, by_rho))

        # Inverse depths are eliminated (Schur complement); damping keeps those without parallax constant.
        depth[:, [0, 1], [0, 1]] *= 1 + damping
        depth += 1e-3 * np.eye(2)
        inverse = np.linalg.inv(depth)
        flat = mixed.reshape(lines, 6 * count, 2)
        gain = flat @ inverse
        full = normal.transpose(0, 2, 1, 3).reshape(6 * count, 6 * count)
        full = full + np.diag(damping * np.diag(full) + 1e-6) - np.einsum("lai,lbi->ab", gain, flat)
        right = side.ravel() - np.einsum("lai,li->a", gain, depth_side)
        step = np.zeros(6 * count)
        free = slice(6 * fixed, None)
        step[free] = np.linalg.solve(full[free, free], right[free])
        rho_step = np.einsum("lij,lj->li", inverse, depth_side - np.einsum("lai,a->li", flat, step))
        poses = tuple(Pose.exp(d) @ pose for d, pose in zip(step.reshape(-1, 6), v.poses, strict=True))
        moved = replace(v, poses=poses, rho=v.rho + rho_step)
        return _rescaled(moved, views) if fixed == 1 else moved

    found = minimise(views, cost, stepped, MAX_ITERATIONS, TOLERANCE).values
    return replace(found, poses=tuple(Pose.from_xyzw(p.xyzw, p.translation) for p in found.poses))


def _rescaled(views: LineViews, like: LineViews) -> LineViews:
    """Scales the views about the first pose, so that the distance between the first two is that of `like`."""
    first = views.poses[0]
    now, before = ((v.poses[1] @ v.poses[0].inverse()).translation for v in (views, like))
    factor = float(np.linalg.norm(before) / max(np.linalg.norm(now), 1e-12))
    poses = tuple((pose @ first.inverse()).scaled(factor) @ first for pose in views.poses)
    return replace(views, poses=(first, *poses[1:]), rho=views.rho / factor)
