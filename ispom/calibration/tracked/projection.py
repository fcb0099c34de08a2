"""Errors of a scene's points in its images, and their derivatives, compiled: an adjustment computes them most often.

The lens is (log f, cx, cy, k1, k2), with the radial model of OpenCV. Points (M, 4) are homogeneous, of length 1. They
move along the unit sphere: in the first three axes after the Householder reflection that maps the point to the last
axis, whose normals (M, 4) are given.
"""

from __future__ import annotations

import numpy as np

from ispom.cameras import LEAST_DEPTH
from ispom.kernels import kernel, part


@part
def _in_camera(rotations, translations, points, v, m):
    """Returns point m in the camera of view v, up to scale."""
    x, y, z, w = points[m, 0], points[m, 1], points[m, 2], points[m, 3]
    return (
        rotations[v, 0, 0] * x + rotations[v, 0, 1] * y + rotations[v, 0, 2] * z + translations[v, 0] * w,
        rotations[v, 1, 0] * x + rotations[v, 1, 1] * y + rotations[v, 1, 2] * z + translations[v, 1] * w,
        rotations[v, 2, 0] * x + rotations[v, 2, 1] * y + rotations[v, 2, 2] * z + translations[v, 2] * w,
    )


@kernel()
def errors(lens, rotations, translations, points, view, point, uv):
    """Returns predicted minus observed pixels (K, 2); NaN behind a camera."""
    focal, out = np.exp(lens[0]), np.full(uv.shape, np.nan)
    for k in range(len(view)):
        qx, qy, qz = _in_camera(rotations, translations, points, view[k], point[k])
        if qz > LEAST_DEPTH:
            a, b = qx / qz, qy / qz
            square = a * a + b * b
            radial = focal * (1 + square * (lens[3] + square * lens[4]))
            out[k, 0], out[k, 1] = a * radial + lens[1] - uv[k, 0], b * radial + lens[2] - uv[k, 1]
    return out


@kernel()
def slopes(lens, rotations, translations, points, normals, view, point):
    """Returns the derivatives of `errors` by the lens and a left twist (rho, phi) of the view's pose (K, 2, 11), and by
    the point's move (K, 2, 3). Behind a camera they are those on its axis."""
    focal, count = np.exp(lens[0]), len(view)
    by_shared, by_point, by_q = np.zeros((count, 2, 11)), np.zeros((count, 2, 3)), np.zeros((2, 3))
    for k in range(count):
        v, m = view[k], point[k]
        qx, qy, qz = _in_camera(rotations, translations, points, v, m)
        if not qz > LEAST_DEPTH:
            qx, qy, qz = 0.0, 0.0, 1.0
        a, b = qx / qz, qy / qz
        square = a * a + b * b
        radial = 1 + square * (lens[3] + square * lens[4])
        bent = 2 * (lens[3] + 2 * square * lens[4])  # of `radial`, by half the square
        by_q[0, 0], by_q[0, 1] = focal * (radial + bent * a * a) / qz, focal * bent * a * b / qz
        by_q[1, 0], by_q[1, 1] = by_q[0, 1], focal * (radial + bent * b * b) / qz
        w, n = points[m, 3], normals[m]
        for r in range(2):
            by_q[r, 2] = -(a * by_q[r, 0] + b * by_q[r, 1])
            along = focal * (a if r == 0 else b)
            by_shared[k, r, 0], by_shared[k, r, 1 + r] = along * radial, 1.0
            by_shared[k, r, 3], by_shared[k, r, 4] = along * square, along * square * square
            x, y, z = by_q[r, 0], by_q[r, 1], by_q[r, 2]
            by_shared[k, r, 5], by_shared[k, r, 6], by_shared[k, r, 7] = w * x, w * y, w * z
            # q = R x_3 + t w: a left twist moves it by w rho + phi x q
            by_shared[k, r, 8], by_shared[k, r, 9] = qy * z - qz * y, qz * x - qx * z
            by_shared[k, r, 10] = qx * y - qy * x
            across = n[3] * (x * translations[v, 0] + y * translations[v, 1] + z * translations[v, 2])
            for d in range(3):
                by_point[k, r, d] = x * rotations[v, 0, d] + y * rotations[v, 1, d] + z * rotations[v, 2, d]
                across += by_point[k, r, d] * n[d]
            for d in range(3):
                by_point[k, r, d] -= 2 * across * n[d]
    return by_shared, by_point
