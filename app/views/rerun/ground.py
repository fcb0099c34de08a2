"""The grid on the ground, below the paths."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ispom.geometry import Array

from .eye import extent

LINES = 12
"""About how many lines of the grid the true path crosses."""
COLOUR = (128, 128, 128, 50)


def grid_spacing(path: Array) -> float:
    """A round distance (1, 2 or 5 times a power of ten) that divides the extent of a path (N, 3) into about LINES."""
    size = extent(path) or 10.0
    power = 10.0 ** np.floor(np.log10(size / LINES))
    return float(next(power * m for m in (1, 2, 5, 10) if power * m * LINES >= size))


def grid_below(path: Array, size: float, spacing: float) -> rrb.LineGrid3D:
    """Returns a horizontal grid somewhat below the path (N, 3) of a scene of this size. The true height of the camera
    is unknown."""
    lowest = float(path[:, 1].max()) if len(path) else 0.0
    plane = rr.components.Plane3D(normal=(0, 1, 0), distance=lowest + 0.3 * size)
    return rrb.LineGrid3D(visible=True, spacing=spacing, plane=plane, stroke_width=0.5, color=COLOUR)
