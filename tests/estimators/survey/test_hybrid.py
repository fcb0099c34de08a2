"""The hybrid method: its three steps on a plane under known poses, then pairs, a lost camera, and real pairs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.survey.hybrid import HybridConfig, Memory, feature_alignment, refined, sparse_alignment
from ispom.evaluation.metrics import path_errors
from ispom.geometry import Pose, rotation_angle_rad
from ispom.sequences import open_sequence
from ispom.types import Frame, Rig, Status, TrackStatus
from tests.estimators.survey.scenes import CAMERA, seen

DATA = Path(__file__).parents[4] / "shared" / "data"
RIG = Rig.stereo(CAMERA, 0.3)


def pair(k: int, gain: float = 1.0) -> tuple[Pose, Frame]:
    """Returns the pose of the rig and its pair; the rig moves by 10 cm and rotates by 0.6 degrees each time."""
    pose = Pose.from_rotvec(k * np.array([0.002, -0.01, 0.003]), k * np.array([0.05, 0.01, 0.08]))
    images = [seen(pose @ RIG.rig_from(name))[0] for name in ("left", "right")]
    return pose, Frame.stereo(k * 100_000_000, *(np.rint(gain * i).astype(np.uint8) for i in images))


def degrees(pose: Pose) -> float:
    return float(np.degrees(rotation_angle_rad(pose.rotation)))


@pytest.fixture(scope="module")
def memory() -> Memory:
    """The memory after one pair, with exact points."""
    estimator = HybridConfig().build(RIG)
    state, _ = estimator.step(estimator.start(), pair(0)[1])
    assert state.memory is not None
    points, pose = state.memory.points, state.memory.world_from_camera
    depth = seen(pose)[1][np.rint(points.uv[:, 1]).astype(int), np.rint(points.uv[:, 0]).astype(int)]
    rays = np.column_stack([CAMERA.normalise(points.uv), np.ones(len(points))])
    return replace(state.memory, points=replace(points, xyz=pose.apply(depth[:, None] * rays)))


def test_each_step_comes_nearer_to_the_truth(memory: Memory) -> None:
    truth, frame = pair(1)
    true_pose = truth @ RIG.rig_from("left")
    motion, similar = sparse_alignment(memory, CAMERA, frame.left, frame.time_ns)
    assert similar.passed
    assert np.linalg.norm((true_pose.inverse() @ motion).translation) < 3e-3
    assert degrees(true_pose.inverse() @ motion) < 0.03

    uv, found = feature_alignment(memory, CAMERA, frame.left, motion)
    expected = CAMERA.project(true_pose.inverse().apply(memory.points.xyz))
    assert found.mean() > 0.8
    assert np.median(np.linalg.norm(uv - expected, axis=1)[found]) < 0.05

    fit = refined(memory.points, CAMERA, uv, found, motion, 2.0)
    assert fit is not None
    error = fit.camera_from_world @ true_pose
    assert np.linalg.norm(error.translation) < 1.5e-3
    assert degrees(error) < 0.02


def test_features_are_found_from_a_motion_that_is_some_pixels_off(memory: Memory) -> None:
    truth, frame = pair(1)
    true_pose = truth @ RIG.rig_from("left")
    wrong = true_pose @ Pose.from_rotvec(np.radians([0.2, -0.3, 0.1]), np.array([0.005, 0.0, 0.01]))
    uv, found = feature_alignment(memory, CAMERA, frame.left, wrong)
    expected = CAMERA.project(true_pose.inverse().apply(memory.points.xyz))
    assert found.mean() > 0.8
    assert np.median(np.linalg.norm(uv - expected, axis=1)[found]) < 0.05
    fit = refined(memory.points, CAMERA, uv, found, wrong, 2.0)
    assert fit is not None and degrees(fit.camera_from_world @ true_pose) < 0.02


def test_pairs_give_a_metric_path_in_spite_of_exposure_and_a_dark_one_is_lost() -> None:
    estimator = HybridConfig().build(RIG)
    state = estimator.start()
    for k in range(6):
        truth, frame = pair(k, 1.0 if k % 2 else 0.85)
        state, step = estimator.step(state, frame)
        assert step.world_from_frame is not None
        error = truth.inverse() @ step.world_from_frame
        assert np.linalg.norm(error.translation) < 0.015 * max(0.5, float(np.linalg.norm(truth.translation)))
        assert degrees(error) < 0.1
        assert (step.tracks["left"].status == TrackStatus.ALIVE).sum() >= 20 or k == 0
    dark = Frame.stereo(10**9, np.full((240, 320), 5, np.uint8), np.full((240, 320), 5, np.uint8))
    _, step = estimator.step(state, dark)
    assert step.status is Status.LOST and step.world_from_frame is None


def test_a_pair_without_texture_makes_no_map() -> None:
    estimator = HybridConfig().build(RIG)
    blank = np.full((240, 320), 90, np.uint8)
    _, step = estimator.step(estimator.start(), Frame.stereo(0, blank, blank))
    assert step.status is Status.INITIALISING and not step.decisions[0].passed


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "kitti").is_dir(), reason="the KITTI recording is not in ../shared/data")
def test_drift_on_kitti() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    estimator = HybridConfig().build(sequence.rig)
    state = estimator.start()
    for i in range(len(sequence)):
        if sequence.kinds[i] == "stereo":
            state, step = estimator.step(state, sequence[i])
            assert step.world_from_frame is not None
    assert sequence.truth is not None
    assert path_errors(estimator.finish(state), sequence.truth, sequence.rig, True)["t_err_percent"] < 2.0
