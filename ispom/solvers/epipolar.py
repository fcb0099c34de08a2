"""Points of unknown depth constrain a pose by their distance from the epipolar line.

The depth is not an unknown: for each pose it is the one that projects nearest to the observation, which leaves the
error across the epipolar line. The depth is bounded by the nearest point of the scene and by infinity. At a bound the
error along the line remains as well, so that each point constrains the rotation of a camera at rest by two equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, read_only
from ispom.numerics.robust import robust_weights
from ispom.numerics.vectors import matrix, plus, scaled, times, vector

LEAST_INVERSE_DEPTH = 1e-6
"""Least inverse depth, relative to that of the nearest point: practically infinity."""


@dataclass(frozen=True, eq=False)
class Rays:
    """M points of unknown depth, observed by two cameras."""

    directions: Array
    """(M, 3) rays from the first camera, in world axes; their component along its optical axis is 1."""
    origin: Array
    """(3,) centre of the first camera, in the world."""
    nearest: float
    """Least depth in the first camera."""
    seen: Array
    """(M, 2) observations in the second camera, normalised."""

    @staticmethod
    def of(world_from_first: Pose, first: Array, nearest: float, seen: Array) -> Rays:
        """Returns the rays of points with normalised coordinates `first` and `seen` (M, 2) in the two cameras."""
        directions = np.column_stack([first, np.ones(len(first))]) @ world_from_first.rotation.T
        return Rays(directions, world_from_first.translation, nearest, seen)

    def errors(self, camera_from_world: Pose) -> tuple[Array, Array]:
        """Returns the errors (M, 2) in the second image, and their derivatives (M, 2, 6) by a left twist of its pose.

        Behind the camera errors are inf, and derivatives 0.
        """
        errors, by_twist = np.empty((len(self.seen), 2)), np.zeros((len(self.seen), 2, 6))
        origin = camera_from_world.apply(self.origin[None])
        given = (read_only(a) for a in (self.directions, camera_from_world.rotation[None], origin, self.seen))
        _errors(*given, 1 / self.nearest, errors, by_twist)
        return errors, by_twist

    def normal(self, camera_from_world: Pose, scale: float) -> tuple[Array, Array]:
        """Returns the normal equations (6, 6) and (6,) with robust weights, in units of `scale`.

        An observation in each of two images contributes to an error, so its variance is twice that of one.
        """
        errors, by_twist = self.errors(camera_from_world)
        variance = 2 * scale**2
        weights = robust_weights((errors**2).sum(axis=1), variance**0.5) / variance
        weighted = (weights[:, None, None] * by_twist).reshape(-1, 6)
        return weighted.T @ by_twist.reshape(-1, 6), np.where(np.isfinite(errors), errors, 0.0).ravel() @ weighted


@kernel()
def _errors(directions, rotation, origin, seen, largest, errors, by_twist):
    """Fills errors and derivatives. `rotation` (1, 3, 3) is camera_from_world, `origin` (1, 3) the first camera's
    centre in the second one, `largest` the largest inverse depth."""
    turn, base = matrix(rotation, 0), vector(origin, 0)
    for m in range(len(directions)):
        far = times(turn, vector(directions, m))
        errors[m, 0] = errors[m, 1] = np.inf
        if far[2] <= 1e-6:
            continue
        fx, fy = far[0] / far[2], far[1] / far[2]
        lx, ly = base[0] - fx * base[2], base[1] - fy * base[2]
        length = np.sqrt(lx * lx + ly * ly)
        inverse, free = 0.0, False
        if length > 0.0:
            lx, ly = lx / length, ly / length
            along = (seen[m, 0] - fx) * lx + (seen[m, 1] - fy) * ly
            left = length - along * base[2]
            inverse = along * far[2] / left if left > 0.0 else largest
            free = 0.0 < inverse < largest
        inverse = min(max(inverse, LEAST_INVERSE_DEPTH * largest), largest)
        q = plus(scaled(1.0 / inverse, far), base)
        if q[2] <= 1e-6:
            continue
        x, y, iz = q[0] / q[2], q[1] / q[2], 1.0 / q[2]
        ex, ey = x - seen[m, 0], y - seen[m, 1]
        u = iz, 0.0, -iz * x, -x * y, 1.0 + x * x, -y
        v = 0.0, iz, -iz * y, -1.0 - y * y, x * y, x
        # Projects the error onto the normal of the line: the depth compensates the component along it.
        xx, xy, yy = (ly * ly, -lx * ly, lx * lx) if free else (1.0, 0.0, 1.0)
        errors[m, 0], errors[m, 1] = xx * ex + xy * ey, xy * ex + yy * ey
        for i in range(6):
            by_twist[m, 0, i], by_twist[m, 1, i] = xx * u[i] + xy * v[i], xy * u[i] + yy * v[i]
