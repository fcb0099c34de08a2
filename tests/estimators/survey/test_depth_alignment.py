"""A pose found together with inverse depths: exact for exact depths, right for depths of a wrong pose, and a pose that
contradicts the images is told by its line error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.survey.depth_alignment import jointly_aligned
from ispom.estimators.survey.depth_field import LINE_PX, DepthField
from ispom.estimators.survey.photometric import align, pyramid, square_patch
from ispom.geometry import Array, Pose, rotation_angle_rad
from tests.estimators.survey.test_depth_field import CAMERA, field_and_truth, noisy, pose, seen

WRONG = Pose.from_rotvec(np.array([0.0, 0.003, 0.0]), np.zeros(3))
"""What is wrong with a pose: its rotation, by 0.17 degrees, which is 0.3 px."""
PRIOR = 0.02
"""Standard deviation of the inverse depths of a test, as a share of them."""


def known(sigma: float = 0.0, factor: Array | float = 1.0) -> DepthField:
    """Returns a field with the true inverse depths times a factor."""
    field, truth = field_and_truth(sigma)
    return replace(field, inverse=factor * truth, sigma=PRIOR * truth, agreed=np.full(len(truth), 2))


def errors(found: Pose, truth: Pose) -> tuple[float, float]:
    """Returns the error of the rotation and of the direction of the translation [degrees]."""
    rotation = np.degrees(float(rotation_angle_rad(found.rotation @ truth.rotation.T)))
    a, b = (p.inverse().translation for p in (found, truth))
    cosine = float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    return rotation, float(np.degrees(np.arccos(min(1.0, cosine))))


@pytest.mark.parametrize(("noise", "degrees"), [(0.0, 0.01), (2.0, 0.03)], ids=["exact", "noisy"])
def test_a_pose_nearby_is_corrected(noise: float, degrees: float) -> None:
    image, truth = noisy(seen(pose(4))[0], noise, 1), pose(4).inverse()
    joint = jointly_aligned(known(noise), CAMERA, image, WRONG @ truth)
    rotation, direction = errors(joint.pose, truth)
    assert rotation < degrees and direction < 60 * degrees
    length = np.linalg.norm(joint.pose.translation) / np.linalg.norm(truth.translation)
    assert length == pytest.approx(1, abs=0.3 * degrees + 0.002)
    assert joint.line_error_px < 0.05


def test_a_common_error_of_the_depths_turns_the_pose_by_less() -> None:
    """Each depth is within two standard deviations of the truth, but to one side they are all too large."""
    truth, image = pose(6).inverse(), seen(pose(6))[0]
    field = known()
    field = replace(field, inverse=field.inverse * (1 + 4 * PRIOR * (field.uv[:, 0] - CAMERA.cx) / CAMERA.width))
    alone = align(CAMERA, pyramid(field.grey), field.uv, 1 / field.inverse, pyramid(image), (truth,), square_patch(4))
    assert alone is not None
    joint = jointly_aligned(field, CAMERA, image, alone.pose)
    before, after = errors(alone.pose, truth), errors(joint.pose, truth)
    assert before[0] > 0.05
    assert after[0] < 0.6 * before[0] and after[1] < 0.6 * before[1]


def test_wrong_depths_that_are_taken_for_exact_show_as_a_line_error() -> None:
    field = known()
    slanted = 1 + 0.6 * (field.uv[:, 0] - CAMERA.cx) / CAMERA.width
    truth = pose(6).inverse()
    wrong = replace(known(factor=slanted), sigma=1e-6 * field.inverse)
    assert jointly_aligned(wrong, CAMERA, seen(pose(6))[0], truth).line_error_px > LINE_PX
    assert jointly_aligned(field, CAMERA, seen(pose(6))[0], truth).line_error_px < 0.1 * LINE_PX


def test_without_texture_the_lines_say_nothing_and_the_pose_stays() -> None:
    blank, truth = np.full((CAMERA.height, CAMERA.width), 90, np.uint8), pose(3).inverse()
    joint = jointly_aligned(known(), CAMERA, blank, truth)
    assert joint.line_error_px == np.inf
    np.testing.assert_allclose(joint.pose.translation, truth.translation)


def test_at_rest_the_rotation_is_found() -> None:
    joint = jointly_aligned(known(), CAMERA, seen(Pose())[0], WRONG)
    assert np.degrees(float(rotation_angle_rad(joint.pose.rotation))) < 0.02
    assert joint.line_error_px < 0.05
