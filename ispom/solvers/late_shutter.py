"""A right shutter that opens late: by then what the pair passes has moved on, in rows and columns.

Columns alone could mistake a longer focal length for that. In the rows only a turn, a shift and a stretch of the right
image stand beside it, and those do not depend on depth and motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ispom.geometry import Array

TERMS = 6
"""Shift (and pitch), roll, stretch, yaw of the right image, and turning on for a while, which are of no interest; then
moving on for a while [s]: the lag."""
SIGMA = np.array([0.05, 0.05, 0.05, 0.05, 1.0, 1.0])
"""Before any data: wide, only so that what was never seen has a value."""


LEAST_S = 1e-5
"""Steps of the difference quotient are not smaller."""


def drift(xyz: Array, rates: Array, lag: float, baseline: float) -> Array:
    """(N,) how much the right x (normalised) of points (N, 3) of the left camera grows per second of lag, over 1 + x^2.

    `rates` (N, 6): change of camera_from_world (rho [m/s], phi [rad/s]; left). About `lag`: it is not quite linear.
    """
    z = np.maximum(xyz[:, 2], 1e-6)
    right = (xyz[:, 0] - baseline) / z
    step = lag if abs(lag) > LEAST_S else LEAST_S
    change = rates[:, :3] + np.cross(rates[:, 3:], xyz)
    later = (xyz[:, 0] + step * change[:, 0] - baseline) / np.maximum(z + step * change[:, 2], 0.5 * z)
    return (later - right) / (step * (1 + right**2))


@dataclass(frozen=True, eq=False)
class RowFit:
    """Normal equations of all pairs so far: they do not grow."""

    matrix: Array = field(default_factory=lambda: np.diag(SIGMA**-2.0))
    right: Array = field(default_factory=lambda: np.zeros(TERMS))

    @property
    def terms(self) -> Array:
        """(6,)."""
        return np.linalg.solve(self.matrix, self.right)

    @property
    def lag(self) -> tuple[float, float]:
        """Information [1/s^2] about the lag, and the lag [s]."""
        spread = np.linalg.inv(self.matrix)
        return float(1 / spread[-1, -1]), float(spread[-1] @ self.right)

    def with_pair(self, xyz: Array, rows: Array, rate: Array, scale: float, iterations: int = 5) -> RowFit:
        """With points (N, 3) of the left camera that lie `rows` (N,) lower in the right image, normalised.

        `rate` (6,): change of camera_from_world (rho [m/s], phi [rad/s]; left). Cauchy loss of scale `scale`.
        """
        good = np.isfinite(rows) & (xyz[:, 2] > 1e-6)
        p, rows = xyz[good], rows[good]
        if not len(p):
            return self
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        turn, way = np.cross(rate[3:], p / p[:, 2:]), rate[:3] / p[:, 2:]
        lags = [change[:, 1] - y * change[:, 2] for change in (turn, way)]
        design = np.column_stack([np.ones(len(p)), x, y, x * y, *lags])
        error, fit = rows - np.median(rows), self
        for _ in range(iterations):
            # As wide as the errors still are.
            wide = max(scale, 1.5 * float(np.median(np.abs(error))))
            weighted = design / (wide**2 + error**2)[:, None]
            fit = replace(self, matrix=self.matrix + weighted.T @ design, right=self.right + weighted.T @ rows)
            error = rows - design @ fit.terms
        return fit
