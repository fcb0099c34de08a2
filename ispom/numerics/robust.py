"""Noise of measurements, its robust loss, and robust statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.kernels import part

MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation: 1 / Phi^-1(3/4)."""


@dataclass(frozen=True)
class Noise:
    """Noise of one coordinate of a measurement, in the unit of that coordinate."""

    sigma: float
    """Standard deviation."""
    factor: float = 1.0
    """Width of the robust loss over the standard deviation."""

    @property
    def width(self) -> float:
        """Width of the robust loss: a residual of this size has half the weight of a small one."""
        return self.factor * self.sigma

    def times(self, scale: float) -> Noise:
        """Returns the same noise in another unit."""
        return Noise(scale * self.sigma, self.factor)


def robust_loss(squares: Array) -> tuple[Array, Array]:
    """Returns the losses (N,) and weights (N,) of squared residuals (N,), in units of the squared width.

    It is Cauchy's, log(1 + r^2), the one robust loss of the library: a residual of one width has half the weight of a
    small one.
    """
    return np.log1p(squares), 1 / (1 + squares)


def robust_weights(squares: Array, width: float) -> Array:
    """Returns the weights (N,) of the robust loss at squared residuals (N,)."""
    return 1 / (1 + squares / width**2)


def robust_cost(squares: Array, width: float) -> float:
    """Returns the sum of the robust loss over squared residuals (N,), in units of `width` squared."""
    return 0.5 * float(np.log1p(squares / width**2).sum())


@part
def weighted_information(square, information):
    """Returns the robust weight at a squared residual, times `information`, which is 1 / width^2 of the loss."""
    return information / (1.0 + square * information)


def normalised_mad(values: Array) -> float:
    """Returns the standard deviation of values (N,) from their median absolute deviation, which tolerates 50 %
    outliers."""
    return MAD * float(np.median(np.abs(values - np.median(values))))
