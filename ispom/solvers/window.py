"""Windowed bundle adjustment over one camera or a rectified pair, with a prior for what has left the window.

Schur complement over the points (Triggs et al. 2000), Cauchy loss, Levenberg's damping; marginalisation as in
Leutenegger et al. 2015, section 3.5. Beside poses and points it can estimate what is wrong with the pair.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp

POSE, EXTRA = 6, 2
"""Unknowns of a pose: left twist (rho, phi) of camera_from_world; and of the camera or the pair: see Window.extra."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What marginalised poses and points say of those still there: cost 1/2 d' H d + g' d, d their change since."""

    rotations: Array
    """(P, 3, 3) camera_from_world of the first P poses of the window, when linearised."""
    translations: Array
    """(P, 3)."""
    extra: Array
    """(2,)."""
    hessian: Array
    """(6 P + 2, 6 P + 2)."""
    gradient: Array
    """(6 P + 2,)."""

    def shifted(self, rotations: Array, translations: Array, extra: Array) -> Array:
        """d (6 P + 2,) of the values now against those of the linearisation."""
        p = len(self.rotations)
        turn = rotations[:p] @ np.swapaxes(self.rotations, 1, 2)
        rho = translations[:p] - (turn @ self.translations[:, :, None])[..., 0]
        return np.concatenate([np.hstack([rho, _small_log(turn)]).ravel(), extra - self.extra])


@dataclass(frozen=True, eq=False)
class Window:
    """Poses, points and observations to be adjusted. Image coordinates are normalised (on the plane z = 1)."""

    rotations: Array
    """(C, 3, 3) camera_from_world, oldest first."""
    translations: Array
    """(C, 3)."""
    points: Array
    """(M, 3) xyz_in_world."""
    cameras: NDArray[np.int64]
    """(K,) pose of each observation; the observations are sorted by point."""
    owners: NDArray[np.int64]
    """(K,) point of each observation."""
    seen: Array
    """(K, 3) x, y in the (left) camera, x in the right one; NaN where there is none."""
    rates: Array
    """(C,) turn rate about the camera's y axis [rad/s], which a late right shutter turns into disparity."""
    baseline: float = 0.0
    """Of the pair; 0 for one camera."""
    extra: Array = field(default_factory=lambda: np.zeros(EXTRA))
    """Of a pair: offset of the right x (a yaw error of the rectification) [rad], and lag of the right shutter [s].
    Of one camera: what is wrong with its focal length f and radial distortion k, seen = x (1 + f + k |x|^2)."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(EXTRA))
    """(2,) standard deviations before any data; 0 keeps the value as it is."""
    prior: Prior | None = None
    fixed: int = 0
    """The first poses are held."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    window: Window
    cost_before: float
    cost_after: float
    distances: Array
    """(K,) reprojection errors at the end (both images), normalised; 1e9 behind the camera."""
    iterations: int


def adjust(window: Window, scale: float, iterations: int = 10, tolerance: float = 1e-3) -> Adjusted:
    """Minimises the Cauchy loss of scale `scale` (normalised units) over poses from `fixed` on, points, and extras.

    Ends early when a step lowers the cost by less than the share `tolerance`. Deterministic.
    """
    damping, cost = 1e-4, total_cost(window, scale)
    before, done = cost, 0
    for done in range(1, iterations + 1):  # noqa: B007
        trial = _moved(window, *_step(window, scale, damping))
        trial_cost = total_cost(trial, scale)
        if trial_cost < cost:
            gain = (cost - trial_cost) / max(cost, 1e-300)
            window, cost, damping = trial, trial_cost, max(damping / 10, 1e-9)
            if gain < tolerance:
                break
        else:
            damping *= 30
            if damping > 1e3:
                break
    return Adjusted(window, before, cost, _distances(*_arrays(window)), done)


def total_cost(window: Window, scale: float) -> float:
    """Half the robust sum of squares, in units of the measurement's standard deviation `scale`, with the priors."""
    cost = _cost(scale, *_arrays(window))
    if window.prior is not None:
        d = window.prior.shifted(window.rotations, window.translations, window.extra)
        cost += 0.5 * d @ window.prior.hessian @ d + window.prior.gradient @ d
    else:
        free = window.extra_sigma > 0
        cost += 0.5 * float(((window.extra[free] / window.extra_sigma[free]) ** 2).sum())
    return float(cost)


