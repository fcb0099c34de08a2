"""The one definition of a trajectory's error: association, alignment, the curve and its root mean square."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.evaluation.comparison import compare, measures
from ispom.evaluation.metrics import path_errors
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth, trajectory_error
from ispom.geometry import Pose
from ispom.types import Camera, Rig, Trajectory


def path(count: int, noise_m: float = 0.0, scale: float = 1.0) -> Trajectory:
    """A curve in space, with noise and in a unit of its own."""
    t, rng = np.linspace(0, 3, count), np.random.default_rng(1)
    xyz = np.stack([np.cos(t), np.sin(2 * t), 0.3 * t**2], 1) + noise_m * rng.standard_normal((count, 3))
    return Trajectory(np.arange(count) * 50_000_000, np.tile(np.eye(3), (count, 1, 1)), scale * xyz)


@pytest.mark.parametrize("metric", [True, False])
def test_every_file_and_table_states_the_same_error(metric: bool) -> None:
    truth, estimate = path(40), path(40, 0.01, 1.0 if metric else 3.0)
    kind = alignment_of(metric)
    error = error_against_truth(estimate, truth, Rig(), kind)
    assert error is not None and kind == ("se3" if metric else "sim3")
    assert path_errors(estimate, truth, Rig(), metric)["ate_m"] == error.ate_m
    compared = compare(estimate, truth, (error.estimate, error.reference), kind)
    assert measures(compared)["ate_rmse_m"] == error.ate_m
    assert np.sqrt(np.mean(error.position_errors_m**2)) == pytest.approx(error.ate_m, abs=1e-15)


def test_it_is_known_from_three_common_poses_on() -> None:
    assert trajectory_error(path(40).select(np.arange(2)), path(40), "se3") is None
    assert trajectory_error(path(40).select(np.arange(3)), path(40), "se3") is not None


def test_over_some_frames_the_alignment_is_that_of_these_frames() -> None:
    truth, estimate = path(40), path(40, 0.01)
    bent = Trajectory(
        estimate.times_ns, estimate.rotations, estimate.translations + np.linspace(0, 1, 40)[:, None] ** 4
    )
    error = trajectory_error(bent, truth, "se3")
    assert error is not None
    part = error.over(estimate.times_ns[:10])
    alone = trajectory_error(bent.select(np.arange(10)), truth, "se3")
    assert part is not None and alone is not None and part.ate_m == alone.ate_m < error.ate_m
    assert error.over(estimate.times_ns[:2]) is None


def test_the_truth_is_carried_to_the_frame_of_the_estimate() -> None:
    rig = Rig.single(Camera(64, 48, 50.0, 50.0, 31.5, 23.5)).changed(
        rig_from_video=Pose(np.eye(3), np.array([0.2, 0.0, 0.0]))
    )
    truth = path(40)
    video = truth.moved(right=rig.rig_from_video, frame="video")
    error = error_against_truth(video, truth, rig, "none")
    assert error is not None and error.ate_m == pytest.approx(0, abs=1e-12)
