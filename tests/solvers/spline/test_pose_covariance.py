"""Covariances of poses that were located by unsure points, against finite differences and against made noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.localisation import fit_pose
from ispom.solvers.spline import continuous
from ispom.solvers.spline.continuous import PointUncertainty, Solution, covariance_of, solve
from ispom.solvers.spline.observation import slope
from ispom.solvers.spline.points import point_scores
from ispom.solvers.spline.pose_covariance import pose_covariance
from ispom.solvers.spline.problem import VIDEO, AnchoredPoints, PosePrior, RigModel
from tests.nees import band
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
    found = fit_pose(points.xyz_in_world, seen, (pose @ rig_from_video).inverse(), 1e-4, 1.0)
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
    uncertainty = PointUncertainty(rows, np.eye(10), np.zeros((len(points), 3, 0)), np.zeros((len(points), 10)))
    covariance = pose_covariance(pose, RIG.rig_from_video, True, points, seen, Noise(1e-9, 1e9), uncertainty)
    np.testing.assert_allclose(covariance, np.array(pulls).T @ np.array(pulls), rtol=1e-3, atol=1e-5)


def test_what_observations_share_does_to_a_pose_what_finite_differences_say() -> None:
    (pose, points, seen), rng, eps = scene(), np.random.default_rng(5), 1e-6
    moved, follow = rng.normal(size=(len(points), 2, 1)), 0.1 * rng.normal(size=(len(points), 3, 1))
    values = points.values + eps * follow[:, :, 0]
    pull = relocated(replace(points, values=values), seen + eps * moved[:, :, 0], RIG.rig_from_video, pose) / eps
    uncertainty = PointUncertainty(np.zeros((len(points), 3, 0)), np.zeros((0, 0)), follow, np.zeros((len(points), 0)))
    covariance = pose_covariance(
        pose, RIG.rig_from_video, False, points, seen, Noise(1e-9, 1e9), uncertainty, moved, np.array([[4.0]])
    )
    np.testing.assert_allclose(covariance, 4 * np.outer(pull, pull), rtol=1e-2, atol=1e-4)


def test_points_follow_the_spline_as_finite_differences_say() -> None:
    problem = problem_of(made_flight(0.5, 30))
    found = solve(replace(problem, loss=100.0), 20, 1e-12)
    chosen, held = np.arange(0, len(problem.points), 3), PosePrior(0, Pose(), HELD)
    rows, eps = (
        found.point_uncertainty(chosen, *found.sandwich_covariance(found.parameter_covariance(held))).sensitivity,
        1e-5,
    )

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


def test_what_each_point_adds_makes_up_the_right_side() -> None:
    problem = problem_of(made_flight(0.5, 30), noise_px=0.3)
    free = replace(problem, rig=replace(problem.rig, free=np.ones(7, bool)))
    sampled, o = free.sampled(), free.observations
    _, right, points = continuous._reduced(free, sampled, 0.0)
    pulls = point_scores(continuous._knots(free, sampled), o.exposure, o.owner, points)
    np.testing.assert_allclose(pulls.sum(axis=0), right, atol=1e-9 * np.abs(right).max())


def test_the_slope_of_pulls_is_that_of_finite_differences() -> None:
    errors, step = np.random.default_rng(3).normal(size=(200_000, 2)), np.array([1e-5, 0.0])

    def pulls(moved: Array) -> Array:
        return moved[:, 0] / (1 + (moved**2).sum(axis=1))

    weights = 1 / (1 + (errors**2).sum(axis=1))
    found = (pulls(errors + step) - pulls(errors - step)).mean() / (2 * step[0])
    assert slope(weights, 2) * weights.mean() == pytest.approx(found, rel=0.02)


def test_observations_are_as_far_off_as_they_turn_out_to_be_whatever_their_weights_say() -> None:
    problem, covariances = problem_of(made_flight(0.7, 100), noise_px=0.3), list[Array]()
    o, e, held = problem.observations, len(problem.times_s) // 2, PosePrior(0, Pose(), 1e4 * HELD)
    for claimed in (1.0, 3.0):
        weighed = replace(o, inverse_sigma=claimed * o.inverse_sigma)
        found = solve(replace(problem, observations=weighed, loss=50 * claimed, smoothness=(1e5, 1e5)), 20, 1e-12)
        covariances.append(found.pose_covariance(e, found.sandwich_covariance(found.parameter_covariance(held))[0]))
        if claimed == 1.0:
            by_weights = found.pose_covariance(e, found.parameter_covariance(held))
            assert np.trace(covariances[0] @ np.linalg.inv(by_weights)) / 6 == pytest.approx(1.0, abs=0.35)
    np.testing.assert_allclose(covariances[1], covariances[0], rtol=0.05, atol=0.02 * np.abs(covariances[0]).max())


def held_out(seed: int, claimed: float = 1.0, walk_px: float = 0.0) -> float:
    """NEES of the last video frame, located by the points of a window that it is no part of, relative to a pair.

    Weights claim that video observations are `claimed` times as good as they are. From one observation of a track to
    the next, errors walk by `walk_px`.
    """
    flight = made_flight(0.7, 100)
    problem = problem_of(flight, noise_px=0.3, seed=seed)
    o, last = problem.observations, int(np.flatnonzero(flight.video)[-1])
    o = replace(o, seen=o.seen + np.pad(walks(o.owner, walk_px / RIG.camera("video").fx, seed), ((0, 0), (0, 1))))
    mine = o.exposure == last
    observations = replace(
        o, **{n: getattr(o, n)[~mine] for n in ("exposure", "camera", "owner", "seen", "inverse_sigma")}
    )
    by_video = observations.camera == VIDEO
    better = np.where(by_video[:, None], claimed, 1.0) * observations.inverse_sigma
    observations = replace(observations, inverse_sigma=better)
    found: Solution = solve(replace(problem, observations=observations, loss=50.0), 15, 1e-6)
    pair = int(np.flatnonzero(~flight.video)[-1])
    chosen, points = o.owner[mine], found.problem.points
    points = AnchoredPoints(points.anchors_r[chosen], points.anchors_t[chosen], points.values[chosen])
    reference = Pose(found.sampled.rotations[pair], found.sampled.positions[pair])
    parameters = found.parameter_covariance(PosePrior(pair, reference, HELD))
    uncertainty = found.point_uncertainty(chosen, *found.sandwich_covariance(parameters))
    seen, sigma = o.seen[mine][:, :2], 0.3 / RIG.camera("video").fx / claimed
    guess = Pose(found.sampled.rotations[last], found.sampled.positions[last])
    located = fit_pose(points.xyz_in_world, seen, (guess @ RIG.rig_from_video).inverse(), 50 * sigma, 8 * sigma)
    assert located is not None
    pose = located.camera_from_world.inverse() @ RIG.rig_from_video.inverse()
    covariance = pose_covariance(pose, RIG.rig_from_video, True, points, seen, Noise(sigma, 50.0), uncertainty)
    true = flight.truth(pair).inverse() @ flight.truth(last)
    error = ((reference.inverse() @ pose).inverse() @ true).log()
    return float(error @ np.linalg.solve(covariance, error))


def walks(owner: NDArray[np.int64], step: float, seed: int) -> Array:
    """(O, 2): errors that add up along each track."""
    found = np.random.default_rng(seed).normal(0, step, (len(owner), 2)).cumsum(axis=0)
    return found - found[np.searchsorted(owner, owner)]


@pytest.mark.parametrize(("claimed", "walk_px"), [(1.0, 0.0), (3.0, 0.0), (1.0, 0.2)])
def test_a_frame_outside_the_window_is_as_far_off_as_its_covariance_says(claimed: float, walk_px: float) -> None:
    nees = np.mean([held_out(seed, claimed, walk_px) for seed in range(8)])
    assert nees == pytest.approx(6, abs=2.6)  # the 95 % band of the mean of eight


NOISE = 1e-3


@pytest.mark.parametrize(("alike", "loss"), [(False, 50.0), (False, 1.5), (True, 50.0)])
def test_a_pose_is_as_far_off_as_the_errors_put_it(alike: bool, loss: float) -> None:
    """Where they are independent, where the loss is no wider than they are, and where neighbours share them."""
    pose, points, exact = scene(150)
    camera_from_world, nees = (pose @ RIG.rig_from_video).inverse(), list[float]()
    of_nothing = PointUncertainty(np.zeros((150, 3, 0)), np.zeros((0, 0)), np.zeros((150, 3, 0)), np.zeros((150, 0)))
    _, patch = np.unique(np.floor(exact / 0.1).astype(int), axis=0, return_inverse=True)
    for seed in range(60):
        errors = NOISE * np.random.default_rng(seed).normal(size=exact.shape)
        seen = exact + (errors[patch.reshape(-1)] if alike else errors)
        found = fit_pose(points.xyz_in_world, seen, camera_from_world, loss * NOISE, 1.0)
        assert found is not None
        located = found.camera_from_world.inverse() @ RIG.rig_from_video.inverse()
        covariance = pose_covariance(located, RIG.rig_from_video, False, points, seen, Noise(NOISE, loss), of_nothing)
        error = (located.inverse() @ pose).log()
        nees.append(float(error @ np.linalg.solve(covariance, error)))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high


def test_where_the_loss_is_no_minimum_weights_are_held() -> None:
    (pose, points, exact), rng = scene(9), np.random.default_rng(0)
    seen = exact + 0.1 * rng.normal(size=exact.shape)
    nothing = PointUncertainty(np.zeros((9, 3, 0)), np.zeros((0, 0)), np.zeros((9, 3, 0)), np.zeros((9, 0)))
    covariance = pose_covariance(pose, RIG.rig_from_video, False, points, seen, Noise(NOISE), nothing)
    assert np.isfinite(covariance).all() and (np.linalg.eigvalsh(covariance) > 0).all()


def test_what_was_never_seen_has_a_large_variance_and_a_finite_one() -> None:
    seen = np.random.default_rng(0).normal(size=(9, 6))
    np.testing.assert_allclose(covariance_of(seen.T @ seen), np.linalg.inv(seen.T @ seen), rtol=1e-9)
    unseen = np.zeros((8, 8))
    unseen[:6, :6] = seen.T @ seen
    found = covariance_of(unseen)
    np.testing.assert_allclose(found[:6, :6], np.linalg.inv(seen.T @ seen), rtol=1e-4)
    assert (found.diagonal()[6:] > 1e5).all() and (found.diagonal()[6:] < 1e7).all()


def test_a_point_left_out_moves_the_spline_as_it_says() -> None:
    problem = replace(problem_of(made_flight(0.5, 80), noise_px=0.3), loss=50.0)
    found, o, e = solve(problem, 30, 1e-14), problem.observations, len(problem.times_s) - 1
    _, moves = found.sandwich_covariance(found.parameter_covariance(problem.prior))
    jacobian = found.sampled.jacobian(e, len(problem.spline))[3:]
    for point in range(0, len(problem.points), 16):
        kept = o.owner != point
        rest = {n: getattr(o, n)[kept] for n in ("exposure", "camera", "owner", "seen", "inverse_sigma")}
        without = solve(replace(found.problem, observations=replace(o, **rest)), 30, 1e-14)
        off = found.sampled.positions[e] - without.sampled.positions[e]
        told = jacobian @ moves[point, : jacobian.shape[1]]
        np.testing.assert_allclose(told, off, rtol=0, atol=0.12 * np.linalg.norm(off))