def covariance(window: Window, scale: float) -> Array:
    """(6 C + 2, 6 C + 2) of all poses (left twists) and extras, given what is in the window."""
    return np.linalg.inv(_Equations.of(replace(window, fixed=0), scale).matrix)


def marginalise(window: Window, points: NDArray[np.bool_], scale: float) -> Prior:
    """The prior on poses 1.. and the extras that replaces pose 0 and these points (mask (M,)) with their observations.

    All observations of these points in the window are used up by it.
    """
    gone = points[window.owners]
    number = np.cumsum(points) - 1
    part = replace(
        window,
        points=window.points[points],
        cameras=window.cameras[gone],
        owners=number[window.owners[gone]],
        seen=window.seen[gone],
        fixed=0,
    )
    equations = _Equations.of(part, scale)
    h, g, a = equations.matrix, -equations.right, slice(0, POSE)
    b = slice(POSE, len(g))
    inverse = np.linalg.pinv(h[a, a], rcond=1e-12, hermitian=True)
    rest = h[b, b] - h[b, a] @ inverse @ h[a, b]
    return Prior(
        window.rotations[1:],
        window.translations[1:],
        window.extra,
        (rest + rest.T) / 2,
        g[b] - h[b, a] @ inverse @ g[a],
    )


def anchored(rotation: Array, translation: Array, extra_sigma: Array, sigma: float = 1e-6) -> Prior:
    """The prior that makes the first pose the world: known to `sigma`."""
    information = np.concatenate([np.full(POSE, sigma**-2), np.where(extra_sigma > 0, extra_sigma, 1.0) ** -2.0])
    zeros = np.zeros(POSE + EXTRA)
    return Prior(rotation[None], translation[None], np.zeros(EXTRA), np.diag(information), zeros)


def _prior_terms(window: Window) -> tuple[Array, Array]:
    """Hessian and gradient of the priors at the values now, for all poses and the extras."""
    size = POSE * len(window.rotations) + EXTRA
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    prior = window.prior
    if prior is not None:
        p = POSE * len(prior.rotations)
        place = np.r_[np.arange(p), np.arange(size - EXTRA, size)]
        hessian[np.ix_(place, place)] = prior.hessian
        gradient[place] = prior.gradient + prior.hessian @ prior.shifted(
            window.rotations, window.translations, window.extra
        )
    else:
        for i, sigma in enumerate(window.extra_sigma):
            if sigma > 0:
                hessian[size - EXTRA + i, size - EXTRA + i] = sigma**-2
                gradient[size - EXTRA + i] = window.extra[i] / sigma**2
    for i, sigma in enumerate(window.extra_sigma):
        if sigma <= 0:
            hessian[size - EXTRA + i, size - EXTRA + i] = 1e30
    return hessian, gradient


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of poses and extras with the points eliminated, and what gives the points back."""

    matrix: Array
    right: Array
    inverses: Array
    sides: Array
    cross: Array
    cross_extra: Array

    @staticmethod
    def of(window: Window, scale: float, damping: float = 0.0) -> _Equations:
        n_points, n_obs, size = len(window.points), len(window.cameras), POSE * len(window.rotations) + EXTRA
        out = _Equations(
            np.zeros((size, size)),
            np.zeros(size),
            np.zeros((n_points, 3, 3)),
            np.zeros((n_points, 3)),
            np.zeros((n_obs, 6, 3)),
            np.zeros((n_points, EXTRA, 3)),
        )
        _schur(
            *(scale, damping, out.matrix, out.right, out.inverses, out.sides, out.cross, out.cross_extra),
            *_arrays(window),
        )
        hessian, gradient = _prior_terms(window)
        return replace(out, matrix=out.matrix + hessian, right=out.right - gradient)


def _step(window: Window, scale: float, damping: float) -> tuple[Array, Array, Array]:
    """One damped step: of the poses (C, 6), the points (M, 3) and the extras (2,)."""
    equations, f = _Equations.of(window, scale, damping), POSE * window.fixed
    free = equations.matrix[f:, f:]
    free[np.diag_indices_from(free)] *= 1 + damping
    free[np.diag_indices_from(free)] += 1e-12
    solution = np.concatenate([np.zeros(f), np.linalg.solve(free, equations.right[f:])])
    pose_step, extra_step = solution[:-EXTRA], solution[-EXTRA:]
    point_step = _back_substituted(
        window.cameras,
        window.owners,
        equations.cross,
        equations.cross_extra,
        equations.inverses,
        equations.sides,
        pose_step,
        extra_step,
    )
    return pose_step.reshape(-1, POSE), point_step, extra_step


def _arrays(window: Window) -> Any:
    return (
        window.rotations, window.translations, window.points, window.cameras, window.owners, window.seen,
        window.rates, window.baseline, window.extra,
    )  # fmt: skip


def _moved(window: Window, pose_step: Array, point_step: Array, extra_step: Array) -> Window:
    turn = so3_exp(pose_step[:, 3:])
    return replace(
        window,
        rotations=turn @ window.rotations,
        translations=np.einsum("nij,nj->ni", turn, window.translations) + pose_step[:, :3],
        points=window.points + point_step,
        extra=window.extra + extra_step,
    )


def _small_log(turn: Array) -> Array:
    """Rotation vectors (N, 3) of (N, 3, 3) well below pi: a window's poses turn little between two linearisations."""
    axis = (
        np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1) / 2
    )
    sine = np.sqrt((axis * axis).sum(1))
    angle = np.arctan2(sine, (np.trace(turn, axis1=1, axis2=2) - 1) / 2)
    return axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-300), 1.0)[:, None]


