"""The contract of camera models as a test."""

from __future__ import annotations

import numpy as np

from ispom.cameras import Camera

GRID = 15
"""Pixels along each side that are tried."""
DEPTHS = (0.2, 3.0, 500.0)
STEP = 1e-6
"""Of the difference quotients, relative to the depth."""
FAR_PX = 1e-2
"""A pixel is projected back at most so far from where it was."""
FAR_JACOBIAN = 1e-4
"""Difference of a Jacobian from difference quotients, relative to its largest entry."""


def check_camera_model(camera: Camera) -> None:
    """Checks the model of a camera over its whole image.

    Rays of valid pixels are unit vectors that are projected back onto them at every depth; at least half of the pixels
    are valid. Jacobians are those of difference quotients. A point behind the camera has neither a pixel nor a
    Jacobian, unless the model sees all around. Raises AssertionError with one sentence for what does not hold.
    """
    model = camera.model
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, GRID), np.linspace(0, camera.height - 1, GRID))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    rays, valid = camera.unproject(uv)
    _require(rays.shape == (len(uv), 3) and valid.shape == (len(uv),), camera, "unprojects to arrays of other shapes")
    _require(valid.mean() >= 0.5, camera, "has no ray for more than half of its pixels")
    rays, uv = rays[valid], uv[valid]
    _require(np.allclose(np.linalg.norm(rays, axis=1), 1), camera, "unprojects to rays that are not of length 1")
    for depth in DEPTHS:
        away_px = np.linalg.norm(camera.project(depth * rays) - uv, axis=1).max()
        _require(away_px <= FAR_PX, camera, f"projects rays {away_px:.2g} px from their pixels")
        jacobian = camera.project_jacobian(depth * rays)
        steps = depth * STEP * np.eye(3)
        quotients = [camera.project(depth * rays + h) - camera.project(depth * rays - h) for h in steps]
        expected = np.stack(quotients, axis=2) / (2 * depth * STEP)
        _require(jacobian.shape == expected.shape, camera, "has Jacobians of another shape than (N, 2, 3)")
        away = np.abs(jacobian - expected).max() / np.abs(expected).max()
        _require(away <= FAR_JACOBIAN, camera, f"has Jacobians that differ by {away:.2g} from difference quotients")
    flat = camera.normalise(uv)
    ahead = rays[:, 2] > 0.1
    expected = rays[ahead, :2] / rays[ahead, 2:]
    _require(np.allclose(flat[ahead], expected, atol=1e-6), camera, "normalises pixels to other places than its rays")
    behind = np.array([[0.0, 0.0, -1.0]])
    nothing = np.isnan(camera.project(behind)).all() and np.isnan(camera.project_jacobian(behind)).all()
    _require(nothing or model.all_around, camera, "projects a point right behind it")
    empty = camera.project(np.zeros((0, 3))), camera.normalise(np.zeros((0, 2)))
    _require(all(result.shape == (0, 2) for result in empty), camera, "does not take in no points at all")
    _require(len(camera.distortion) in (0, *model.counts), camera, "has a number of coefficients that it does not name")


def _require(condition: object, camera: Camera, what: str) -> None:
    if not condition:
        raise AssertionError(f"camera model {camera.model.name} {what}")
