"""The video camera's place and clock from two trajectories, against the truth; and motions that do not tell them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from ispom.calibration.motion.course import STILL_RAD, Course, start_of
from ispom.calibration.motion.hand_eye import HandEye, hand_eye
from ispom.geometry import Array, Pose
from ispom.simulation.motions import Flight

LEFT_FROM_VIDEO = Pose.from_rotvec(np.radians([1.2, -1.7, 2.9]), np.array([0.225, -0.045, 0.03]))
OFFSET_S = 0.0234
"""The video's stamps are too early by this."""
SEEDS = 50
Way = Callable[[float], Pose]
MM, DEG = 1e-3, np.radians(1.0)


def courses(
    seed: int, way: Callable[[float], Pose], noise: float = 1.0, duration_s: float = 20.0, drift: float = 0.01
) -> tuple[Course, Course]:
    """As two estimators give them: in worlds of their own, the video's in a unit of its own, with errors of poses, and
    steps that add up."""
    rng = np.random.default_rng([seed, 7])
    left_s, video_s = np.arange(0.0113, duration_s, 1 / 3), np.arange(0, duration_s, 1 / 30)
    left, own = [way(t) for t in left_s], [way(t + OFFSET_S) @ LEFT_FROM_VIDEO for t in video_s]
    scales = 0.37 * np.exp(drift * video_s / duration_s)
    return (
        _course(left, left_s, np.ones(len(left)), rng, noise * 1.0 * MM, noise * 0.01 * DEG),
        _course(own, video_s, 1 / scales, rng, noise * 0.5 * MM, noise * 0.008 * DEG),
    )


def _course(
    poses: list[Pose], times_s: Array, units: Array, rng: np.random.Generator, shift: float, turn: float
) -> Course:
    now, out = Pose(), []
    for k, pose in enumerate(poses):
        if k:
            step = poses[k - 1].inverse() @ pose
            added = Pose.exp(0.2 * rng.normal(0, 1, 6) * np.repeat([shift, turn], 3))
            now = now @ Pose(step.rotation, units[k] * step.translation) @ added
        error = Pose.exp(rng.normal(0, 1, 6) * np.repeat([shift * units[k], turn], 3))
        out.append(now @ error)
    return Course(times_s, np.stack([p.rotation for p in out]), np.stack([p.translation for p in out]))


def found_by(left: Course, video: Course) -> HandEye:
    start = start_of(left, video, 0.1)
    assert start is not None
    found = hand_eye(left, video, np.ones(len(left) - 1, bool), start)
    assert found is not None
    return found


@cache
def flight(seed: int) -> Callable[[float], Pose]:
    path = Flight.seeded(seed)
    return cache(lambda t: path.pose_at(round(t * 1e9)))


def errors(found: HandEye) -> Array:
    return np.append((found.video_from_left @ LEFT_FROM_VIDEO).log(), found.offset_s - OFFSET_S)


def test_exact_trajectories_give_exact_values() -> None:
    left, video = courses(0, flight(0), noise=0.0, drift=0.0)
    error = errors(found_by(left, video))
    assert np.linalg.norm(error[:3]) < 1 * MM
    assert np.linalg.norm(error[3:6]) < 0.003 * DEG
    assert abs(error[6]) < 1e-4


@pytest.mark.slow
def test_noisy_trajectories_are_within_three_standard_errors_in_95_percent_of_seeds() -> None:
    shares, wrong = [], []
    for seed in range(SEEDS):
        found = found_by(*courses(seed, flight(seed % 5)))
        shares.append(errors(found) / np.sqrt(np.diag(found.covariance)))
        wrong.append(errors(found))
    assert np.mean(np.abs(shares) <= 3, axis=0).min() >= 0.95
    assert np.sqrt(np.mean(np.square(shares), axis=0)).min() > 0.5
    assert np.linalg.norm(np.array(wrong)[:, 3:6], axis=1).max() < 0.1 * DEG
    assert np.linalg.norm(np.array(wrong)[:, :3], axis=1).max() < 20 * MM
    assert np.abs(np.array(wrong)[:, 6]).max() < 0.001


def test_a_clock_that_is_far_off_is_found_from_nothing() -> None:
    left, video = courses(3, flight(3))
    late = Course(video.times_s + 3.3, video.rotations, video.positions)
    start = start_of(left, late, 5.0)
    assert start is not None
    assert start.together
    assert start.offset_s == pytest.approx(OFFSET_S - 3.3, abs=0.02)


def test_cameras_of_different_sessions_are_told_apart() -> None:
    start = start_of(courses(1, flight(1))[0], courses(2, flight(2))[1], 0.5)
    assert start is not None
    assert not start.together


def straight(t: float) -> Pose:
    return Pose(translation=np.array([0.0, 0.0, 1.5 * t + 0.2 * np.sin(3 * t)]))


def planar(t: float) -> Pose:
    yaw = 0.4 * np.sin(0.8 * t) + 0.1 * np.sin(3.1 * t)
    return Pose.from_rotvec(np.array([0, yaw, 0]), np.array([2 * np.sin(0.4 * t), 0, 1.5 * t]))


def test_a_motion_without_turns_is_recognised() -> None:
    start = start_of(*courses(0, straight), 0.1)
    assert start is not None
    assert start.turned_rad < STILL_RAD


def test_turns_about_one_axis_leave_the_place_along_it_open() -> None:
    found = found_by(*courses(0, planar))
    sigma = np.sqrt(
        np.diag(LEFT_FROM_VIDEO.adjoint[:3, :3] @ found.covariance[:3, :3] @ LEFT_FROM_VIDEO.adjoint[:3, :3].T)
    )
    assert sigma[1] > 0.1
    assert sigma[[0, 2]].max() < 0.05
    assert found.turned_rad[1] < 0.1 * found.turned_rad[2]
