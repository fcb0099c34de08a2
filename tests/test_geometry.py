"""Rigid motions: group laws as properties, and a round trip of every conversion at an edge."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import rerun as rr
import viser.transforms as vtf
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ispom.geometry import (
    Pose,
    Similarity,
    rotation_angle_rad,
    rotation_between,
    skew,
    slerp,
    so3_exp,
    so3_left_jacobian,
    so3_log,
)

triples = st.tuples(*[st.floats(-20, 20, allow_subnormal=False)] * 3).map(np.array)
directions = triples.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
rotvecs = st.builds(lambda d, a: d * a, directions, st.floats(0, np.pi - 1e-3))
poses = st.builds(Pose.from_rotvec, rotvecs, triples)


def same(a: Pose, b: Pose, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(a.matrix, b.matrix, atol=atol)


@given(poses, poses, poses)
def test_group_laws(a: Pose, b: Pose, c: Pose) -> None:
    same((a @ b) @ c, a @ (b @ c))
    same(a @ a.inverse(), Pose())
    same(a.inverse() @ a, Pose())
    same(a @ Pose(), a)
    same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses, poses, st.lists(triples, min_size=1, max_size=4).map(np.array))
def test_a_product_acts_as_one_after_the_other(a: Pose, b: Pose, points: np.ndarray) -> None:
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-9)
    np.testing.assert_allclose(a.inverse().apply(a.apply(points)), points, atol=1e-9)
    homogeneous = a.matrix @ np.append(points[0], 1)
    np.testing.assert_allclose(a.apply(points[0]), homogeneous[:3], atol=1e-9)


@given(poses)
def test_exp_undoes_log(pose: Pose) -> None:
    same(Pose.exp(pose.log()), pose, 1e-8)


@given(triples, rotvecs.filter(lambda r: np.linalg.norm(r) < 3))
def test_log_undoes_exp(rho: np.ndarray, phi: np.ndarray) -> None:
    twist = np.concatenate([rho, phi])
    np.testing.assert_allclose(Pose.exp(twist).log(), twist, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 9e-6, 1.1e-5, 1e-3])
def test_small_angles_keep_their_digits(angle: float) -> None:
    twist = np.array([1.0, -2, 3, angle, 0, 0])
    np.testing.assert_allclose(Pose.exp(twist).log(), twist, atol=1e-10)


@given(rotvecs)
def test_so3_maps(rotvec: np.ndarray) -> None:
    rotation = so3_exp(rotvec)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(so3_log(rotation), rotvec, atol=1e-6)
    assert rotation_angle_rad(rotation) == pytest.approx(np.linalg.norm(rotvec), abs=1e-7)


@given(rotvecs)
def test_the_left_jacobian_is_the_derivative_of_exp(phi: np.ndarray) -> None:
    step = 1e-6
    for axis in np.eye(3):
        turned = so3_exp(phi + step * axis) @ so3_exp(phi).T
        np.testing.assert_allclose(so3_log(turned) / step, so3_left_jacobian(phi) @ axis, atol=1e-4)


@given(triples, triples)
def test_skew_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-9)


@given(directions, directions)
def test_the_rotation_between_directions(a: np.ndarray, b: np.ndarray) -> None:
    rotation = rotation_between(3 * a, b)
    np.testing.assert_allclose(rotation @ a, b, atol=1e-7)
    assert rotation_angle_rad(rotation) == pytest.approx(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b), abs=1e-6)


def test_opposite_directions_turn_half_way() -> None:
    turned = rotation_between(np.array([0, 0, 2.0]), np.array([0, 0, -1.0])) @ [0, 0, 1]
    np.testing.assert_allclose(turned, [0, 0, -1], atol=1e-12)
    with pytest.raises(ValueError, match="no direction"):
        rotation_between(np.zeros(3), np.ones(3))


@given(rotvecs.filter(lambda r: np.linalg.norm(r) < 3), st.floats(0, 1))
def test_slerp_turns_at_constant_rate(rotvec: np.ndarray, fraction: float) -> None:
    found = slerp(np.eye(3), so3_exp(rotvec), np.array([fraction]))[0]
    np.testing.assert_allclose(found, so3_exp(fraction * rotvec), atol=1e-7)


@given(poses, poses, st.floats(0.01, 100), triples)
def test_a_similarity_places_poses_as_it_places_points(a: Pose, b: Pose, scale: float, point: np.ndarray) -> None:
    similarity = Similarity(scale, a)
    np.testing.assert_allclose(
        similarity.apply_pose(b).apply(scale * point), similarity.apply(b.apply(point)), atol=1e-6
    )


@given(poses)
def test_opencv(pose: Pose) -> None:
    rotation, _ = cv2.Rodrigues(pose.rotvec)
    np.testing.assert_allclose(rotation, pose.rotation, atol=1e-9)
    rvec, _ = cv2.Rodrigues(pose.rotation)
    same(Pose.from_rotvec(rvec, pose.translation[:, None]), pose, 2e-5)  # OpenCV calls smaller angles zero


@given(poses)
def test_scipy_tum_and_rerun_write_xyzw(pose: Pose) -> None:
    assert pose.xyzw[3] >= 0
    same(Pose.from_xyzw(pose.xyzw, pose.translation), pose)
    np.testing.assert_allclose(Rotation.from_quat(pose.xyzw).as_matrix(), pose.rotation, atol=1e-9)
    logged = rr.Transform3D(translation=pose.translation, quaternion=rr.Quaternion(xyzw=pose.xyzw))
    assert logged.quaternion is not None and logged.translation is not None
    stored = np.array(logged.quaternion.as_arrow_array().to_pylist()[0])
    same(Pose.from_xyzw(stored, pose.translation), pose, 1e-5)


@given(poses)
def test_viser_writes_wxyz(pose: Pose) -> None:
    theirs = vtf.SE3.from_rotation_and_translation(vtf.SO3(pose.wxyz), pose.translation)
    np.testing.assert_allclose(theirs.as_matrix(), pose.matrix, atol=1e-9)
    np.testing.assert_allclose(abs(theirs.rotation().wxyz), abs(pose.wxyz), atol=1e-12)
    np.testing.assert_allclose(theirs.log(), pose.log(), atol=1e-6)


@given(poses)
def test_matrices(pose: Pose) -> None:
    same(Pose.from_matrix(pose.matrix), pose, 0)
    same(Pose.from_matrix(pose.matrix[:3]), pose, 0)  # KITTI's rows


def test_a_pose_cannot_be_changed() -> None:
    pose = Pose()
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1
    with pytest.raises(ValueError, match="a pose is"):
        Pose(np.eye(4), np.zeros(3))
