"""The depth field of one camera: exact images give exact depths, noisy ones honest deviations, no motion none."""

from __future__ import annotations

import numpy as np

from ispom.estimators.survey.depth_field import DepthField, cells
from ispom.estimators.survey.photometric import textured
from ispom.geometry import Array, Pose
from ispom.types import Camera, Image
from tests.estimators.survey import scenes

CAMERA = Camera(320, 240, 100.0, 100.0, 159.5, 119.5)
"""With a wide view, in which the waves of the plane are 18 px long: patches are 5 px wide."""
TYPICAL = 0.25
"""Inverse depth that is expected; the true ones are about 0.2."""


def seen(world_from_camera: Pose) -> tuple[Image, Array]:
    return scenes.seen(world_from_camera, CAMERA)


def pose(k: int) -> Pose:
    """Returns world_from_camera of image k; the keyframe is the world."""
    return Pose.from_rotvec(k * np.array([0.004, -0.006, 0.003]), k * np.array([0.1, 0.02, 0.06]))


def noisy(image: Image, sigma: float, seed: int) -> Image:
    noise = np.random.default_rng(seed).normal(0, sigma, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def field_and_truth(sigma: float = 0.0) -> tuple[DepthField, Array]:
    """Returns a field that knows nothing, and the true inverse depths (N,)."""
    grey, depth = seen(Pose())
    uv = textured(grey, 800, 4.0, 8).astype(float)
    field = DepthField.unknown(noisy(grey, sigma, 99), np.arange(len(uv)), uv, TYPICAL)
    return field, 1 / depth[uv[:, 1].astype(int), uv[:, 0].astype(int)]


def improved(field: DepthField, count: int, sigma: float = 0.0) -> DepthField:
    for k in range(1, count + 1):
        field = field.improved(CAMERA, noisy(seen(pose(k))[0], sigma, k), pose(k).inverse())
    return field


def test_exact_images_of_known_poses_give_the_depths() -> None:
    field, truth = field_and_truth()
    assert not field.sure.any()
    field = improved(field, 8)
    assert field.sure.mean() > 0.6  # where the gradient points across the line there is no depth
    error = np.abs(field.inverse / truth - 1)[field.sure]
    assert np.median(error) < 0.01 and np.percentile(error, 99) < 0.05


def test_with_noise_the_stated_deviations_are_about_the_errors() -> None:
    field, truth = field_and_truth(1.0)
    field = improved(field, 8, 1.0)
    assert field.sure.sum() > 100
    error = np.abs(field.inverse - truth)[field.sure]
    assert np.median(error / truth[field.sure]) < 0.03
    assert 0.3 < np.median(error / field.sigma[field.sure]) / 0.6745 < 2


def test_images_from_the_same_place_say_nothing() -> None:
    field, _ = field_and_truth(1.0)
    turn = Pose.from_rotvec(np.array([0.01, 0.02, 0.0]), np.zeros(3))
    for k, there in enumerate([Pose(), turn, Pose(), turn]):
        field = field.improved(CAMERA, noisy(seen(there)[0], 1.0, k), there.inverse())
    assert not field.sure.any()
    np.testing.assert_array_equal(field.inverse, TYPICAL)
    np.testing.assert_array_equal(field.sigma, TYPICAL)


def test_a_wrong_depth_is_forgotten() -> None:
    field, truth = field_and_truth()
    right = improved(field, 6)
    wrong = DepthField(right.grey, right.ids, right.uv, 1.5 * truth, 0.02 * truth, right.agreed)
    was = wrong.sure.sum()
    assert was > 0.8 * right.sure.sum()
    after = improved(wrong, 6)
    assert (after.sure & (np.abs(after.inverse / truth - 1) > 0.1)).sum() < 0.1 * was


def test_depths_are_carried_to_another_keyframe() -> None:
    field, _ = field_and_truth()
    field, there = improved(field, 8), pose(10)
    grey, depth = seen(there)
    moved = field.carried(CAMERA, grey, there.inverse(), 800)
    assert moved.sure.sum() > 0.5 * field.sure.sum() and len(set(cells(moved.uv, grey, 800).tolist())) == len(moved.ids)
    column, row = np.rint(moved.uv).astype(int).T
    error = np.abs(moved.inverse * depth[row, column] - 1)
    assert np.median(error[moved.sure]) < 0.01
