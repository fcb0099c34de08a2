"""A track's point, its covariance and its epipolar lines, against geometry that is known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.engine.inspection.looked import revised
from ispom_app.engine.inspection.point import covariance, epipolar, estimate, ideal, residuals
from ispom_app.engine.inspection.sightings import TrackLife, life
from ispom_app.engine.model.run_model import RunModel

from ispom.estimators.modern.lens import Lens
from ispom.geometry import Array, Pose
from ispom.types import Trajectory
from tests.app.inspect.scene import CAMERA, COUNT, POINTS, RIG, pose, records, seen_from
from tests.app.inspect.test_sightings import LEAVES, STAYS, track

LENS = Lens(CAMERA, np.zeros(2))
RECORDS = records()


def exact(number: int = STAYS) -> TrackLife:
    """With the pixels before they were rounded to float32."""
    found = life(RECORDS, COUNT - 1, track(number), RIG)
    assert found is not None
    sightings = (replace(s, uv=seen_from(s.index)[number]) if not s.status.dropped else s for s in found.observations)
    return replace(found, observations=tuple(sightings))


def away_from(curve: Array, uv: Array) -> float:
    """Distance of a pixel from a polyline."""
    a, along = curve[:-1], np.diff(curve, axis=0)
    at = np.clip(((uv - a) * along).sum(1) / (along**2).sum(1), 0, 1)
    return float(np.linalg.norm(a + at[:, None] * along - uv, axis=1).min())


def test_a_perfect_track_lies_on_its_epipolar_lines():
    first, *others = exact().observations
    for other in others:
        line = epipolar(LENS, first.world_from_camera, other.world_from_camera, first.uv, other.uv)
        assert line.distance_px < 1e-6
        assert away_from(line.curve_uv, other.uv) < 0.2, "the drawn curve passes by, bent by the lens as the image is"


def test_the_distance_is_across_the_line():
    first, last = exact().observations[0], exact().last
    poses = first.world_from_camera, last.world_from_camera
    curve = epipolar(LENS, *poses, first.uv, last.uv).curve_uv
    near = int(np.argmin(np.linalg.norm(curve - last.uv, axis=1)))
    a, b = ideal(LENS, curve[[near - 1, near + 1]])
    across = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
    moved = CAMERA.project(np.append((ideal(LENS, last.uv[None])[0] + 3 * across - (322, 238)) / (450, 455), 1.0)[None])
    assert abs(epipolar(LENS, *poses, first.uv, moved[0]).distance_px - 3) < 1e-3


def test_a_camera_that_only_turns_has_no_epipolar_line():
    turned = pose(2) @ Pose.from_rotvec(np.array([0.0, 0.1, 0.0]), np.zeros(3))
    assert np.isnan(epipolar(LENS, pose(2), turned, seen_from(2)[STAYS], np.array([300.0, 200.0])).distance_px)


def test_the_point_is_the_newest_landmark_and_fits():
    found = estimate(exact(), LENS, RIG, 0.5)
    assert found is not None and found.from_exposure == 9
    np.testing.assert_array_equal(found.xyz_in_world, POINTS[STAYS])
    assert found.residuals_px.max() < 1e-6


def test_without_a_landmark_the_observations_say_where_it_is():
    alone = replace(exact(), observations=tuple(replace(s, xyz_in_world=None) for s in exact().observations))
    found = estimate(alone, LENS, RIG, 0.5)
    assert found is not None and found.from_exposure is None
    np.testing.assert_allclose(found.xyz_in_world, POINTS[STAYS], atol=1e-6)


def test_an_exposure_that_lost_the_track_has_no_residual():
    found = estimate(exact(LEAVES), LENS, RIG, 0.5)
    assert found is not None and np.isnan(found.residuals_px[-1]) and np.isfinite(found.residuals_px[:-1]).all()


def test_a_point_that_is_a_pixel_off_has_a_residual_of_a_pixel():
    here = pose(4).inverse().apply(POINTS[STAYS])
    moved = pose(4).apply(here + np.array([here[2] / CAMERA.fx, 0, 0]))
    assert abs(residuals(exact(), LENS, moved)[4] - 1) < 1e-9


def test_the_lens_that_the_method_found_is_taken_into_account():
    lens = Lens(CAMERA, np.array([0.002, 0.01]))
    seen = tuple(
        replace(s, uv=lens.project(pose(s.index).inverse().apply(POINTS[STAYS][None]))[0]) for s in exact().observations
    )
    found = estimate(replace(exact(), observations=seen), lens, RIG, 0.5)
    assert found is not None and found.residuals_px.max() < 1e-5


def test_the_covariance_is_that_of_many_noisy_intersections():
    sigma_px, rng = 0.5, np.random.default_rng(0)
    lens = Lens(replace(CAMERA, distortion=()), np.zeros(2))  # where pixels of the image are ideal ones
    flat = (replace(s, uv=ideal(LENS, s.uv[None])[0], xyz_in_world=None) for s in exact().observations)
    alone = replace(exact(), observations=tuple(flat))
    said = estimate(alone, lens, RIG, sigma_px)
    found = []
    for noise in rng.normal(0, sigma_px, (200, len(alone.observations), 2)):
        seen = (replace(s, uv=s.uv + moved) for s, moved in zip(alone.observations, noise, strict=True))
        sample = estimate(replace(alone, observations=tuple(seen)), lens, RIG, sigma_px)
        assert sample is not None
        found.append(sample.xyz_in_world)
    assert said is not None and said.covariance is not None
    expected = np.sqrt(np.linalg.eigvalsh(said.covariance))
    np.testing.assert_allclose(np.sqrt(np.linalg.eigvalsh(np.cov(np.transpose(found)))), expected, rtol=0.15)


def test_one_view_leaves_the_distance_open_and_a_disparity_closes_it():
    one = [pose(0)]
    assert covariance(POINTS[STAYS], one, LENS, 0.5, np.array([np.nan])) is None
    baseline_m, depth = 0.4, pose(0).inverse().apply(POINTS[STAYS])[2]
    found = covariance(POINTS[STAYS], one, LENS, 0.5, np.array([20.0]), baseline_m)
    assert found is not None
    away = pose(0).rotation[:, 2]
    np.testing.assert_allclose(
        np.sqrt(away @ found @ away), np.sqrt(2) * 0.5 * depth**2 / (CAMERA.fx * baseline_m), rtol=0.3
    )


def test_poses_are_those_known_at_the_exposure_shown():
    model = RunModel.start(("monocular",))
    for record in RECORDS:
        model = model.after(record.index, record.time_ns, record.steps)
    shifted = Trajectory.of([(3, Pose(translation=np.array([0, 0, 9.0])) @ pose(3))], "video")
    model = model.after(COUNT, COUNT, (replace(RECORDS[-1].steps[0], time_ns=COUNT, revised=shifted),))
    found = revised(exact(), model, RIG)
    assert found.observations[3].world_from_camera.translation[2] == pose(3).translation[2] + 9
    assert np.array_equal(found.observations[4].world_from_camera.matrix, pose(4).matrix)
