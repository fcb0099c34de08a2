"""Covariances of poses that were located by unsure points, against finite differences and against made noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.resection import refine_pose
from ispom.solvers.spline import continuous
from ispom.solvers.spline.continuous import PointUncertainty, Solution, covariance_of, solve
from ispom.solvers.spline.pose_covariance import pose_covariance
from ispom.solvers.spline.problem import VIDEO, AnchoredPoints, PosePrior, RigModel
from tests.solvers.made_flight import RIG, made_flight, problem_of

HELD = np.eye(6) * 1e10


def scene(count: int = 12) -> tuple[Pose, AnchoredPoints, Array]:
    """A pose of the rig, points anchored elsewhere, and where the video camera sees them."""
    rng, pose = np.random.default_rng(4), Pose.exp(np.array([0.3, -0.2, 0.5, 0.1, -0.2, 0.05]))
    values = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.05, 0.3, count)])
    anchor = Pose.exp(np.array([0.1, 0.1, -0.3, 0.02, 0.03, -0.04])) @ RIG.rig_from_video
    points = AnchoredPoints(
        np.repeat(anchor.rotation[None], count, 0), np.repeat(anchor.translation[None], count, 0), values
    )
    x = (pose @ RIG.rig_from_video).inverse().apply(points.xyz_in_world)
    return pose, points, x[:, :2] / x[:, 2:]


def relocated(points: AnchoredPoints, seen: Array, rig_from_video: Pose, pose: Pose) -> Array:
    """(6,) twist on the right of `pose` that leads to where other points, or another rig, put it."""
    found = refine_pose(points.xyz_in_world, seen, (pose @ rig_from_video).inverse(), 1.0, 30)
    assert found is not None
    return (pose.inverse() @ found.camera_from_world.inverse() @ rig_from_video.inverse()).log()


def test_what_points_and_rig_do_to_a_pose_is_that_of_finite_differences() -> None:
    pose, points, seen = scene()
    eps, pulls = 1e-6, []
    for k in range(3):
        values = points.values.copy()
        values[2, k] += eps
        pulls.append(relocated(replace(points, values=values), seen, RIG.rig_from_video, pose) / eps)
    model = RigModel(RIG.rig_from_video, RIG.rig_from_left, RIG.baseline_m, 0.0, np.eye(7), np.ones(7, bool))
    for k in range(6):
        pulls.append(relocated(points, seen, model.moved(eps * np.eye(7)[k]).rig_from_video, pose) / eps)
    rows = np.zeros((len(points), 3, 3 + 7))
    rows[2, :, :3] = np.eye(3)
    uncertainty = PointUncertainty(rows, np.zeros((len(points), 3, 3)), np.eye(10), np.zeros((len(points), 3, 0)))
    covariance = pose_covariance(pose, RIG.rig_from_video, True, points, seen, 1e-9, 1e9, uncertainty)
    np.testing.assert_allclose(covariance, np.array(pulls).T @ np.array(pulls), rtol=1e-3, atol=1e-5)


def test_what_observations_share_does_to_a_pose_what_finite_differences_say() -> None:
    (pose, points, seen), rng, eps = scene(), np.random.default_rng(5), 1e-6
    moved, follow = rng.normal(size=(len(points), 2, 1)), 0.1 * rng.normal(size=(len(points), 3, 1))
    values = points.values + eps * follow[:, :, 0]
    pull = relocated(replace(points, values=values), seen + eps * moved[:, :, 0], RIG.rig_from_video, pose) / eps
    none = np.zeros((len(points), 3, 3))
    uncertainty = PointUncertainty(none[:, :, :0], none, np.zeros((0, 0)), follow)
    covariance = pose_covariance(
        pose, RIG.rig_from_video, False, points, seen, 1e-9, 1e9, uncertainty, 1.0, moved, np.array([[4.0]])
    )
    np.testing.assert_allclose(covariance, 4 * np.outer(pull, pull), rtol=1e-2, atol=1e-4)


def test_points_follow_the_spline_as_finite_differences_say() -> None:
    problem = problem_of(made_flight(0.5, 30))
    found = solve(replace(problem, loss=100.0), 20, 1e-12)
    chosen, held = np.arange(0, len(problem.points), 3), PosePrior(0, Pose(), HELD)
    rows, eps = found.point_uncertainty(chosen, found.parameter_covariance(held)).sensitivity, 1e-5

    def wanted(knot: int, sign: int) -> Array:
        step = np.zeros(6 * len(problem.spline))
        step[knot] = sign * eps
        moved = replace(found.problem, spline=found.problem.spline.moved(step))
        _, _, (inverses, sides, *_) = continuous._normal_equations(moved, moved.sampled(), 0.0)
        return np.einsum("mij,mj->mi", inverses, sides)[chosen]

    for knot in (3, 14, 25, 40):
        difference = (wanted(knot, 1) - wanted(knot, -1)) / (2 * eps)
        np.testing.assert_allclose(difference, rows[:, :, knot], rtol=2e-2, atol=1e-3 * np.abs(rows[:, :, knot]).max())


def test_all_follows_what_moves_the_observations_as_finite_differences_say() -> None:
    problem, eps = replace(problem_of(made_flight(0.5, 30)), loss=100.0), 1e-5
    found, o = solve(problem, 20, 1e-14), problem.observations
    moved = np.where((o.camera == VIDEO)[:, None], o.seen, 0.0)
    step, points = found.follows(moved[:, :, None], found.parameter_covariance(problem.prior))
    again = solve(replace(found.problem, observations=replace(o, seen=o.seen + eps * moved)), 20, 1e-14)
    change = (again.problem.points.values - found.problem.points.values) / eps
    np.testing.assert_allclose(points[:, :, 0], change, rtol=2e-2, atol=2e-2 * np.abs(change).max())
    e = len(problem.times_s) - 1
    shift = (again.sampled.positions[e] - found.sampled.positions[e]) / eps
    followed = (found.sampled.jacobian(e, len(problem.spline)) @ step[:-7, 0])[3:]
    np.testing.assert_allclose(followed, shift, rtol=2e-2, atol=2e-2 * np.abs(shift).max())


def test_points_as_noisy_as_their_weights_say_leave_the_covariance() -> None:
    problem = problem_of(made_flight(0.5, 30), noise_px=0.3)
    found = solve(problem, 20, 1e-9)
    parameters, ones = found.parameter_covariance(problem.prior), np.ones(len(problem.points))
    limit = 1e-6 * np.abs(parameters).max()
    np.testing.assert_allclose(found.as_noisy_as(ones, parameters), parameters, rtol=1e-6, atol=limit)
    more = found.as_noisy_as(2 * ones, parameters) - parameters
    assert np.linalg.eigvalsh((more + more.T) / 2)[0] > -limit
    np.testing.assert_allclose(found.as_noisy_as(3 * ones, parameters) - parameters, 2 * more, rtol=1e-6, atol=limit)


def held_out(seed: int, claimed: float = 1.0) -> float:
    """NEES of the last video frame, located by the points of a window that it is no part of, relative to a pair.

    Weights `claim` video observations to be so many times as good as they are.
    """
    flight = made_flight(0.7, 100)
    problem = problem_of(flight, noise_px=0.3, seed=seed)
    o, last = problem.observations, int(np.flatnonzero(flight.video)[-1])
    mine = o.exposure == last
    observations = replace(
        o, **{n: getattr(o, n)[~mine] for n in ("exposure", "camera", "owner", "seen", "inverse_sigma")}
    )
    by_video = observations.camera == VIDEO
    better = np.where(by_video[:, None], claimed, 1.0) * observations.inverse_sigma
    observations = replace(observations, inverse_sigma=better)
    variances = np.ones(len(problem.points))
    variances[observations.owner[by_video]] = claimed**2
    found: Solution = solve(replace(problem, observations=observations, loss=50.0), 15, 1e-6)
    pair = int(np.flatnonzero(~flight.video)[-1])
    chosen, points = o.owner[mine], found.problem.points
    points = AnchoredPoints(points.anchors_r[chosen], points.anchors_t[chosen], points.values[chosen])
    reference = Pose(found.sampled.rotations[pair], found.sampled.positions[pair])
    parameters = found.parameter_covariance(PosePrior(pair, reference, HELD))
    uncertainty = found.point_uncertainty(chosen, found.as_noisy_as(variances, parameters))
    uncertainty = replace(uncertainty, conditional=uncertainty.conditional * variances[chosen, None, None])
    seen, sigma = o.seen[mine][:, :2], 0.3 / RIG.camera("video").fx / claimed
    guess = Pose(found.sampled.rotations[last], found.sampled.positions[last])
    located = refine_pose(
        points.xyz_in_world, seen, (guess @ RIG.rig_from_video).inverse(), 8 * sigma, scale=50 * sigma
    )
    assert located is not None
    pose = located.camera_from_world.inverse() @ RIG.rig_from_video.inverse()
    covariance = pose_covariance(pose, RIG.rig_from_video, True, points, seen, sigma, 50.0, uncertainty, claimed**2)
    true = flight.truth(pair).inverse() @ flight.truth(last)
    error = ((reference.inverse() @ pose).inverse() @ true).log()
    return float(error @ np.linalg.solve(covariance, error))


def test_a_frame_outside_the_window_is_as_far_off_as_its_covariance_says() -> None:
    nees = np.mean([held_out(seed) for seed in range(8)])
    assert nees == pytest.approx(6, abs=2.6)  # the 95 % band of the mean of eight


def test_it_is_also_where_weights_take_one_camera_for_better_than_it_is() -> None:
    nees = np.mean([held_out(seed, 3.0) for seed in range(8)])
    assert nees == pytest.approx(6, abs=2.6)


def test_what_was_never_seen_has_a_large_variance_and_a_finite_one() -> None:
    seen = np.random.default_rng(0).normal(size=(9, 6))
    np.testing.assert_allclose(covariance_of(seen.T @ seen), np.linalg.inv(seen.T @ seen), rtol=1e-9)
    unseen = np.zeros((8, 8))
    unseen[:6, :6] = seen.T @ seen
    found = covariance_of(unseen)
    np.testing.assert_allclose(found[:6, :6], np.linalg.inv(seen.T @ seen), rtol=1e-4)
    assert (found.diagonal()[6:] > 1e5).all() and (found.diagonal()[6:] < 1e7).all()
