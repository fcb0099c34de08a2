"""How large cameras are drawn: a scene that is a thousand times as large looks the same."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.model.drawn_size import OF_SPACING, OF_TRUE_PATH, DrawnSize, drawn_size, true_size
from ispom_app.engine.model.poses import PoseHistory, Times

from ispom.types import Rig, Trajectory
from tests import doubles

RIG = doubles.rig()
assert RIG.video is not None
SINGLE = Rig.single(RIG.video)


def along(spacing: float, count: int = 5) -> Trajectory:
    places = np.arange(count)[:, None] * [0.0, 0.0, spacing]
    return Trajectory(np.arange(count) * 10**9, np.tile(np.eye(3), (count, 1, 1)), places)


def known(spacing: float, count: int = 5) -> PoseHistory:
    """Keyframes so far apart."""
    poses, times = along(spacing, count), Times.none()
    for i, time_ns in enumerate(poses.times_ns.tolist()):
        times = times.with_exposure(i, time_ns)
    found = PoseHistory().with_poses(times.rows(poses.times_ns), poses, count - 1)
    for row in range(count):
        found = found.with_key_frame(row, count - 1)
    return found


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
def test_frusta_of_a_single_camera_follow_its_key_frames_not_metres(factor: float):
    size = drawn_size("monocular", SINGLE, None, known(0.7 * factor), 1.0, None)
    assert size.camera == pytest.approx(0.7 * factor) and size.key_frame == pytest.approx(OF_SPACING * 0.7 * factor)


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
def test_frusta_of_metric_methods_follow_the_true_path(factor: float):
    truth = along(10.0 * factor)
    one, two = (drawn_size("stereo", RIG, truth, known(spacing * factor), 1.0, None) for spacing in (2.0, 0.1))
    assert one.camera == two.camera == pytest.approx(true_size(truth)) == pytest.approx(OF_TRUE_PATH * 40 * factor)
    assert one.key_frame == pytest.approx(OF_SPACING * one.camera) and two.key_frame < OF_SPACING * 0.1001 * factor


def test_a_placed_camera_is_as_large_as_the_true_one_in_its_own_unit():
    truth = along(10.0)
    assert drawn_size("monocular", RIG, truth, known(1.0), 4.0, None).camera == pytest.approx(OF_TRUE_PATH * 40 / 4)
    assert drawn_size("monocular", SINGLE, truth, known(1.0), 1.0, None).camera == pytest.approx(1.0)


def test_at_rest_a_stereo_camera_is_as_large_as_its_baseline_says():
    assert drawn_size("stereo", RIG, None, known(1e-4), 1.0, None).camera == pytest.approx(2 * RIG.baseline_m)
    still = along(0.0)
    assert true_size(still) is None and true_size(None) is None
    assert drawn_size("monocular", SINGLE, still, PoseHistory(), 1.0, None) == DrawnSize(1.0, OF_SPACING, 0.0)


def test_a_size_stays_until_the_distances_differ_clearly():
    first = drawn_size("monocular", SINGLE, None, known(1.0), 1.0, None)
    assert drawn_size("monocular", SINGLE, None, known(1.4), 1.0, first) is first
    assert drawn_size("monocular", SINGLE, None, known(1.6), 1.0, first).camera == pytest.approx(1.6)
