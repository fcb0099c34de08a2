"""Metrics on paths whose errors are known by construction."""

import numpy as np
import pytest

from ispom.evaluation.metrics import between_stereo_rmse_m, spline_between_stereo_rmse_m
from ispom.evaluation.relative_error import kitti_errors
from ispom.evaluation.scale import step_scale
from ispom.evaluation.trajectory_error import aligned, associate, ate_m
from ispom.geometry import Pose, so3_exp
from ispom.types import Trajectory


def straight(count: int, step_m: float, turn_deg: float = 0.0) -> Trajectory:
    """Along z, one pose each 0.1 s; the turn per pose is of the orientation only."""
    angles = np.radians(turn_deg) * np.arange(count)
    return Trajectory(
        np.arange(count) * 100_000_000,
        so3_exp(np.outer(angles, [0, 1, 0])),
        np.outer(np.arange(count) * step_m, [0, 0, 1.0]),
    )


def walk(times_ns: np.ndarray, shake_m: float) -> Trajectory:
    """A bend walked at 1 m/s with a shake at 3 Hz."""
    t = times_ns * 1e-9
    positions = np.stack([np.sin(t / 3) * 3, shake_m * np.sin(2 * np.pi * 3 * t), t], axis=1)
    return Trajectory(times_ns, so3_exp(np.outer(t / 10, [0, 1.0, 0])), positions)


def test_nearest_in_time_and_near_enough() -> None:
    reference = straight(10, 1)
    estimate = Trajectory(reference.times_ns[2:5] + np.array([4_000_000, -4_000_000, 40_000_000]), *poses(3))
    own, partners = associate(estimate, reference)
    assert partners.times_ns.tolist() == [200_000_000, 300_000_000]
    assert own.times_ns.tolist() == estimate.times_ns[:2].tolist()
    assert [len(t) for t in associate(Trajectory.empty(), reference)] == [0, 0]


def poses(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))


def test_alignment_takes_motion_and_unit_away() -> None:
    truth = walk(np.arange(100) * 50_000_000, 0.1)
    moved = truth.moved(left=Pose.from_rotvec(np.array([0.3, 1.0, -2.0]), np.array([5.0, 6, 7])))
    assert ate_m(aligned(moved, truth, "se3"), truth) == pytest.approx(0, abs=1e-12)
    shrunk = Trajectory(moved.times_ns, moved.rotations, moved.translations / 3)
    assert ate_m(aligned(shrunk, truth, "sim3"), truth) == pytest.approx(0, abs=1e-12)
    assert ate_m(aligned(shrunk, truth, "se3"), truth) > 0.5


@pytest.mark.parametrize(
    ("count", "lengths"), [(100, (5, 10, 20, 40)), (900, (100, 200, 300, 400)), (12, (5,)), (9, ())]
)
def test_kitti_errors_over_the_lengths_that_fit(count: int, lengths: tuple[int, ...]) -> None:
    truth = straight(count, 0.5001)
    estimate = straight(count, 0.5001 * 1.02, turn_deg=0)
    found = kitti_errors(estimate, truth)
    if not lengths:
        assert found is None
        return
    assert found is not None and found.lengths_m == lengths
    assert found.t_err_percent == pytest.approx(2.0, rel=0.1)
    assert found.r_err_deg_per_100m == 0


def test_kitti_rotation_error_is_per_100_m() -> None:
    found = kitti_errors(straight(2000, 0.5001, turn_deg=0.001), straight(2000, 0.5001))
    assert found is not None
    assert found.r_err_deg_per_100m == pytest.approx(0.2, rel=0.02)


def test_between_stereo_counts_only_what_happens_inside_a_segment() -> None:
    """A drift of the stereo poses themselves is not the integration's error; a missing shake is."""
    video_ns, stereo_ns = np.arange(90) * 33_000_000, np.arange(9) * 333_000_000 + 5_000_000
    truth = walk(np.union1d(video_ns, stereo_ns), 0.05)
    away = Pose.from_rotvec(np.array([0, 0.4, 0.1]), np.array([3.0, 0, 1]))
    stereo, estimate = (walk(t, 0.05).moved(left=away) for t in (stereo_ns, video_ns))
    assert between_stereo_rmse_m(estimate, stereo, truth) == pytest.approx(0, abs=1e-12)
    spline = spline_between_stereo_rmse_m(estimate, stereo, truth)
    assert spline is not None and 0.02 < spline < 0.1
    assert between_stereo_rmse_m(estimate, stereo.select(np.array([0])), truth) is None


def test_step_scale_of_a_shrinking_path() -> None:
    truth = walk(np.arange(400) * 50_000_000, 0.02)
    rate = np.linspace(1, 0.5, 399)[:, None]
    steps = np.diff(truth.translations, axis=0) * rate * 7
    shrinking = Trajectory(truth.times_ns, truth.rotations, np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]))
    found = step_scale(shrinking, truth)
    assert found is not None and len(found.windows) == 10
    assert found.end_over_start == pytest.approx(0.525 / 0.975, abs=0.01)
    assert (np.diff(found.windows) < 0).all()
    still = Trajectory(truth.times_ns, truth.rotations, 0 * truth.translations)
    assert step_scale(still, truth) is None and step_scale(truth, still) is None
