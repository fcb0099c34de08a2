"""Trifocal transfer: exact on exact points, in spite of outliers, and on simulated and real pairs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.ensemble import build
from ispom.estimators.survey.trifocal import (
    Expected,
    Views,
    changes_of,
    errors_of,
    filtered,
    normal_equations,
    pose_of,
    predictions,
    ransac,
    transferred,
    trifocal_tensor,
)
from ispom.estimators.survey.trifocal_covariance import Changes
from ispom.evaluation.metrics import path_errors
from ispom.geometry import Array, Pose
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.types import Sequence, Status
from tests.alone import alone, run
from tests.rounds import SCENARIOS, rig, world_from_rig

KITTI = Path("../shared/data/kitti/sequences/06")
BASELINE_M, LIMIT = 0.4, 2e-3
MOTION = np.array([0.05, -0.02, 0.8, 0.01, -0.03, 0.02])
UNKNOWN = Expected(np.zeros(6), 1e6 * np.eye(6))


def normalised(xyz: Array) -> Array:
    return xyz[:, :2] / xyz[:, 2:]


def exact_views(count: int = 80, seed: int = 0) -> Views:
    """Points at 4 to 30 m, seen by both cameras before and after MOTION."""
    xyz = np.random.default_rng(seed).uniform((-6, -4, 4), (6, 4, 30), (count, 3))
    offset, now = np.array([BASELINE_M, 0, 0]), pose_of(MOTION).inverse().apply(xyz)
    return Views(normalised(xyz), normalised(xyz - offset), normalised(now), normalised(now - offset), BASELINE_M)


def test_the_tensor_transfers_exact_observations_exactly() -> None:
    views, camera_from_before = exact_views(), pose_of(MOTION).inverse()
    tensor = trifocal_tensor(camera_from_before.rotation, camera_from_before.translation, BASELINE_M)
    np.testing.assert_allclose(transferred(tensor, views), views.left, atol=1e-12)
    np.testing.assert_allclose(predictions(MOTION, views), np.hstack([views.left, views.right]), atol=1e-12)


def test_the_tensor_is_that_of_hartley() -> None:
    # T_i^jk = a_i^j c_4^k - a_4^j c_i^k, with P' = [A | a_4] and P'' = [C | c_4].
    pose = pose_of(MOTION)
    second, third = np.column_stack([np.eye(3), [-BASELINE_M, 0, 0]]), pose.matrix[:3]
    expected = [np.outer(second[:, i], third[:, 3]) - np.outer(second[:, 3], third[:, i]) for i in range(3)]
    np.testing.assert_allclose(trifocal_tensor(pose.rotation, pose.translation, BASELINE_M), expected, atol=1e-15)


def test_points_behind_the_camera_are_no_inliers() -> None:
    assert (errors_of(np.array([0, 0, 100.0, 0, 0, 0]), exact_views()) > 100).all()


def test_the_gradient_is_zero_at_the_motion_and_the_information_is_positive() -> None:
    information, gradient = normal_equations(MOTION, exact_views(), 1e-3)
    np.testing.assert_allclose(gradient, 0, atol=1e-4)
    assert np.linalg.eigvalsh(information)[0] > 0


def test_ransac_finds_the_motion_among_outliers() -> None:
    views, rng = exact_views(120), np.random.default_rng(1)
    left, right = views.left.copy(), views.right.copy()
    left[:50] += rng.uniform(-0.2, 0.2, (50, 2))
    right[:50] += rng.uniform(-0.2, 0.2, (50, 2))
    spoilt = Views(views.left_before, views.right_before, left, right, BASELINE_M)
    sampled = ransac(spoilt, np.zeros(6), LIMIT)
    np.testing.assert_allclose(sampled, MOTION, atol=1e-3)
    motion, covariance, left_over = filtered(spoilt, UNKNOWN, sampled, LIMIT, 5e-4)
    np.testing.assert_allclose(motion, MOTION, atol=1e-6)
    assert (left_over[50:] < 1e-6).all()
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_the_filter_keeps_to_its_prediction_as_much_as_it_is_sure() -> None:
    views = exact_views()
    motion, covariance, _ = filtered(views, Expected(MOTION + 0.01, 1e-16 * np.eye(6)), MOTION, 0.1, 1e-3)
    np.testing.assert_allclose(motion, MOTION + 0.01, atol=1e-6)
    assert (np.diag(covariance) <= 1e-16).all()
    nothing = views[np.zeros(0, int)]
    motion, covariance, _ = filtered(nothing, Expected(MOTION, np.eye(6)), MOTION, LIMIT, 1e-3)
    np.testing.assert_allclose(motion, MOTION)
    np.testing.assert_allclose(covariance, np.eye(6))


class NoisyTracks:
    """Points at 6 to 40 m, followed over pairs by searches with independent errors of the size `noise`.

    Where a point is found is where it is followed on from, and the right observation is searched from there. The
    disparity of each point may have an error that stays, `lasting`.
    """

    def __init__(self, rng: np.random.Generator, noise: float, lasting: float = 0.0, count: int = 100) -> None:
        self.xyz = rng.uniform((-6, -4, 6), (6, 4, 40), (count, 3))
        self.rng, self.noise, self.offset = rng, noise, rng.normal(0, lasting, count)
        self.left = normalised(self.xyz)
        self.right = self._matched()

    def views(self) -> Views:
        """Moves on by MOTION."""
        before = self.left, self.right
        self.xyz = pose_of(MOTION).inverse().apply(self.xyz)
        self.left = normalised(self.xyz) + self.rng.normal(0, self.noise, self.left.shape)
        self.right = self._matched()
        self.xyz = np.column_stack([self.left, np.ones(len(self.left))]) * self.xyz[:, 2:]
        return Views(*before, self.left, self.right, BASELINE_M)

    def _matched(self) -> Array:
        disparity = BASELINE_M / self.xyz[:, 2] + self.offset
        found = self.left - np.column_stack([disparity, 0 * disparity])
        return found + self.rng.normal(0, self.noise, found.shape)


def mean_nees(errors: list[Array], covariances: list[Array]) -> float:
    """6 is right."""
    return float(np.mean([e @ np.linalg.solve(p, e) for e, p in zip(errors, covariances, strict=True)]))


def test_the_noise_of_observations_gives_the_stated_covariance() -> None:
    rng, noise, errors, stated, by_tracks = np.random.default_rng(3), 2e-4, [], [], []
    for _ in range(60):
        views = NoisyTracks(rng, noise).views()
        motion, covariance, _ = filtered(views, UNKNOWN, MOTION, 0.1, noise)
        changes, by_prediction = changes_of(views, 500 * views.left, motion, UNKNOWN, noise)
        errors.append(motion - MOTION)
        stated.append(covariance)
        by_tracks.append(changes.T @ changes + by_prediction)
    assert 4.5 < mean_nees(errors, stated) < 7.5  # chi-square of 6 degrees of freedom
    assert 4.5 < mean_nees(errors, by_tracks) < 7.5


@pytest.mark.parametrize("lasting", [0.0, 3e-4])
def test_errors_that_steps_share_are_in_the_covariance_of_the_path(lasting: float) -> None:
    """Each disparity is used by two steps, and a part of its error by all of them."""
    rng, noise, errors, stated = np.random.default_rng(4), 2e-4, [], []
    step = pose_of(MOTION)
    to_twist = Pose(step.rotation.T).adjoint
    for _ in range(40):
        tracks, pose, changes = NoisyTracks(rng, noise, lasting), Pose(), Changes()
        for _ in range(6):
            views = tracks.views()
            motion, _, _ = filtered(views, UNKNOWN, MOTION, 0.1, 5e-4)
            by_tracks, by_prediction = changes_of(views, 500 * views.left, motion, UNKNOWN, 5e-4)
            by_prediction = to_twist @ by_prediction @ to_twist.T
            changes = changes.after(pose_of(motion), np.arange(len(views)), by_tracks @ to_twist.T, by_prediction)
            pose = pose @ pose_of(motion)
        true = Pose()
        for _ in range(6):
            true = true @ step
        errors.append((pose.inverse() @ true).log())
        stated.append(changes.covariance)
    assert 4.5 < mean_nees(errors, stated) < 7.5


def test_tracks_that_end_keep_what_they_changed() -> None:
    rng = np.random.default_rng(0)
    first, second, none = rng.normal(size=(3, 6)), rng.normal(size=(2, 6)), np.zeros((6, 6))
    once = Changes().after(Pose(), np.array([1, 4, 6]), first, none)
    twice = once.after(Pose(), np.array([4, 9]), second, none)
    expected = np.array([first[0], first[1] + second[0], first[2], second[1]])
    np.testing.assert_allclose(twice.covariance, expected.T @ expected, atol=1e-12)
    np.testing.assert_allclose(twice.ended().covariance, twice.covariance)
    turned = twice.after(pose_of(MOTION), np.zeros(0, int), np.zeros((0, 6)), none).covariance
    along = pose_of(MOTION).inverse().adjoint
    np.testing.assert_allclose(turned, along @ twice.covariance @ along.T)


def test_pairs_of_a_round_trip() -> None:
    scenario = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"stereo"})
    sequence = scenario.sequence(40)
    steps = list(run(alone("trifocal", rig()), (sequence[i] for i in range(len(sequence)))))
    assert all(step.status is Status.TRACKING for step in steps)
    pose = steps[-1].world_from_frame
    assert pose is not None
    true = world_from_rig(0).inverse() @ world_from_rig(39)
    error = true.inverse() @ pose
    path_m = 39 * np.linalg.norm(world_from_rig(1).translation)
    assert np.linalg.norm(error.translation) < 0.08 * path_m  # images of 160 x 120 pixels: one pixel is half a degree
    assert steps[-1].covariance is not None and np.trace(steps[-1].covariance) > 0


def test_a_loss_begins_a_new_segment_at_the_last_pose() -> None:
    scenario = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"stereo"})
    sequence, steps = scenario.sequence(20), []
    method = alone("trifocal", rig())
    state = method.start()
    for i in range(20):
        pair = sequence[i]
        if i in (8, 9):  # nothing like the others
            pair = pair.with_images(left=pair.left[::-1, ::-1].copy(), right=pair.right[::-1, ::-1].copy())  # type: ignore[attr-defined]
        state, step = method.step(state, pair)
        steps.append(step)
    assert [s.status for s in steps[7:11]] == [Status.TRACKING, Status.LOST, Status.LOST, Status.TRACKING]
    assert not any(s.restarted for s in steps)
    far = [s.world_from_frame.translation for s in (steps[7], steps[10]) if s.world_from_frame]
    assert 2 < np.linalg.norm(far[1] - far[0]) / np.linalg.norm(world_from_rig(1).translation) < 4


def figures(sequence: Sequence) -> dict:
    ensemble = build(Config(), ("trifocal",), sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    assert sequence.truth is not None
    return path_errors(ensemble.finish(state)["trifocal"], sequence.truth, sequence.rig, True)


@pytest.mark.skipif(not KITTI.is_dir(), reason="KITTI 06 is not in ../shared/data")
def test_kitti_06() -> None:
    assert figures(open_sequence(str(KITTI)))["t_err_percent"] < 2.0
