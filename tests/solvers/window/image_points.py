"""The image points of a window as a plain residual family in numpy: what the compiled kernels are a fast path of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Array
from ispom.numerics.robust import robust_loss
from ispom.numerics.twist import moved
from ispom.solvers.least_squares import Derivatives, Family, Problem
from ispom.solvers.right_camera import without_lens
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import LENS, POSE


@dataclass(frozen=True, eq=False)
class ImagePoints(Family[Window]):
    """Reprojection errors (K, 3) in x, y and right x. Shared unknowns: poses and corrections; blocks: points."""

    widths: Array
    """(K,) width of the loss."""
    loss = staticmethod(robust_loss)

    def residuals(self, values: Window) -> Array:
        q, seen = _in_camera(values), _seen(values)
        x, y, right = _image(q, values.baseline)
        if not values.baseline:
            stretch = 1 + values.extra[0] + values.extra[1] * (x**2 + y**2)
            return np.column_stack([x * stretch - seen[:, 0], y * stretch - seen[:, 1], np.zeros(len(q))])
        third = np.where(np.isfinite(seen[:, 2]), right - seen[:, 2], 0.0)
        return np.column_stack([x - seen[:, 0], y - seen[:, 1], third])

    def derivatives(self, values: Window) -> Derivatives:
        q, seen = _in_camera(values), _seen(values)
        by_q = _by_point(q, values, seen)
        by_twist = np.concatenate([by_q, np.cross(q[:, None], by_q)], axis=2)
        by_extra = _by_corrections(q, values, seen)
        poses = POSE * len(values.rotations)
        at_pose = POSE * values.cameras[:, None] + np.arange(POSE)
        at_extra = np.tile(poses + np.arange(by_extra.shape[2]), (len(q), 1))
        return Derivatives(
            np.concatenate([by_twist, by_extra], axis=2),
            np.concatenate([at_pose, at_extra], axis=1),
            by_q @ values.rotations[values.cameras],
            values.owners,
        )


def problem(window: Window, scale: float) -> Problem[Window]:
    """Returns the image points of a window, without priors, with the loss width `scale`."""

    def step(values: Window, shared: Array, points: Array) -> Window:
        poses, extra = np.split(shared, [POSE * len(values.rotations)])
        rotations, translations = moved(values.rotations, values.translations, poses.reshape(-1, POSE))
        extra = values.extra + extra
        return replace(
            values, rotations=rotations, translations=translations, points=values.points + points, extra=extra
        )

    size = POSE * len(window.rotations) + len(window.extra)
    family = ImagePoints(np.full(len(window.cameras), scale))
    return Problem((family,), step, size, len(window.points), 3)


def _in_camera(values: Window) -> Array:
    points = np.einsum("kij,kj->ki", values.rotations[values.cameras], values.points[values.owners])
    return points + values.translations[values.cameras]


def _image(q: Array, baseline: float) -> tuple[Array, Array, Array]:
    return q[:, 0] / q[:, 2], q[:, 1] / q[:, 2], (q[:, 0] - baseline) / q[:, 2]


def _seen(values: Window) -> Array:
    """Returns the observations (K, 3) without the errors of a pair's calibration."""
    if not values.baseline:
        return values.seen
    seen = without_lens(values.seen, values.extra)
    seen[:, 2] -= values.factors @ values.extra[: values.factors.shape[1]]
    return seen


def _by_point(q: Array, values: Window, seen: Array) -> Array:
    """Returns the derivatives (K, 3, 3) of the residuals by the point in its camera."""
    (x, y, right), z = _image(q, values.baseline), q[:, 2]
    by_q = np.zeros((len(q), 3, 3))
    by_q[:, 0, 0] = by_q[:, 1, 1] = by_q[:, 2, 0] = 1 / z
    by_q[:, 0, 2], by_q[:, 1, 2], by_q[:, 2, 2] = -x / z, -y / z, -right / z
    if values.baseline:
        by_q[:, 2] *= np.isfinite(seen[:, 2])[:, None]
        return by_q
    by_q[:, 2] = 0
    xy = np.column_stack([x, y])
    stretch = 1 + values.extra[0] + values.extra[1] * (xy**2).sum(1)
    by_xy = stretch[:, None, None] * np.eye(2) + 2 * values.extra[1] * xy[:, :, None] * xy[:, None]
    by_q[:, :2] = by_xy @ by_q[:, :2]
    return by_q


def _by_corrections(q: Array, values: Window, seen: Array) -> Array:
    """Returns the derivatives (K, 3, E) of the residuals by the corrections."""
    if not values.baseline:
        x, y, _ = _image(q, 0.0)
        own = np.stack([np.ones(len(q)), x**2 + y**2], axis=1)
        return np.stack([x[:, None] * own, y[:, None] * own, 0 * own], axis=1)
    out = np.zeros((len(q), 3, len(values.extra)))
    square = (seen[:, :2] ** 2).sum(1)
    slope = 1 + 3 * values.extra[0] * square + 5 * values.extra[1] * square**2
    # r (1 + k1 r^2 + k2 r^4) is observed, so r falls by r^3 / slope with k1, and by r^5 / slope with k2.
    share = np.stack([square, square**2], axis=1) / slope[:, None]
    out[:, :2, :LENS] = seen[:, :2, None] * share[:, None]
    shown = values.factors.shape[1]
    out[:, 2, :shown] = np.where(np.isfinite(seen[:, 2])[:, None], values.factors, 0.0)
    return out
