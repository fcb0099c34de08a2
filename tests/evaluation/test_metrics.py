"""What metrics.json says: each trajectory is judged in its own frame and unit."""

import numpy as np
import pytest

from ispom.evaluation import metrics
from ispom.geometry import Pose
from ispom.types import Trajectory
from tests import doubles

RIG = doubles.rig()
TRUTH = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 20 * 10**9, 10**8)])
ELSEWHERE = Pose.from_rotvec(np.array([0.2, -1.0, 0.4]), np.array([4.0, 5, 6]))


def test_a_perfect_metric_trajectory_has_no_error() -> None:
    found = metrics.path_errors(TRUTH.moved(left=ELSEWHERE), TRUTH, RIG, metric=True)
    assert found["aligned"] == "se3" and found["lengths_m"] == [5, 10, 20, 40]
    for name in ("ate_m", "rpe_m", "rpe_deg", "t_err_percent", "r_err_deg_per_100m"):
        assert found[name] == pytest.approx(0, abs=1e-5)


def test_a_perfect_video_trajectory_in_its_own_unit_has_no_error() -> None:
    """It is compared with the truth of the video camera: no lever arm, no unit is missed."""
    video = TRUTH.moved(left=ELSEWHERE, right=RIG.rig_from_video, frame="video")
    own = Trajectory(video.times_ns, video.rotations, video.translations / 7, "video")
    found = metrics.path_errors(own, TRUTH, RIG, metric=False)
    assert found["aligned"] == "sim3"
    assert found["ate_m"] == pytest.approx(0, abs=1e-9) and found["rpe_deg"] == pytest.approx(0, abs=1e-5)
    assert found["step_scale_end_over_start"] == pytest.approx(1)
    assert found["step_scale_along_path"] == pytest.approx([1] * 10)


def test_with_too_few_poses_nothing_is_claimed() -> None:
    found = metrics.path_errors(TRUTH.select(np.array([0, 1])), TRUTH, RIG, metric=True)
    assert found["aligned"] == "se3" and {value for name, value in found.items() if name != "aligned"} == {None}


def test_between_stereo_of_the_truth_is_zero_and_that_of_the_spline_is_not() -> None:
    stereo = TRUTH.select(np.arange(0, 200, 20))
    found = metrics.between_stereo(TRUTH, stereo, TRUTH)
    assert found["between_stereo_rmse_m"] == pytest.approx(0, abs=1e-12)
    assert (found["spline_between_stereo_rmse_m"] or 0) > 1e-3
