"""A right shutter that opens late: what it does to the right x, and how it shows in the rows."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.solvers.late_shutter import RowFit, drift

F, BASELINE, LAG_S = 700.0, 0.5, 0.004
RATE = np.array([0.5, 0.1, -24.0, 0.02, -0.2, 0.01])
"""Ahead at 24 m/s in a bend: what is seen comes nearer."""


def seen_late(rate: np.ndarray, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of the left camera, and where the right one sees them (N, 2) when it opens."""
    rng = np.random.default_rng(2)
    depth = 1 / rng.uniform(1 / 200, 1 / 8, count)
    xyz = np.column_stack([rng.uniform(-0.7, 0.7, count), rng.uniform(-0.25, 0.2, count), np.ones(count)])
    xyz *= depth[:, None]
    later = Pose.exp(rate * LAG_S).apply(xyz) - (BASELINE, 0, 0)
    return xyz, later[:, :2] / later[:, 2:]


def test_the_right_x_drifts_by_motion_and_depth() -> None:
    xyz, late = seen_late(RATE)
    right = (xyz[:, 0] - BASELINE) / xyz[:, 2]
    found = LAG_S * (1 + right**2) * drift(xyz, np.tile(RATE, (len(xyz), 1)), LAG_S, BASELINE)
    assert np.abs(late[:, 0] - right).max() > 5 / F
    np.testing.assert_allclose(found, late[:, 0] - right, atol=0.02 / F)


def test_the_rows_show_the_lag_beside_a_bad_rectification_and_false_matches() -> None:
    rng = np.random.default_rng(3)
    fit = RowFit()
    for speed in (0.8, 1.0, 1.2):
        xyz, late = seen_late(speed * RATE)
        x, y = xyz[:, 0] / xyz[:, 2], xyz[:, 1] / xyz[:, 2]
        lower = late[:, 1] - y + 0.8 / F - 0.002 * x + 0.001 * y + 0.005 * x * y + rng.normal(0, 0.1 / F, len(x))
        lower[::10] += rng.uniform(-2, 2, len(x[::10])) / F
        lower[1::10] = np.nan
        fit = fit.with_pair(xyz, lower, speed * RATE, 0.34 / F)
    information, lag = fit.lag
    assert lag == pytest.approx(LAG_S, abs=3e-4) and information**-0.5 < 1e-3


def test_without_motion_ahead_the_rows_do_not_tell() -> None:
    xyz, late = seen_late(np.array([0, 0, 0, 0, -0.2, 0.0]))
    fit = RowFit().with_pair(xyz, late[:, 1] - xyz[:, 1] / xyz[:, 2], np.array([0, 0, 0, 0, -0.2, 0.0]), 0.34 / F)
    assert fit.lag[0] ** -0.5 > 0.5
