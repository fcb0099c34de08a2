"""Poses at any time, against a motion that is known at all times."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import rotation_angle_rad
from ispom.simulation.motions import Flight
from ispom.solvers.trajectory.continuous import Between, known_at, poses_at
from ispom.types import Trajectory

MOTION = Flight.seeded(2)


def sampled(step_ns: int, end_ns: int = 4_000_000_000) -> Trajectory:
    return Trajectory.of([(t, MOTION.pose_at(t)) for t in range(0, end_ns + 1, step_ns)])


@pytest.mark.parametrize("between", ["linear", "spline"])
def test_known_poses_are_kept(between: Between) -> None:
    given = sampled(100_000_000)
    found = poses_at(given, given.times_ns, between)
    np.testing.assert_allclose(found.translations, given.translations, atol=1e-9)
    np.testing.assert_allclose(found.rotations, given.rotations, atol=1e-9)


def test_times_may_come_in_any_order() -> None:
    given, asked = sampled(100_000_000), np.array([2_330_000_000, 17_000_000, 2_100_000_000])
    found = poses_at(given, asked, "spline")
    ordered = poses_at(given, np.sort(asked), "spline")
    np.testing.assert_array_equal(found.times_ns, asked)
    np.testing.assert_allclose(found.translations, ordered.translations[np.argsort(np.argsort(asked))], atol=1e-12)


def test_the_spline_follows_a_shake_that_lines_cut_off() -> None:
    asked = np.arange(500_000_000, 3_500_000_000, 7_000_000)
    true = Trajectory.of([(t, MOTION.pose_at(t)) for t in asked.tolist()])
    errors = {}
    for between in ("linear", "spline"):
        found = poses_at(sampled(33_333_333), asked, between)
        away = np.linalg.norm(found.translations - true.translations, axis=1).max()
        turned = rotation_angle_rad(found.rotations.transpose(0, 2, 1) @ true.rotations).max()
        errors[between] = np.array([away, turned])
    assert (errors["spline"] < 0.1 * errors["linear"]).all()
    assert errors["spline"][0] < 1e-4 and errors["spline"][1] < np.radians(0.01)


def test_outside_and_in_gaps_nothing_is_known() -> None:
    times_ns = np.array([0, 100, 200, 300, 1500, 1600, 1700])
    path = Trajectory(times_ns, np.tile(np.eye(3), (7, 1, 1)), np.zeros((7, 3)))
    asked = np.array([-1, 0, 150, 300, 301, 1499, 1500, 1700, 1701])
    assert known_at(path, asked).tolist() == [False, True, True, False, False, False, True, True, False]
    assert not known_at(path.select(np.array([0])), asked).any()
