"""Compiled errors of points in images, and their derivatives: against the camera's own projection."""

from __future__ import annotations

import numpy as np

from ispom.calibration.tracked.scene import LensPrior, Observations, Scene, scene_problem
from tests.calibration.tracked.scenes import LENS, tracks, wandering

RNG = np.random.default_rng(0)


def scene_and_seen() -> tuple[Scene, Observations]:
    """Points about as far before the camera as behind it, some of them nearly at infinity."""
    seen = tracks(0, views=5, points=60, noise_px=0.0).observations
    points = RNG.normal(0, 1, (int(seen.point.max()) + 1, 4)) * (1, 1, 2, 0.3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    poses = [wandering(v / 4).inverse() for v in range(5)]
    lens = np.array([np.log(LENS.fx), LENS.cx, LENS.cy, *LENS.distortion[:2]])
    return Scene(lens, np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]), points), seen


def test_errors_are_those_of_the_cameras_projection_and_none_behind_it() -> None:
    scene, seen = scene_and_seen()
    found, expected = scene.residuals_px(seen), scene.camera.project(scene.in_camera(seen)) - seen.uv
    assert 0.2 < np.isnan(found[:, 0]).mean() < 0.8
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_derivatives_are_differences_and_finite_behind_the_camera() -> None:
    scene, seen = scene_and_seen()
    problem = scene_problem(scene, seen, LensPrior(scene.lens, np.ones(5)), 1.0)
    family, step = problem.families[0], 1e-6
    found = family.derivatives(scene)
    assert np.isfinite(found.by_shared).all() and np.isfinite(found.by_block).all()
    way, own = RNG.normal(size=problem.shared), RNG.normal(size=(problem.blocks, problem.size))
    ends = [family.residuals(problem.moved(scene, sign * step * way, sign * step * own)) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * step)
    columns = np.where(found.columns >= 0, way[found.columns], 0.0)
    expected = np.einsum("kri,ki->kr", found.by_shared, columns) + np.einsum(
        "kri,ki->kr", found.by_block, own[found.block]
    )
    near = np.isfinite(slope).all(1) & (np.abs(expected).max(1) < 1e4)
    assert near.sum() > 50
    np.testing.assert_allclose(slope[near], expected[near], rtol=1e-5, atol=1e-3)
