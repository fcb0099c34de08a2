"""The direct method with one camera: a plane under known poses, with noise, pure rotation, rest, and a loss."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.modern.monocular.keyframe import MAX_SCALE_GROWTH
from ispom.estimators.survey import direct_monocular
from ispom.estimators.survey.depth_alignment import Joint, jointly_aligned
from ispom.estimators.survey.depth_field import LINE_PX, DepthField
from ispom.estimators.survey.direct_monocular import DirectMonocularConfig
from ispom.evaluation.metrics import path_errors
from ispom.evaluation.trajectory_error import trajectory_error
from ispom.geometry import Pose
from ispom.sequences import open_sequence
from ispom.types import Camera, Frame, Image, Rig, Status, Step, Trajectory
from tests.alone import stepped_through
from tests.estimators.survey.scenes import CAMERA, arc, seen

DATA = Path(__file__).parents[4] / "shared" / "data"
COUNT = 14


def run(frames: list[Frame], keyframe_moved: float = 8.0) -> tuple[list[Step], Trajectory]:
    estimator = DirectMonocularConfig(max_points=800, keyframe_moved=keyframe_moved).build(Rig.single(CAMERA))
    state, steps = stepped_through(estimator, frames)
    return steps, estimator.finish(state)


def video(k: int, world_from_camera: Pose, noise: float = 0.0) -> Frame:
    image = seen(world_from_camera)[0] + np.random.default_rng(k).normal(0, noise, (240, 320))
    return Frame.video(k * 100_000_000, np.clip(np.rint(image), 0, 255).astype(np.uint8))


@pytest.mark.parametrize(("noise", "share"), [(0.0, 0.01), (1.0, 0.03)])
def test_the_path_before_a_plane_is_right_up_to_scale(noise: float, share: float) -> None:
    steps, found = run([video(k, arc(k), noise) for k in range(COUNT)])
    assert steps[0].status is Status.INITIALISING
    first = next(i for i, step in enumerate(steps) if step.status is Status.TRACKING)
    assert first < 10 and all(step.status is Status.TRACKING for step in steps[first:])
    truth = Trajectory.of([(k * 100_000_000, arc(k)) for k in range(COUNT)], "video")
    error = trajectory_error(found, truth, "sim3")
    assert error is not None and len(error.estimate) == COUNT - first
    assert error.ate_m < share * truth.length


def test_the_unit_is_the_distance_of_the_images_of_the_start() -> None:
    steps, _ = run([video(k, arc(k)) for k in range(10)])
    first = next(step for step in steps if step.status is Status.TRACKING)
    assert first.world_from_frame is not None and first.key_frame
    assert np.linalg.norm(first.world_from_frame.translation) == pytest.approx(1)


@pytest.mark.parametrize("rate", [0.01, 0.0], ids=["rotation", "rest"])
def test_without_a_displacement_there_is_no_start(rate: float) -> None:
    turning = [Pose.from_rotvec(np.array([0.0, rate * k, 0.2 * rate * k]), np.zeros(3)) for k in range(10)]
    steps, found = run([video(k, p, 1.0) for k, p in enumerate(turning)])
    assert all(step.status is Status.INITIALISING for step in steps) and not len(found)
    assert all(not step.decisions[-1].passed for step in steps)


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


def test_ids_of_pixels_are_unique() -> None:
    steps, _ = run([video(k, arc(k)) for k in range(12)], 1.0)
    keys = [step for step in steps if step.key_frame]
    assert len(keys) > 1
    for step in keys:
        assert len(set(step.landmarks.ids.tolist())) == len(step.landmarks.ids) > 0


def test_a_pose_that_contradicts_the_images_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    contradicted(monkeypatch, line_error_px=1.01 * LINE_PX)
    steps, _ = run([video(k, arc(k)) for k in range(COUNT)])
    first = next(i for i, step in enumerate(steps) if step.status is Status.TRACKING)
    assert all(step.status is Status.LOST for step in steps[first + 1 :])
    failed = steps[first + 1].decisions[-1]
    assert failed.key == "line_error" and not failed.passed


def test_the_scale_gets_less_certain_with_each_keyframe() -> None:
    steps, _ = run([video(k, arc(k), 1.0) for k in range(12)], 1.0)
    sigmas = [step.scale_sigma for step in steps if step.scale_sigma is not None]
    assert sum(step.key_frame for step in steps) > 1
    assert sigmas[0] == 0.0 and sigmas == sorted(sigmas) and 0 < sigmas[-1] < MAX_SCALE_GROWTH


def test_a_segment_ends_where_its_scale_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    contradicted(monkeypatch, line_error_px=0.6 * LINE_PX, parallax_px=0.4 * LINE_PX / MAX_SCALE_GROWTH)
    steps, _ = run([video(k, arc(k)) for k in range(12)], 1.0)
    ends = next(i for i, step in enumerate(steps) if step.status is Status.LOST)
    failed, after = steps[ends].decisions[-1], steps[ends + 1]
    assert failed.key == "scale_known" and not failed.passed
    assert failed.value == pytest.approx(150 * MAX_SCALE_GROWTH)
    assert after.status is Status.LOST and after.decisions[0].key == "start_parallax"


def contradicted(monkeypatch: pytest.MonkeyPatch, line_error_px: float, parallax_px: float = 10.0) -> None:
    """Lets the images contradict every pose by so much."""

    def answer(field: DepthField, camera: Camera, image: Image, image_from_key: Pose) -> Joint:
        return Joint(jointly_aligned(field, camera, image, image_from_key).pose, line_error_px, parallax_px)

    monkeypatch.setattr(direct_monocular, "jointly_aligned", answer)


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "kitti").is_dir(), reason="the KITTI recording is not in ../shared/data")
def test_the_scale_stays_within_what_is_stated_on_a_drive() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    estimator = DirectMonocularConfig().build(sequence.rig)
    state, sigma = estimator.start(), 0.0
    for i in range(len(sequence)):
        if sequence.kinds[i] == "video":
            state, step = estimator.step(state, sequence[i])
            sigma = max(sigma, step.scale_sigma or 0.0)
    found, truth = estimator.finish(state), sequence.truth
    assert truth is not None and len(found) == 50
    errors = path_errors(found, truth, sequence.rig, False)
    assert errors["t_err_percent"] < 1.5
    assert abs(np.log(errors["step_scale_end_over_start"])) < 3 * sigma
