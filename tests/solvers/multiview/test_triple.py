"""Section 6.1 on exact synthetic points: relative pose, intersection, resection, and the printed formula's bias."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.geometry import Pose, rotation_angle_rad
from ispom.solvers.localisation import refine_pose, resect
from ispom.solvers.multiview.essential import relative_pose, sampson_distance
from ispom.solvers.multiview.triangulation import parallax_rad, triangulate
from ispom.solvers.multiview.triple import depth_ratio, solve_triple, step_length

PIXEL = 1 / 500


def project(camera_from_world: Pose, xyz: np.ndarray) -> np.ndarray:
    p = camera_from_world.apply(xyz)
    return p[:, :2] / p[:, 2:]


def scene(seed: int = 0, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-6, -4, 5], [6, 4, 25], (count, 3))


def moved(t: tuple[float, float, float], turn: tuple[float, float, float] = (0.01, 0.05, -0.02)) -> Pose:
    """camera_from_world of a camera at t."""
    return Pose.from_rotvec(np.array(turn), np.array(t, float)).inverse()


def test_relative_pose_is_exact_without_noise() -> None:
    camera, xyz = moved((0.6, 0.1, 0.8)), scene()
    found = relative_pose(project(Pose(), xyz), project(camera, xyz), PIXEL)
    assert found is not None and found.inliers.all()
    expected = camera.translation / np.linalg.norm(camera.translation)
    np.testing.assert_allclose(found.second_from_first.translation, expected, atol=1e-7)
    np.testing.assert_allclose(found.second_from_first.rotation, camera.rotation, atol=1e-7)


def test_relative_pose_refuses_outliers_and_noise_stays_small() -> None:
    camera, xyz, rng = moved((0.6, 0.1, 0.8)), scene(), np.random.default_rng(1)
    x1, x2 = (project(c, xyz) + rng.normal(0, 0.3 * PIXEL, (len(xyz), 2)) for c in (Pose(), camera))
    x2[:50] = rng.uniform(-0.5, 0.5, (50, 2))
    found = relative_pose(x1, x2, 1.5 * PIXEL)
    assert found is not None
    assert found.inliers[50:].mean() > 0.95 and found.inliers[:50].mean() < 0.15
    expected = camera.translation / np.linalg.norm(camera.translation)
    assert np.degrees(np.arccos(found.second_from_first.translation @ expected)) < 1.5
    assert np.degrees(rotation_angle_rad(found.second_from_first.rotation @ camera.rotation.T)) < 0.2


def test_sampson_distance_is_a_distance_from_the_epipolar_line() -> None:
    camera, xyz = moved((1.0, 0, 0), (0, 0, 0)), scene()
    x1, x2 = project(Pose(), xyz), project(camera, xyz)
    np.testing.assert_allclose(sampson_distance(camera, x1, x2), 0, atol=1e-12)
    # Sideways motion: epipolar lines are rows. A row error is shared between the two images.
    np.testing.assert_allclose(
        np.abs(sampson_distance(camera, x1, x2 + np.array([0, PIXEL]))), PIXEL / np.sqrt(2), rtol=1e-6
    )


def test_triangulation_is_exact_and_knows_its_parallax() -> None:
    camera, xyz = moved((0.6, 0.1, 0.8)), scene()
    np.testing.assert_allclose(triangulate(camera, project(Pose(), xyz), project(camera, xyz)), xyz, atol=1e-8)
    sideways = moved((1.0, 0, 0), (0, 0, 0))
    angle = parallax_rad(sideways, np.array([[0.5, 0, 10.0]]))
    np.testing.assert_allclose(angle, 2 * np.arctan(0.05), atol=1e-12)
    assert len(triangulate(camera, np.zeros((0, 2)), np.zeros((0, 2)))) == 0


def test_resection_with_outliers() -> None:
    camera, xyz, rng = moved((0.6, 0.1, 0.8)), scene(), np.random.default_rng(2)
    x = project(camera, xyz)
    x[:60] = rng.uniform(-0.5, 0.5, (60, 2))
    found = resect(xyz, x, 2 * PIXEL)
    assert found is not None
    np.testing.assert_allclose((found.camera_from_world @ camera.inverse()).log(), 0, atol=1e-4)
    assert found.inliers[60:].all()
    assert resect(xyz[:5], x[:5], PIXEL) is None


def test_motion_only_refinement_keeps_what_no_guess_knew_and_reports_points_behind() -> None:
    camera, xyz = moved((0.6, 0.1, 0.8)), scene()
    behind = np.concatenate([xyz, [[0, 0, -5.0]]])
    x = np.concatenate([project(camera, xyz), [[0, 0]]])
    found = refine_pose(behind, x, moved((0.5, 0.1, 0.7), (0, 0.04, 0)), 2 * PIXEL)
    assert found is not None and found.distances[-1] == 1e9 and not found.inliers[-1]
    np.testing.assert_allclose((found.camera_from_world @ camera.inverse()).log(), 0, atol=1e-6)
    assert refine_pose(np.array([[0, 0, -1.0]] * 10), np.zeros((10, 2)), Pose(), PIXEL) is None


@given(
    middle=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    end=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(1.2, 2.0)),
)
def test_a_triple_without_noise_is_exact_up_to_its_unit(middle: tuple, end: tuple) -> None:
    second, third = moved((middle[0], middle[1], 0.8 + middle[2])), moved(end, (0.02, -0.03, 0.01))
    xyz = scene(3, 60)
    triple = solve_triple(*(project(c, xyz) for c in (Pose(), second, third)), PIXEL, 0.0)
    assert triple is not None
    unit = np.linalg.norm(end)
    np.testing.assert_allclose(triple.t13 * unit, end, atol=1e-5)
    np.testing.assert_allclose(triple.t12 * unit, second.inverse().translation, atol=1e-4)
    t12, t13 = second.inverse().translation, np.array(end)
    assert step_length(triple, "vector") * unit == pytest.approx(np.linalg.norm(t13 - t12), abs=1e-4)
    # The printed formula is never too long: the triangle inequality.
    assert step_length(triple, "norm") <= step_length(triple, "vector") + 1e-9


def test_the_printed_formula_is_right_for_collinear_centres_only() -> None:
    xyz = scene(4)
    straight = solve_triple(*(project(moved((0, 0, z)), xyz) for z in (0, 0.8, 1.6)), PIXEL, 0.0)
    bent = solve_triple(*(project(moved(t), xyz) for t in ((0, 0, 0), (0.3, 0, 0.8), (0, 0, 1.6))), PIXEL, 0.0)
    assert straight is not None and bent is not None
    assert step_length(straight, "norm") == pytest.approx(step_length(straight, "vector"), abs=1e-6)
    assert step_length(bent, "norm") < 0.9 * step_length(bent, "vector")


def test_depth_ratio_is_a_robust_median() -> None:
    depths = np.random.default_rng(5).uniform(2, 30, 50)
    known = 2.5 * depths
    known[:10] *= 7
    ratio, spread = depth_ratio(known, depths)
    assert ratio == pytest.approx(2.5, rel=1e-9) and spread < 1e-9
    assert np.isnan(depth_ratio(known[:5], depths[:5])[0])


def test_degenerate_input_gives_none() -> None:
    assert solve_triple(*[np.zeros((4, 2))] * 3, PIXEL, 0.0) is None
    assert relative_pose(np.zeros((30, 2)), np.zeros((30, 2)), PIXEL) is None
