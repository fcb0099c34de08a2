"""How the surfaces slant that points lie on, by the points around them.

A plane has an inverse depth that changes evenly over the image.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.kernels import kernel

REACH = 0.08
"""[rad] How far neighbours count: some ten of the tracks of one image, and less than the side of a house."""
LIKE = 0.02
"""Share of its inverse depth by which a neighbour off the plane counts half: another surface is off by more."""
STEPS = 4
"""Of the weights: each neighbour counts by how far it was off the plane before."""
HELD = 0.05
"""What a slope is held back by, times the weight of a neighbour at the rim: it keeps nine tenths of itself by ten
neighbours, and where three lie along a line nothing is made up across it. With 0.02 to 0.15 KITTI 06 is 16 to 19 mm
off, and KITTI 00 0.16 to 0.21 m."""


def slopes(xy: Array, inverse: Array) -> Array:
    """(N, 2) change of the inverse depth (N,) over the image around each of the points at normalised places (N, 2)."""
    return _slopes(np.ascontiguousarray(xy), np.ascontiguousarray(inverse))


@kernel()
def _slopes(xy, inverse):
    n, out = len(xy), np.zeros((len(xy), 2))
    near, weights = np.empty((n, 3)), np.empty(n)
    for i in range(n):
        count, scale = 0, 1 / (LIKE * inverse[i])
        for j in range(n):
            dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
            far = (dx * dx + dy * dy) / (REACH * REACH)
            if far < 1.0 and j != i:
                near[count, 0], near[count, 1], near[count, 2] = dx, dy, inverse[j] - inverse[i]
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
