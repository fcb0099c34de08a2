"""Estimates the slopes of surfaces at points, from the neighbouring points.

The inverse depth of a plane is linear in the image coordinates.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.kernels import kernel

REACH = 0.08
"""Radius [rad] of the neighbourhood: some ten of an image's tracks, and less than the side of a house."""
LIKE = 0.02
"""Relative residual of a neighbour's inverse depth at which its weight is halved: other surfaces differ by more."""
STEPS = 4
"""Number of reweighting steps."""
HELD = 0.05
"""Regularisation of a slope, relative to the weight of a neighbour at the rim: ten neighbours keep nine tenths of the
slope, and three on a line give none across it. With 0.02 to 0.15 the error is 16 to 19 mm on KITTI 06, and 0.16 to 0.21
m on KITTI 00."""

NEAREST = 1e-6
"""Least depth [m, or the map's unit] of a point in front of the camera."""


def slopes(xyz: Array) -> Array:
    """Returns the gradient (N, 2) of the inverse depth over the normalised image at each of points (N, 3) in the
    camera; 0 for points not in front of it."""
    return _slopes(np.ascontiguousarray(xyz))


@kernel()
def _slopes(xyz):
    n, out = len(xyz), np.zeros((len(xyz), 2))
    places, near, weights = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    for i in range(n):
        places[i, 2] = 1 / xyz[i, 2] if xyz[i, 2] > NEAREST else 0.0
        places[i, 0], places[i, 1] = xyz[i, 0] * places[i, 2], xyz[i, 1] * places[i, 2]
    for i in range(n):
        inverse, count = places[i, 2], 0
        if inverse == 0.0:
            continue
        scale = 1 / (LIKE * inverse)
        for j in range(n):
            dx, dy = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
            far = (dx * dx + dy * dy) / (REACH * REACH)
            if far < 1.0 and j != i and places[j, 2] > 0.0:
                near[count, 0], near[count, 1], near[count, 2] = dx, dy, places[j, 2] - inverse
                weights[count] = (1.0 - far) * (1.0 - far)
                count += 1
        a, b, held = 0.0, 0.0, HELD * REACH * REACH
        for _ in range(STEPS):
            xx, xy_, yy, p, q = held, 0.0, held, 0.0, 0.0
            for k in range(count):
                dx, dy, off = near[k, 0], near[k, 1], near[k, 2]
                left = (off - a * dx - b * dy) * scale
                w = weights[k] / (1.0 + left * left)
                xx += w * dx * dx
                xy_ += w * dx * dy
                yy += w * dy * dy
                p += w * dx * off
                q += w * dy * off
            det = xx * yy - xy_ * xy_
            a, b = (yy * p - xy_ * q) / det, (xx * q - xy_ * p) / det
        out[i, 0], out[i, 1] = a, b
    return out
