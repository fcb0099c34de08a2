"""Splines through given poses: exact where knots can follow the motion, and a misfit where they cannot."""

from __future__ import annotations

import numpy as np

from ispom.geometry import so3_exp
from ispom.solvers.spline.fit import fitted, misfits
from tests.solvers.made_flight import made_flight


def test_poses_of_a_spline_give_that_spline_again() -> None:
    rng, times = np.random.default_rng(2), np.linspace(0, 1.5, 46)
    rotations = np.stack([so3_exp(np.array([0.5 * t, 2.5 * t, 0.1])) for t in times])
    made = fitted(times, rotations, rng.normal(0, 0.01, (46, 3)) + times[:, None], 0.1)
    at = made.at(times)
    again = misfits(fitted(times, at.rotations, at.positions, 0.1, 4), times, at.rotations, at.positions)
    assert np.abs(again).max() < 2e-4


def test_a_shake_needs_finer_knots_than_a_smooth_way() -> None:
    flight = made_flight(1.4, 1)
    times, poses = flight.times_s, [flight.truth(e) for e in range(len(flight.times_s))]
    keep = np.concatenate([[True], np.diff(times) > 1e-6])
    times = times[keep]
    rotations, positions = (np.stack([getattr(p, n) for p in poses])[keep] for n in ("rotation", "translation"))
    off = {k: np.abs(misfits(fitted(times, rotations, positions, k / 30), times, rotations, positions)) for k in (2, 4)}
    assert off[2][:, :3].max() < 1e-3 and off[4][:, :3].max() > 3e-3
    smooth = np.stack([times, times**2, np.sin(times)], axis=1)
    still = np.repeat(np.eye(3)[None], len(times), 0)
    assert np.abs(misfits(fitted(times, still, smooth, 4 / 30), times, still, smooth)).max() < 5e-4
