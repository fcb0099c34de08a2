"""The hybrid method with one camera: a plane under known poses, pure rotation, a loss, and real images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.survey.hybrid import Keyframe
from ispom.estimators.survey.hybrid_monocular import HybridMonocularConfig, adjusted
from ispom.evaluation.metrics import path_errors
from ispom.evaluation.trajectory_error import trajectory_error
from ispom.geometry import Pose, rotation_angle_rad
from ispom.sequences import open_sequence
from ispom.types import Frame, Rig, Status, Step, Trajectory
from tests.alone import stepped_through
from tests.estimators.survey.scenes import CAMERA, arc, seen

DATA = Path(__file__).parents[4] / "shared" / "data"
COUNT = 16


def run(frames: list[Frame]) -> tuple[list[Step], Trajectory]:
    estimator = HybridMonocularConfig().build(Rig.single(CAMERA))
    state, steps = stepped_through(estimator, frames)
    return steps, estimator.finish(state)


def video(k: int, world_from_camera: Pose) -> Frame:
    return Frame.video(k * 100_000_000, seen(world_from_camera)[0])


def test_the_path_before_a_plane_is_right_up_to_scale() -> None:
    steps, found = run([video(k, arc(k)) for k in range(COUNT)])
    assert steps[0].status is Status.INITIALISING
    first = next(i for i, step in enumerate(steps) if step.status is Status.TRACKING)
    assert first < 10 and all(step.status is Status.TRACKING for step in steps[first:])
    truth = Trajectory.of([(k * 100_000_000, arc(k)) for k in range(COUNT)], "video")
    error = trajectory_error(found, truth, "sim3")
    assert error is not None and len(error.estimate) == COUNT - first
    assert error.ate_m < 0.01 * truth.length
    # Relative to the first pose: positions on a short arc leave the rotation about it open.
    turned, true = (np.swapaxes(r, 1, 2) @ r[0] for r in (error.estimate.rotations, error.reference.rotations))
    assert np.degrees(rotation_angle_rad(np.swapaxes(true, 1, 2) @ turned)).max() < 0.2
    assert any(decision.key == "seeds_converged" and decision.passed for step in steps for decision in step.decisions)


def test_exact_observations_give_exact_keyframes_and_points() -> None:
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(-2, 2, (60, 2)), rng.uniform(4, 9, 60)])
    poses = [arc(4 * k) for k in range(4)]
    seen_uv = np.stack([CAMERA.project(p.inverse().apply(xyz)) for p in poses], axis=1).astype(np.float32)
    seen_uv[:20, 1] = np.nan
    wrong = [p @ Pose.from_rotvec(rng.normal(0, 3e-3, 3), rng.normal(0, 0.01, 3)) for p in poses[2:]]
    image = np.zeros((4, 4), np.uint8)
    keyframes = tuple(Keyframe(i, image, p) for i, p in enumerate([*poses[:2], *wrong]))
    found, points, keep = adjusted(keyframes, xyz + rng.normal(0, 0.02, xyz.shape), seen_uv, CAMERA, 1.0)
    assert keep.all()
    np.testing.assert_allclose(points, xyz, atol=2e-3)
    assert all(np.linalg.norm((a.inverse() @ b).log()) < 1e-3 for a, b in zip(found, poses, strict=True))


def test_a_pure_rotation_gives_no_map() -> None:
    turning = [Pose.from_rotvec(np.array([0.0, 0.01 * k, 0.002 * k]), np.zeros(3)) for k in range(10)]
    steps, found = run([video(k, p) for k, p in enumerate(turning)])
    assert all(step.status is Status.INITIALISING for step in steps) and not len(found)


def test_after_dark_frames_a_new_segment_begins() -> None:
    dark = np.full((240, 320), 5, np.uint8)
    frames = [video(k, arc(k)) for k in range(10)]
    frames += [Frame.video(k * 100_000_000, dark) for k in range(10, 17)]
    frames += [video(k, arc(k - 17)) for k in range(17, 28)]
    steps, _ = run(frames)
    assert steps[9].status is Status.TRACKING
    assert all(step.status is Status.LOST and step.world_from_frame is None for step in steps[10:17])
    again = next(step for step in steps[17:] if step.status is Status.TRACKING)
    assert again.restarted


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "handheld_board").is_dir(), reason="the recording is not in ../shared/data")
def test_a_handheld_camera_over_a_board() -> None:
    sequence = open_sequence(str(DATA / "handheld_board"))
    estimator = HybridMonocularConfig().build(sequence.rig)
    state = estimator.start()
    for i in range(len(sequence)):
        state, _ = estimator.step(state, sequence[i])
    assert sequence.truth is not None
    found = estimator.finish(state)
    assert len(found) > 200
    assert path_errors(found, sequence.truth, sequence.rig, False)["ate_m"] < 0.002