@njit(cache=True)
def _residual(rotations, translations, points, c, m, seen, rates, baseline, extra, r):
    """Into r (3,): the residual; returns depth, x, y, right x."""
    x = rotations[c, 0, 0] * points[m, 0] + rotations[c, 0, 1] * points[m, 1] + rotations[c, 0, 2] * points[m, 2]
    y = rotations[c, 1, 0] * points[m, 0] + rotations[c, 1, 1] * points[m, 1] + rotations[c, 1, 2] * points[m, 2]
    z = rotations[c, 2, 0] * points[m, 0] + rotations[c, 2, 1] * points[m, 1] + rotations[c, 2, 2] * points[m, 2]
    x, y, z = x + translations[c, 0], y + translations[c, 1], z + translations[c, 2]
    if z <= 1e-6:
        return z, 0.0, 0.0, 0.0
    x, y = x / z, y / z
    right = x - baseline / z
    r[0], r[1], r[2] = x - seen[0], y - seen[1], 0.0
    if baseline == 0.0:
        stretch = extra[0] + extra[1] * (x * x + y * y)
        r[0] += stretch * x
        r[1] += stretch * y
    if not np.isnan(seen[2]):
        r[2] = right + (1.0 + right * right) * (extra[0] + extra[1] * rates[c]) - seen[2]
    return z, x, y, right


@njit(cache=True)
def _distances(rotations, translations, points, cameras, owners, seen, rates, baseline, extra):
    out, r = np.empty(len(cameras)), np.zeros(3)
    for k in range(len(cameras)):
        z = _residual(
            rotations, translations, points, cameras[k], owners[k], seen[k], rates, baseline, extra, r
        )[0]  # fmt: skip
        out[k] = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) if z > 1e-6 else 1e9
    return out


@njit(cache=True)
def _cost(scale, rotations, translations, points, cameras, owners, seen, rates, baseline, extra):
    total, r = 0.0, np.zeros(3)
    for k in range(len(cameras)):
        z = _residual(
            rotations, translations, points, cameras[k], owners[k], seen[k], rates, baseline, extra, r
        )[0]  # fmt: skip
        # A point behind a camera costs what a gross error of 1000 scales does.
        square = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / (scale * scale) if z > 1e-6 else 1e6
        total += 0.5 * np.log1p(min(square, 1e6))
    return total


