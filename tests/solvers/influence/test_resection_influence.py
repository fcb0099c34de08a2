"""Parts left out of a pose from known points, and the door by which methods tell what they solved."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.influence.blame import blame, problem_of
from ispom.solvers.influence.groups import groups
from ispom.solvers.influence.problem import Part, Problem, collecting_problems, report_problem
from ispom.solvers.influence.resection import MOTION, ResectionProblem
from ispom.solvers.localisation import fit_pose
from tests.solvers.influence.scene import BASELINE, BUS, POINTS, SCALE, points

TRUTH = Pose.from_rotvec(np.array([0.02, -0.05, 0.01]), np.array([0.1, -0.05, -1.1]))
PULLED = Pose.exp(np.array([0.02, 0, 0, 0, 0, 0])) @ TRUTH


def problem(bus: float, prior: np.ndarray | None = None, pair: bool = True) -> ResectionProblem:
    """The points of the bus are seen so far from where they are (normalised)."""
    xyz = points()
    near = TRUTH.apply(xyz)
    seen = np.column_stack([near[:, 0], near[:, 1], near[:, 0] - BASELINE]) / near[:, 2:]
    seen[list(BUS)] += [bus, 0, bus]
    seen, baseline = (seen, BASELINE) if pair else (seen[:, :2], 0.0)
    guess = TRUTH if prior is None else PULLED
    found = fit_pose(xyz, seen, guess, SCALE, 10 * SCALE, baseline, prior)
    assert found is not None
    ids = np.arange(POINTS) + 100
    return ResectionProblem(ids, xyz, seen, found.camera_from_world, SCALE, "left", baseline, guess, prior)


def test_without_the_bus_the_pose_is_the_true_one() -> None:
    for pair in (True, False):
        made = problem(1e-3, pair=pair)
        wrong = made.pose.translation - TRUTH.inverse().translation
        part = Part("group", tracks=tuple(100 + number for number in BUS))
        for found in (*made.shifts((part,)), made.really(part)):
            np.testing.assert_allclose(found.position, wrong, atol=0.02 * float(np.linalg.norm(wrong)))
        assert set(blame(made).of("group")[0].part.tracks) == set(part.tracks)


def test_a_single_track_moved_the_pose_as_leaving_it_out_says() -> None:
    made = problem(2e-4)
    for number in BUS:
        part = Part("track", tracks=(100 + number,))
        (shift,), really = made.shifts((part,)), made.really(part)
        np.testing.assert_allclose(shift.position, really.position, atol=0.1 * really.size)


def test_without_the_prediction_that_pulls_the_pose_is_the_true_one() -> None:
    made = problem(0.0, np.eye(6) * 1e6)
    wrong = made.pose.translation - TRUTH.inverse().translation
    assert np.linalg.norm(wrong) > 1e-4
    (shift,) = made.shifts((Part("prior", MOTION),))
    np.testing.assert_allclose(shift.position, wrong, atol=0.01 * float(np.linalg.norm(wrong)))


def test_too_few_points_give_no_answer() -> None:
    made = problem(0.0)
    (shift,) = made.shifts((Part("group", tracks=tuple(range(100, 100 + POINTS - 5))),))
    assert np.isnan(shift.size)


def test_tracks_that_pull_apart_are_no_group() -> None:
    at = np.array([[0.0, 0.0], [0.01, 0.0], [0.02, 0.0], [1.0, 1.0]])
    pulls = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0.0, 1.0, 0], [1.0, 0, 0]])
    assert groups(at, pulls) == []
    pulls[:3] = [1.0, 0.1, 0]
    assert [rows.tolist() for rows in groups(at, pulls)] == [[0, 1, 2]]


def test_nothing_is_made_where_nobody_listens() -> None:
    made = list[str]()

    def told() -> Problem:
        made.append("told")
        return problem(0.0)

    report_problem(told)
    assert not made
    with collecting_problems() as problems:
        report_problem(told)
    report_problem(told)
    assert len(made) == len(problems) == 1


def test_the_problem_of_a_pose_is_the_last_that_gave_it() -> None:
    from ispom.simulation.cameras import simulated_rig

    rig, first, second = simulated_rig(), problem(1e-3), problem(0.0)
    pose = second.pose @ rig.rig_from("left").inverse()
    assert problem_of([second, first], pose, "rig", rig) is second
    assert problem_of([], pose, "rig", rig) is None
