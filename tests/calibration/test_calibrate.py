"""Interior and pair from simulated corners, against the truth: exact without noise, within their standard errors with;
what does not fit, what is not determined, and what is the wrong way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.calibration.adjust.lens import vector_of
from ispom.calibration.adjust.problem import Observations, Unknowns
from ispom.calibration.adjust.solve import solve, with_views
from ispom.calibration.calibrate import calibrate
from ispom.calibration.result import Redo
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.simulation.filmed_board import LEFT, VIDEO, board_poses, filming_rig
from ispom.types import Camera
from tests.calibration.corners import seen_by, views_of

BOARD = parse_target("aprilgrid:6x6:0.03:0.3")
FISHEYE = Camera(800, 600, 250.0, 251.0, 402.0, 297.0, (0.02, -0.004, 0.001, -0.0003), "fisheye")
RATIONAL = replace(LEFT, distortion=(0.9, 0.2, 0.0003, -0.0002, 0.02, 1.2, 0.45, 0.06))
SEEDS = 50


@pytest.mark.parametrize(("camera", "model"), [(LEFT, "radtan"), (FISHEYE, "fisheye"), (RATIONAL, "rational")])
def test_a_camera_is_found_exactly_without_noise(camera: Camera, model: str) -> None:
    detections = seen_by(BOARD, camera, board_poses(camera, BOARD.size_m, 14, 1), np.random.default_rng(1), 0.0)
    found = calibrate(BOARD, (views_of("video", camera, detections),), model)  # type: ignore[arg-type]
    assert found.solution.rms_px < 1e-5
    assert vector_of(found.cameras[0].camera)[:4] == pytest.approx(vector_of(camera)[:4], abs=1e-3)


@pytest.mark.parametrize(("camera", "model"), [(VIDEO, "radtan"), (FISHEYE, "fisheye")])
def test_the_model_is_chosen_by_views_held_out(camera: Camera, model: str) -> None:
    detections = seen_by(BOARD, camera, board_poses(camera, BOARD.size_m, 16, 2), np.random.default_rng(2))
    found = calibrate(BOARD, (views_of("video", camera, detections),))
    assert {trial.model for trial in found.cameras[0].trials} == {"pinhole", "radtan", "rational", "fisheye"}
    assert len(found.cameras[0].camera.distortion) == 4
    assert found.cameras[0].camera.lens == ("fisheye" if model == "fisheye" else "opencv")


def test_parameters_are_within_three_standard_errors_in_95_percent_of_seeds() -> None:
    truth, inside, focal_off = vector_of(VIDEO), [], []
    for seed in range(SEEDS):
        poses = board_poses(VIDEO, BOARD.size_m, 30, seed)
        seen = Observations.of(BOARD, [seen_by(BOARD, VIDEO, poses, np.random.default_rng(seed))])
        start = with_views(replace(VIDEO, fx=440.0, fy=440.0, distortion=(0.0,) * 4), seen)
        found, _ = solve(start, seen, Unknowns.all_of(start))
        off = vector_of(found.estimate.cameras[0]) - truth
        inside.append(np.abs(off) <= 3 * np.sqrt(np.diag(found.covariance)))
        focal_off.append(np.abs(off[:2]) / truth[:2])
        assert 0.95 < found.unit_sigma < 1.05
    assert np.mean(inside, axis=0).min() >= 0.95
    assert np.percentile(focal_off, 95) < 0.001


def test_a_pair_is_within_three_standard_errors_too() -> None:
    rig, inside, turned = filming_rig(), [], []
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    for seed in range(3):
        rng, poses = np.random.default_rng(seed), board_poses(LEFT, BOARD.size_m, 30, seed)
        left = seen_by(BOARD, rig.camera("left"), poses, rng)
        right = seen_by(BOARD, rig.camera("right"), [right_from_left @ pose for pose in poses], rng)
        views = (views_of("left", rig.camera("left"), left), views_of("right", rig.camera("right"), right))
        found = calibrate(BOARD, views, "radtan")
        error = found.solution.estimate.camera_from_rig[1] @ right_from_left.inverse()
        sigma = np.array([p.standard_error for p in found.parameters[-6:]])
        inside.append(np.abs(error.log()) <= 3 * sigma)
        turned.append(np.degrees(np.linalg.norm(error.rotvec)))
        assert found.baseline_m == pytest.approx(rig.baseline_m, rel=0.005)
        assert found.row_error is not None
        assert found.row_error.rms_px < 0.5
    assert np.mean(inside) >= 0.95
    assert max(turned) < 0.05


def test_bad_views_and_corners_are_rejected_and_listed() -> None:
    detections = seen_by(BOARD, VIDEO, board_poses(VIDEO, BOARD.size_m, 15, 3), np.random.default_rng(3))
    shaken = detections[4].uv + np.random.default_rng(0).normal(0, 15, detections[4].uv.shape)
    detections[4] = replace(detections[4], uv=shaken)
    moved = detections[7].uv.copy()
    moved[5] += 6.0
    detections[7] = replace(detections[7], uv=moved)
    found = calibrate(BOARD, (views_of("video", VIDEO, detections),), "radtan")
    assert ("004.png", None) in {(r.image, r.point) for r in found.rejected}
    assert ("007.png", int(detections[7].ids[5])) in {(r.image, r.point) for r in found.rejected}
    assert found.cameras[0].camera.fx == pytest.approx(VIDEO.fx, rel=0.003)


def test_views_all_alike_name_the_parameters_that_they_do_not_determine() -> None:
    poses = board_poses(VIDEO, BOARD.size_m, 25, 1, alike=True)
    detections = seen_by(BOARD, VIDEO, poses, np.random.default_rng(1))
    found = calibrate(BOARD, (views_of("video", VIDEO, detections),))
    assert found.verdict.level == "redo"
    assert {"fx", "fy"} <= {parameter.name for parameter in found.undetermined}
    assert any("fx, fy" in reason for reason in found.verdict.reasons)
    assert any("tilt the board" in text for text in found.verdict.advice)


def test_too_few_views_are_to_be_filmed_again() -> None:
    detections = seen_by(BOARD, VIDEO, board_poses(VIDEO, BOARD.size_m, 2, 1), np.random.default_rng(1))
    with pytest.raises(Redo, match="2 of 2 images"):
        calibrate(BOARD, (views_of("video", VIDEO, detections),))


def test_left_and_right_swapped_are_told() -> None:
    rig, rng, poses = filming_rig(), np.random.default_rng(0), board_poses(LEFT, BOARD.size_m, 8, 0)
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    left = seen_by(BOARD, rig.camera("left"), poses, rng)
    right = seen_by(BOARD, rig.camera("right"), [right_from_left @ pose for pose in poses], rng)
    views = (views_of("left", rig.camera("right"), right), views_of("right", rig.camera("left"), left))
    with pytest.raises(InputError, match="swapped"):
        calibrate(BOARD, views, "radtan")


def test_the_result_does_not_depend_on_anything_but_its_input() -> None:
    detections = seen_by(BOARD, VIDEO, board_poses(VIDEO, BOARD.size_m, 10, 5), np.random.default_rng(5))
    one, other = (calibrate(BOARD, (views_of("video", VIDEO, detections),)) for _ in range(2))
    assert one.cameras[0].camera == other.cameras[0].camera
    assert np.array_equal(one.solution.covariance, other.solution.covariance)


def test_a_pair_without_common_views_is_to_be_filmed_again() -> None:
    rng, poses = np.random.default_rng(0), board_poses(LEFT, BOARD.size_m, 12, 0)
    seen = seen_by(BOARD, LEFT, poses, rng)
    nothing = [replace(d, ids=d.ids[:0], uv=d.uv[:0], sigma_px=d.sigma_px[:0], reason="no tag found") for d in seen]
    left, right = [*seen[:6], *nothing[6:]], [*nothing[:6], *seen[6:]]
    with pytest.raises(Redo, match="at the same time"):
        calibrate(BOARD, (views_of("left", LEFT, left), views_of("right", LEFT, right)), "radtan")


def test_the_rig_frame_is_centred_on_the_baseline() -> None:
    rig, rng, poses = filming_rig(), np.random.default_rng(0), board_poses(LEFT, BOARD.size_m, 8, 0)
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    left = seen_by(BOARD, rig.camera("left"), poses, rng)
    right = seen_by(BOARD, rig.camera("right"), [right_from_left @ pose for pose in poses], rng)
    views = (views_of("left", LEFT, left), views_of("right", rig.camera("right"), right))
    found = calibrate(BOARD, views, "radtan").rig
    assert np.allclose(found.rig_from_left.translation, -found.rig_from_right.translation)
    assert np.allclose(found.rig_from_right.translation[1:], 0, atol=1e-12)
    between: Pose = found.rig_from_right.inverse() @ found.rig_from_left
    assert np.allclose(between.matrix, right_from_left.matrix, atol=0.003)


def test_images_that_are_turned_are_no_camera() -> None:
    """Of every second view the image is upside down: each half of the views fits another principal point."""
    camera = replace(LEFT, cx=401.0, cy=261.0)
    detections = seen_by(BOARD, camera, board_poses(camera, BOARD.size_m, 12, 3), np.random.default_rng(3))
    corner = np.array([camera.width - 1, camera.height - 1])
    turned = [d if i % 2 or d.reason else replace(d, uv=corner - d.uv) for i, d in enumerate(detections)]
    assert calibrate(BOARD, (views_of("video", camera, detections),), "radtan").verdict.level != "redo"
    verdict = calibrate(BOARD, (views_of("video", camera, turned),), "radtan").verdict
    assert verdict.level == "redo"
    assert any("two halves" in reason for reason in verdict.reasons)
