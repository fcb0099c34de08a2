"""Local bundle adjustment: optimises the poses of a window of keyframes and the points they observe.

Runs the windowed bundle adjustment (solvers/window) for one camera, with fixed first poses in place of a prior, and
without corrections of the calibration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.solvers.window import adjustment as window


@dataclass(frozen=True, eq=False)
class Bundle:
    """The result of `adjust`."""

    cameras_from_world: tuple[Pose, ...]
    xyz_in_world: Array
    """(M, 3)."""
    cost_before: float
    cost_after: float
    """Half the robust sum of squares, in units of the squared loss scale."""
    residuals: Array
    """(K,) reprojection errors, normalised units, after the optimisation; 1e9 behind the camera."""
    iterations: int


def adjust(
    cameras_from_world: tuple[Pose, ...],
    xyz_in_world: Array,
    camera_index: NDArray[np.int64],
    point_index: NDArray[np.int64],
    x: Array,
    fixed: int,
    scale: float,
    iterations: int = 10,
) -> Bundle:
    """Optimises all points and all cameras but the first `fixed` (two fix the gauge, including the scale).

    Observation k (of K) is the normalised coordinates x[k] (2,) of point point_index[k] in camera camera_index[k];
    `scale` is that of the robust loss in the same unit. Points behind a camera have no weight.
    """
    order = np.lexsort((camera_index, point_index))
    found = window.adjust(
        window.Window(
            np.stack([p.rotation for p in cameras_from_world]),
            np.stack([p.translation for p in cameras_from_world]),
            np.array(xyz_in_world, float),
            camera_index[order],
            point_index[order],
            np.column_stack([x[order], np.full(len(x), np.nan)]),
            fixed=fixed,
        ),
        scale,
        iterations,
        tolerance=1e-5,
    )
    residuals = np.empty(len(x))
    residuals[order] = found.distances
    poses = tuple(Pose(r, t) for r, t in zip(found.window.rotations, found.window.translations, strict=True))
    return Bundle(poses, found.window.points, found.cost_before, found.cost_after, residuals, found.iterations)
