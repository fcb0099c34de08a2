"""Parts left out of a window: the truth is what comes out without what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.solvers.influence.blame import blame
from ispom.solvers.influence.problem import Part
from ispom.solvers.influence.window import PRIOR
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.prior import POSE, anchored
from tests.solvers.influence.scene import BUS, POSES, poses, solved, truth, window


def test_without_the_bus_the_pose_is_the_true_one() -> None:
    problem = solved(window(bus_m=0.01))
    wrong = problem.pose.translation - truth().translation
    assert np.linalg.norm(wrong) > 1e-4
    part = Part("group", tracks=BUS)
    (shift,) = problem.shifts((part,))
    for found in (shift, problem.really(part)):
        np.testing.assert_allclose(found.position, wrong, atol=0.01 * float(np.linalg.norm(wrong)))
        turned = (problem.pose.inverse() @ truth()).log()[3:]
        np.testing.assert_allclose(found.rotation, turned, atol=0.01 * float(np.linalg.norm(turned)))


def test_the_bus_is_found_and_moved_the_pose_most() -> None:
    found = blame(solved(window(bus_m=0.01)))
    assert set(found.of("group")[0].part.tracks) == set(BUS)
    assert found.of("group")[0].shift.size > 2 * found.of("track")[0].shift.size


@pytest.mark.parametrize("bus_m", [0.002, 0.01])
def test_a_single_track_moved_the_pose_as_leaving_it_out_says(bus_m: float) -> None:
    problem = solved(window(bus_m))
    parts = tuple(Part("track", tracks=(number,)) for number in (*BUS, 0, 5))
    for part, shift in zip(parts, problem.shifts(parts), strict=True):
        really = problem.really(part)
        np.testing.assert_allclose(shift.position, really.position, atol=0.1 * really.size + 1e-7)


def test_without_a_keyframe_whose_observations_are_wrong_the_pose_is_the_true_one() -> None:
    start = window(0.0)
    seen = start.seen + np.where(start.cameras == 2, 2e-4, 0.0)[:, None] * np.sin(np.arange(len(start.seen)))[:, None]
    problem = solved(replace(start, seen=seen))
    wrong = problem.pose.translation - truth().translation
    part = Part("frame", time_ns=200)
    assert part in problem.parts
    for found in (*problem.shifts((part,)), problem.really(part)):
        np.testing.assert_allclose(found.position, wrong, atol=1e-7)


def test_without_a_prior_that_contradicts_the_images_the_pose_is_the_true_one() -> None:
    """The prior places the first pose exactly, and says of the second one that it is 10 mm elsewhere."""
    rotations, translations = poses()
    prior = anchored(rotations[0], translations[0], np.zeros(PAIR))
    size = 2 * POSE + PAIR
    hessian = np.zeros((size, size))
    at = np.r_[0:POSE, 2 * POSE : size]
    hessian[np.ix_(at, at)] = prior.hessian
    hessian[POSE : 2 * POSE, POSE : 2 * POSE] = np.eye(POSE) * 1e8
    elsewhere = translations[:2] + np.array([[0, 0, 0], [0.01, 0, 0]])
    wrong_prior = replace(
        prior, rotations=rotations[:2], translations=elsewhere, hessian=hessian, gradient=np.zeros(size)
    )
    problem = solved(window(0.0, wrong_prior))
    wrong = problem.pose.translation - truth().translation
    assert np.linalg.norm(wrong) > 1e-4
    part = Part("prior", PRIOR)
    for found in (*problem.shifts((part,)), problem.really(part)):
        np.testing.assert_allclose(found.position, wrong, atol=1e-5)


def test_the_keyframe_that_says_where_the_world_is_cannot_be_left_out() -> None:
    frames = [part.time_ns for part in solved(window(0.0)).parts if part.kind == "frame"]
    assert frames == [100 * k for k in range(1, POSES - 1)]
