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

NEAREST = 1e-6
"""[m, or the map's unit] Points nearer than that, or behind, are none in front of the camera."""


def slopes(xyz: Array) -> Array:
    """(N, 2) change of the inverse depth over the normalised image around each of points (N, 3) in the camera; 0 of
    those that are not in front."""
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
