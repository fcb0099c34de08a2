"""The simulated path: deterministic, curved in all directions, and shaken as a hand would."""

import numpy as np
import pytest

from ispom.geometry import rotation_angle_rad
from ispom.simulation.motions import Flight
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Trajectory

SECOND_NS = 1_000_000_000


def sampled(path: Flight, rate_hz: float, duration_s: float = 20.0) -> Trajectory:
    times = [round(i / rate_hz * SECOND_NS) for i in range(int(duration_s * rate_hz) + 1)]
    return Trajectory.of([(t, path.pose_at(t)) for t in times])


@pytest.mark.parametrize("seed", range(6))
def test_walking_pace_and_bends_in_all_directions(seed: int) -> None:
    truth = sampled(Flight.seeded(seed), 200)
    smooth = sampled(Flight.seeded(seed), 1)
    assert 1.4 < smooth.length / 20 < 2.0
    assert (np.ptp(smooth.translations, axis=0) > (2.5, 0.7, 25)).all()
    assert np.abs(truth.translations[:, 0]).max() < 2.6
    assert np.abs(truth.translations[:, 1] + 1.75).max() < 0.75
    forward = truth.rotations[:, :, 2]
    assert np.degrees(np.ptp(np.arctan2(forward[:, 0], forward[:, 2]))) > 25


@pytest.mark.parametrize("seed", range(3))
def test_interpolated_stereo_cannot_follow_the_shake(seed: int) -> None:
    path = Flight.seeded(seed)
    truth = sampled(path, 30)
    between = interpolate(sampled(path, 3), truth.times_ns, "bspline")
    off_m = np.linalg.norm(between.translations - truth.translations, axis=1)
    off_deg = np.degrees(rotation_angle_rad(between.rotations.transpose(0, 2, 1) @ truth.rotations))
    assert 0.008 < np.sqrt(np.mean(off_m**2)) < 0.05
    assert 0.4 < np.sqrt(np.mean(off_deg**2)) < 3


def test_a_seed_is_one_path() -> None:
    a, b, other = Flight.seeded(4), Flight.seeded(4), Flight.seeded(5)
    assert np.array_equal(a.pose_at(SECOND_NS).matrix, b.pose_at(SECOND_NS).matrix)
    assert not np.allclose(a.pose_at(SECOND_NS).matrix, other.pose_at(SECOND_NS).matrix)
