"""Registration to a panorama: exact rays first, then a textured sphere around a camera, and one that translates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.survey.panorama import PanoramaConfig, least_squares_rotation, rotation_between_rays
from ispom.geometry import Array, Pose, rotation_angle_rad, so3_exp
from ispom.types import Camera, Frame, Image, Rig, Status, Step, Trajectory
from tests.alone import stepped_through
from tests.estimators.survey.scenes import seen

CAMERA = Camera(320, 240, 250.0, 250.0, 159.5, 119.5)
STEP_DEG = 15.0
COUNT = 27
"""Frames: a turn of 24 frames, and somewhat more."""


def sphere(directions: Array) -> Array:
    """Returns grey levels (N,) at unit directions (N, 3): waves without repetition, in all sizes."""
    rng = np.random.default_rng(3)
    waves = rng.normal(0, 1, (24, 3)) * np.geomspace(8, 50, 24)[:, None]
    return 128 + 130 * np.sin(
        directions @ waves.T.astype(np.float32) + rng.uniform(0, 2 * np.pi, 24).astype(np.float32)
    ).mean(axis=1) * np.sqrt(2)


def image(rotation: Array) -> Image:
    """Returns what the camera sees of the sphere."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays, _ = CAMERA.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    grey = np.rint(np.clip(sphere((rays @ rotation.T).astype(np.float32)), 0, 255)).astype(np.uint8)
    return grey.reshape(CAMERA.height, CAMERA.width)


def orientation(k: int) -> Array:
    """Returns world_from_camera of frame k: a pan that nods."""
    yaw = so3_exp(np.array([0.0, np.radians(STEP_DEG * k), 0.0]))
    return yaw @ so3_exp(np.radians([5 * np.sin(0.5 * k), 0.0, 3 * np.sin(0.3 * k)]))


@pytest.fixture(scope="module")
def images() -> list[Image]:
    return [image(orientation(k)) for k in range(COUNT)]


def run(
    images: list[Image], camera: Camera = CAMERA, config: PanoramaConfig | None = None
) -> tuple[list[Step], Trajectory]:
    estimator = (config or PanoramaConfig()).build(Rig.single(camera))
    state, steps = stepped_through(estimator, (Frame.video(k * 100_000_000, grey) for k, grey in enumerate(images)))
    return steps, estimator.finish(state)


def errors_deg(rotations: Array, start: int = 0) -> Array:
    """Returns the angles between true and found orientations, both relative to the first frame."""
    true = np.stack([orientation(0).T @ orientation(start + k) for k in range(len(rotations))])
    return np.degrees(rotation_angle_rad(np.swapaxes(true, 1, 2) @ rotations))


def decision(step: Step, key: str):
    return next((d for d in step.decisions if d.key == key), None)


def test_the_rotation_of_exact_rays_is_exact_among_outliers() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(0, 1, (200, 3)) * (0.4, 0.3, 0.05) + (0, 0, 1)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    truth = so3_exp(np.array([0.2, -0.5, 0.3]))
    b = a @ truth.T
    b[:110] = b[rng.permutation(110)]
    rotation, inliers = rotation_between_rays(a, b, 2e-3)
    assert inliers[110:].all() and inliers[:110].sum() < 12
    assert float(rotation_angle_rad(rotation.T @ truth)) < 1e-5
    rotation, distances = least_squares_rotation(a[110:], b[110:], np.eye(3), 1e-3)
    np.testing.assert_allclose(rotation, truth, atol=1e-12)
    assert distances.max() < 1e-12


def test_a_turn_is_known_within_a_tenth_of_a_degree_and_closes(images: list[Image]) -> None:
    steps, final = run(images)
    assert all(step.status is Status.TRACKING for step in steps)
    live = np.stack([step.world_from_frame.rotation for step in steps if step.world_from_frame is not None])
    assert errors_deg(live).max() < 0.3
    assert len(final) == COUNT and errors_deg(final.rotations).max() < 0.1
    assert not final.translations.any()
    gaps = [found for step in steps if (found := decision(step, "gap_closed")) is not None]
    assert gaps and all(gap.passed for gap in gaps)
    revised = [step.revised for step in steps if len(step.revised)]
    assert revised
    shares = [found for step in steps[1:] if (found := decision(step, "rotation_only")) is not None]
    assert len(shares) == COUNT - 1 and all(share.passed for share in shares)


def test_a_wrong_focal_length_is_named(images: list[Image]) -> None:
    wrong = replace(CAMERA, fx=1.5 * CAMERA.fx, fy=1.5 * CAMERA.fy)
    steps, _ = run([images[0], images[2]], wrong)
    found = decision(steps[1], "rotation_only"), decision(steps[1], "focal_factor")
    assert found[0] is not None and not found[0].passed
    assert found[1] is not None and found[1].passed and found[1].value == pytest.approx(1 / 1.5, abs=0.07)


def test_a_camera_that_translates_is_said_to() -> None:
    estimator = PanoramaConfig().build(Rig.single(CAMERA))
    state, _ = estimator.step(estimator.start(), Frame.video(0, seen(Pose())[0]))
    turned = Pose.from_rotvec(np.array([0.0, 0.1, 0.0]), np.zeros(3))
    _, step = estimator.step(state, Frame.video(10**8, seen(turned)[0]))
    assert (share := decision(step, "rotation_only")) is not None and share.passed
    moved = Pose.from_rotvec(np.array([0.0, 0.1, 0.0]), np.array([0.4, 0.0, 1.2]))
    _, step = estimator.step(state, Frame.video(10**8, seen(moved)[0]))
    share = decision(step, "rotation_only")
    assert step.status is Status.LOST or (share is not None and not share.passed)


def test_a_frame_is_registered_again_after_a_loss_wherever_it_looks(images: list[Image]) -> None:
    steps, _ = run([*images[:10], np.full((240, 320), 90, np.uint8), images[2]])
    assert steps[10].status is Status.LOST and steps[10].world_from_frame is None
    assert steps[11].world_from_frame is not None and not steps[11].restarted
    assert errors_deg(steps[11].world_from_frame.rotation[None], 2).max() < 0.1


def test_after_many_lost_frames_a_new_panorama_begins(images: list[Image]) -> None:
    config = PanoramaConfig(max_lost_frames=2)
    steps, final = run([*images[:3], images[15], images[15], images[15], images[16]], config=config)
    assert [step.status for step in steps[3:]] == [Status.LOST] * 2 + [Status.TRACKING] * 2
    assert steps[5].restarted and not steps[6].restarted
    assert len(final) == 5


def test_an_image_without_texture_begins_nothing() -> None:
    (step,), final = run([np.full((240, 320), 90, np.uint8)])
    assert step.status is Status.INITIALISING and not step.decisions[0].passed and not len(final)
