"""The direct method: a plane under a known pose is aligned exactly; then pairs, exposure, and a lost camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.survey.direct import DirectConfig
from ispom.estimators.survey.photometric import align, correlations, pyramid, sample, square_patch, textured
from ispom.evaluation.metrics import path_errors
from ispom.geometry import Pose, rotation_angle_rad
from ispom.sequences import open_sequence
from ispom.types import Frame, Rig, Status
from tests.estimators.survey.scenes import CAMERA, seen

DATA = Path(__file__).parents[4] / "shared" / "data"
BASELINE_M = 0.3
MOTION = Pose.from_rotvec(np.array([0.01, -0.02, 0.015]), np.array([0.12, -0.05, 0.2]))
"""world_from_camera; the reference is the world."""


def aligned(gain: float = 1.0, offset: float = 0.0, guess: Pose | None = None):
    reference, depth = seen(Pose())
    image, _ = seen(MOTION)
    image = np.rint(np.clip(gain * image + offset, 0, 255)).astype(np.uint8)
    uv = textured(reference, 400, 2.0, 8).astype(float)
    depths = depth[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    guesses = (guess or Pose(),)
    return align(CAMERA, pyramid(reference), uv, depths, pyramid(image), guesses, square_patch(3)), uv


def test_a_bilinear_sample_is_exact_on_a_ramp_and_nan_outside() -> None:
    ramp = np.add.outer(3 * np.arange(10), 2 * np.arange(12)).astype(np.uint8)
    values = sample(ramp, np.array([[0.0, 0.0], [3.25, 4.5], [11.0, 9.0], [11.1, 3.0], [-0.1, 3.0], [np.nan, 2.0]]))
    np.testing.assert_allclose(values[:3], [0.0, 20.0, 49.0])
    assert np.isnan(values[3:]).all()


def test_correlation_ignores_gain_and_offset_and_needs_texture() -> None:
    a = np.array([[1.0, 5.0, 2.0, 8.0], [4.0, 4.0, 4.0, 4.0], [1.0, 2.0, 3.0, np.nan]])
    np.testing.assert_allclose(correlations(a, 2.5 * a + 7), [1.0, -1.0, -1.0])


def test_the_steepest_pixel_of_each_cell_is_chosen() -> None:
    image = np.full((64, 64), 100, np.uint8)
    image[:, 32:] = 200  # the edge lies between two columns of cells
    uv = textured(image, 64, 4.0, 4)
    assert len(uv) == 16 and np.isin(uv[:, 0], (31, 32)).all()
    assert not len(textured(np.full((64, 64), 100, np.uint8), 64, 4.0, 4))


def test_a_plane_under_a_known_pose_is_aligned_exactly() -> None:
    found, uv = aligned()
    assert found is not None
    truth = MOTION.inverse()
    error = truth.inverse() @ found.pose
    assert np.linalg.norm(error.translation) < 2e-3
    assert np.degrees(float(rotation_angle_rad(error.rotation))) < 0.02
    assert found.gain == pytest.approx(1, abs=5e-3)
    assert found.similar.mean() > 0.9
    rays = np.column_stack([CAMERA.normalise(uv), np.ones(len(uv))])
    depth = seen(Pose())[1][uv[:, 1].astype(int), uv[:, 0].astype(int)]
    expected = CAMERA.project(truth.apply(depth[:, None] * rays))
    inside = np.isfinite(found.uv[:, 0])
    assert np.abs(found.uv - expected)[inside].max() < 0.1


def test_exposure_is_found_with_the_pose() -> None:
    found, _ = aligned(gain=0.7, offset=20.0)
    assert found is not None
    assert (found.gain, found.offset) == (pytest.approx(0.7, abs=0.02), pytest.approx(20.0, abs=2.0))
    assert np.linalg.norm((MOTION @ found.pose).translation) < 4e-3


def test_a_wrong_guess_is_replaced_by_a_better_one() -> None:
    far = Pose.from_rotvec(np.array([0.0, 0.5, 0.0]), np.zeros(3))
    reference, depth = seen(Pose())
    uv = textured(reference, 400, 2.0, 8).astype(float)
    depths = depth[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    pyramids = pyramid(reference), pyramid(seen(MOTION)[0])
    found = align(CAMERA, pyramids[0], uv, depths, pyramids[1], (far, Pose()), square_patch(3))
    assert found is not None
    assert np.linalg.norm((MOTION @ found.pose).translation) < 2e-3


def pairs(count: int):
    rig = Rig.stereo(CAMERA, BASELINE_M)
    for k in range(count):
        pose = Pose.from_rotvec(k * np.array([0.002, -0.01, 0.003]), k * np.array([0.05, 0.01, 0.08]))
        images = [seen(pose @ rig.rig_from(name))[0] for name in ("left", "right")]
        yield pose, Frame.stereo(k * 100_000_000, *images)


def test_pairs_give_a_metric_path_and_a_dark_one_is_lost() -> None:
    estimator = DirectConfig().build(Rig.stereo(CAMERA, BASELINE_M))
    state = estimator.start()
    for truth, frame in pairs(4):
        state, step = estimator.step(state, frame)
        assert step.world_from_frame is not None
        error = truth.inverse() @ step.world_from_frame
        assert np.linalg.norm(error.translation) < 0.01 * max(0.5, float(np.linalg.norm(truth.translation)))
        assert np.degrees(float(rotation_angle_rad(error.rotation))) < 0.1
    dark = Frame.stereo(10**9, np.full((240, 320), 5, np.uint8), np.full((240, 320), 5, np.uint8))
    _, step = estimator.step(state, dark)
    assert step.status is Status.LOST and step.world_from_frame is None


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "kitti").is_dir(), reason="the KITTI recording is not in ../shared/data")
def test_drift_on_kitti() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    estimator = DirectConfig().build(sequence.rig)
    state = estimator.start()
    for i in range(len(sequence)):
        if sequence.kinds[i] == "stereo":
            state, step = estimator.step(state, sequence[i])
            assert step.world_from_frame is not None
    assert sequence.truth is not None
    assert path_errors(estimator.finish(state), sequence.truth, sequence.rig, True)["t_err_percent"] < 2.0
