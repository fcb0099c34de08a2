"""Umeyama: exact on synthesised truth, including the cases where the determinant must be mended."""

import numpy as np
import pytest

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.alignment import RunningAlignment, umeyama


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("flat", [False, True])
def test_the_true_similarity_is_found(seed: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3)) * (1, 1, 0 if flat else 1)
    truth = Similarity(0.3 + rng.random() * 5, Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3)))
    found = umeyama(points, truth.apply(points), with_scale=True)
    assert found.scale == pytest.approx(truth.scale, rel=1e-12)
    np.testing.assert_allclose(found.pose.matrix, truth.pose.matrix, atol=1e-12)


def test_without_scale_the_motion_is_rigid() -> None:
    points = np.random.default_rng(1).normal(size=(10, 3))
    found = umeyama(points, 2 * points, with_scale=False)
    assert found.scale == 1.0
    np.testing.assert_allclose(found.pose.rotation, np.eye(3), atol=1e-12)


def test_points_without_extent_leave_the_scale_alone() -> None:
    found = umeyama(np.ones((4, 3)), np.full((4, 3), 3.0), with_scale=True)
    assert found.scale == 1.0
    np.testing.assert_allclose(found.apply(np.ones(3)), np.full(3, 3.0))


def test_unequal_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="as many"):
        umeyama(np.zeros((3, 3)), np.zeros((4, 3)), with_scale=False)


@pytest.mark.parametrize("with_scale", [True, False])
def test_a_running_alignment_is_that_of_all_points_so_far(with_scale: bool) -> None:
    rng = np.random.default_rng(3)
    source = 1000 + rng.standard_normal((50, 3)).cumsum(axis=0)
    target = 2.5 * source @ Pose.exp(np.array([0, 0, 0, 0.3, -0.2, 0.1])).rotation.T + rng.standard_normal((50, 3))
    running = RunningAlignment(with_scale)
    for count, (a, b) in enumerate(zip(source, target, strict=True), 1):
        running.add(a, b)
        if count > 3:
            whole = umeyama(source[:count], target[:count], with_scale)
            found = running.target_from_source
            assert found.scale == pytest.approx(whole.scale, rel=1e-9)
            assert np.allclose(found.apply(source[:count]), whole.apply(source[:count]), atol=1e-7)