@njit(cache=True)
def _schur(
    scale, damping, reduced, right, inverses, sides, cross, cross_extra,
    rotations, translations, points, cameras, owners, seen, rates, baseline, extra,
):  # fmt: skip
    """Adds to the reduced system (upper triangle) and its right side; keeps what back-substitution needs."""
    n_obs, n_points, e0 = len(cameras), len(points), POSE * len(rotations)
    r, jp, jx = np.zeros(3), np.zeros((3, 6)), np.zeros((3, 3))
    je, ye = np.zeros((3, EXTRA)), np.zeros((EXTRA, 3))
    v, inverse, b = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    per = 1.0 / (scale * scale)
    k = 0
    for m in range(n_points):
        begin = k
        v[:], b[:] = 0.0, 0.0
        while k < n_obs and owners[k] == m:
            c = cameras[k]
            z, x, yy, xr = _residual(
                rotations, translations, points, c, m, seen[k], rates, baseline, extra, r
            )  # fmt: skip
            cross[k] = 0.0
            if z > 1e-6:
                rows = 2 if np.isnan(seen[k, 2]) else 3
                w = per / (1.0 + (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * per)
                iz = 1.0 / z
                jp[0, 0], jp[0, 1], jp[0, 2] = iz, 0.0, -x * iz
                jp[1, 0], jp[1, 1], jp[1, 2] = 0.0, iz, -yy * iz
                jp[0, 3], jp[0, 4], jp[0, 5] = -x * yy, 1 + x * x, -yy
                jp[1, 3], jp[1, 4], jp[1, 5] = -1 - yy * yy, x * yy, x
                if rows == 3:
                    off = extra[0] + extra[1] * rates[c]
                    f = 1.0 + 2.0 * xr * off
                    # right = x - baseline / z: its derivative by (x, y, z) of the camera is (1, 0, -right) / z
                    jp[2, 0], jp[2, 1], jp[2, 2] = f * iz, 0.0, -f * xr * iz
                    jp[2, 3], jp[2, 4], jp[2, 5] = -f * xr * yy, f * (1 + x * xr), -f * yy
                    je[2, 0] = 1.0 + xr * xr
                    je[2, 1] = je[2, 0] * rates[c]
                if baseline == 0.0:
                    square = x * x + yy * yy
                    stretch, bend = 1.0 + extra[0] + extra[1] * square, 2.0 * extra[1]
                    for a in range(6):
                        along = bend * (x * jp[0, a] + yy * jp[1, a])
                        jp[0, a], jp[1, a] = stretch * jp[0, a] + along * x, stretch * jp[1, a] + along * yy
                    je[0, 0], je[0, 1], je[1, 0], je[1, 1] = x, x * square, yy, yy * square
                for i in range(rows):
                    for a in range(3):
                        jx[i, a] = (
                            jp[i, 0] * rotations[c, 0, a]
                            + jp[i, 1] * rotations[c, 1, a]
                            + jp[i, 2] * rotations[c, 2, a]
                        )
                o = 6 * c
                for i in range(rows):
                    for a in range(3):
                        wa = w * jx[i, a]
                        b[a] -= wa * r[i]
                        for d in range(a, 3):
                            v[a, d] += wa * jx[i, d]
                    for a in range(6):
                        wa = w * jp[i, a]
                        right[o + a] -= wa * r[i]
                        for d in range(a, 6):
                            reduced[o + a, o + d] += wa * jp[i, d]
                        for d in range(3):
                            cross[k, a, d] += wa * jx[i, d]
                for i in range(0 if baseline == 0.0 else 2, rows):
                    for a in range(EXTRA):
                        wa = w * je[i, a]
                        right[e0 + a] -= wa * r[i]
                        for d in range(a, EXTRA):
                            reduced[e0 + a, e0 + d] += wa * je[i, d]
                        for d in range(6):
                            reduced[o + d, e0 + a] += wa * jp[i, d]
                        for d in range(3):
                            cross_extra[m, a, d] += wa * jx[i, d]
            k += 1
        # A share of the block: anything fixed, however little, would hold what is far where it was first thought.
        least = 1e-10 * (v[0, 0] + v[1, 1] + v[2, 2])
        for a in range(3):
            v[a, a] += damping * v[a, a] + least
        # the inverse of a symmetric 3 x 3
        c00, c01, c02 = (
            v[1, 1] * v[2, 2] - v[1, 2] * v[1, 2],
            v[0, 2] * v[1, 2] - v[0, 1] * v[2, 2],
            v[0, 1] * v[1, 2] - v[0, 2] * v[1, 1],
        )
        det = v[0, 0] * c00 + v[0, 1] * c01 + v[0, 2] * c02
        s = 1.0 / det if abs(det) > 1e-300 else 0.0
        inverse[0, 0], inverse[0, 1], inverse[0, 2] = c00 * s, c01 * s, c02 * s
        inverse[1, 0], inverse[1, 1] = c01 * s, (v[0, 0] * v[2, 2] - v[0, 2] * v[0, 2]) * s
        inverse[1, 2] = (v[0, 1] * v[0, 2] - v[0, 0] * v[1, 2]) * s
        inverse[2, 0], inverse[2, 1] = inverse[0, 2], inverse[1, 2]
        inverse[2, 2] = (v[0, 0] * v[1, 1] - v[0, 1] * v[0, 1]) * s
        for a in range(3):
            sides[m, a] = b[a]
            for d in range(3):
                inverses[m, a, d] = inverse[a, d]
        for a in range(EXTRA):
            for d in range(3):
                ye[a, d] = (
                    cross_extra[m, a, 0] * inverse[0, d]
                    + cross_extra[m, a, 1] * inverse[1, d]
                    + cross_extra[m, a, 2] * inverse[2, d]
                )
            right[e0 + a] -= ye[a, 0] * b[0] + ye[a, 1] * b[1] + ye[a, 2] * b[2]
            for d in range(a, EXTRA):
                reduced[e0 + a, e0 + d] -= (
                    ye[a, 0] * cross_extra[m, d, 0] + ye[a, 1] * cross_extra[m, d, 1] + ye[a, 2] * cross_extra[m, d, 2]
                )
        for first in range(begin, k):
            o = 6 * cameras[first]
            for a in range(6):
                p, q, t = cross[first, a, 0], cross[first, a, 1], cross[first, a, 2]
                y0 = p * inverse[0, 0] + q * inverse[1, 0] + t * inverse[2, 0]
                y1 = p * inverse[0, 1] + q * inverse[1, 1] + t * inverse[2, 1]
                y2 = p * inverse[0, 2] + q * inverse[1, 2] + t * inverse[2, 2]
                right[o + a] -= y0 * b[0] + y1 * b[1] + y2 * b[2]
                for d in range(EXTRA):
                    reduced[o + a, e0 + d] -= (
                        y0 * cross_extra[m, d, 0] + y1 * cross_extra[m, d, 1] + y2 * cross_extra[m, d, 2]
                    )
                # observations of one point are sorted by camera: only the upper triangle of blocks
                for second in range(first, k):
                    n = 6 * cameras[second]
                    for d in range(6):
                        reduced[o + a, n + d] -= (
                            y0 * cross[second, d, 0] + y1 * cross[second, d, 1] + y2 * cross[second, d, 2]
                        )
    size = len(right)
    for a in range(size):
        for d in range(a):
            reduced[a, d] = reduced[d, a]


@njit(cache=True)
def _back_substituted(cameras, owners, cross, cross_extra, inverses, sides, solution, extra_step):
    """The points' steps (M, 3), once those of the poses and extras are known; changes `sides`."""
    step = np.zeros((len(sides), 3))
    for k in range(len(cameras)):
        m, o = owners[k], 6 * cameras[k]
        for d in range(3):
            for a in range(6):
                sides[m, d] -= cross[k, a, d] * solution[o + a]
    for m in range(len(sides)):
        for d in range(3):
            for a in range(EXTRA):
                sides[m, d] -= cross_extra[m, a, d] * extra_step[a]
        for d in range(3):
            for a in range(3):
                step[m, d] += inverses[m, d, a] * sides[m, a]
    return step
