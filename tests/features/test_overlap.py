"""Points are found in a second camera that is turned and displaced."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.features.overlap import Overlap
from ispom.geometry import Pose
from ispom.types import Camera, Image

CAMERA = Camera(320, 240, 190.0, 190.0, 159.5, 119.5)
TURNED = Pose.from_rotvec(np.array([0.02, np.radians(40), 0.01]), np.array([0.4, 0.0, 0.1]))
"""first_from_second."""
DEPTH_M = 5.0


def texture() -> Image:
    rng = np.random.default_rng(0)
    coarse = cv2.resize(rng.integers(0, 256, (200, 400)).astype(np.uint8), (1600, 800), interpolation=cv2.INTER_CUBIC)
    return np.asarray(cv2.GaussianBlur(coarse, (0, 0), 1.5), np.uint8)


def wall(first_from_camera: Pose) -> Image:
    """A textured plane at z = 5 m of the first camera, 100 px a metre."""
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays, _ = CAMERA.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    turned = rays @ first_from_camera.rotation.T
    reach = (DEPTH_M - first_from_camera.translation[2]) / turned[:, 2]
    at = first_from_camera.translation + reach[:, None] * turned
    columns, rows = (100 * at[:, 0] + 700).reshape(u.shape), (100 * at[:, 1] + 400).reshape(u.shape)
    pixels = columns.astype(np.float32), rows.astype(np.float32)
    return np.asarray(cv2.remap(texture(), *pixels, cv2.INTER_LINEAR), np.uint8)


def test_points_of_a_wall_are_found_where_they_are() -> None:
    overlap = Overlap.of(CAMERA, CAMERA, TURNED)
    assert overlap is not None and 0.3 < overlap.visible.mean() < 0.7
    u, v = np.meshgrid(np.arange(20.0, 310, 20), np.arange(20.0, 230, 20))
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)
    xy, found = overlap.match(wall(Pose()), wall(TURNED), uv, 2.0)
    expected = TURNED.inverse().apply(DEPTH_M * np.column_stack([CAMERA.normalise(uv), np.ones(len(uv))]))
    seen = expected[:, 2] > 0.1
    seen[seen] = (np.abs(CAMERA.project(expected[seen]) - (159.5, 119.5)) < (140, 100)).all(axis=1)
    assert seen.sum() > 40
    assert found[seen].mean() > 0.8
    errors_px = 190 * np.linalg.norm(xy[found] - expected[found, :2] / expected[found, 2:], axis=1)
    assert np.median(errors_px) < 0.3 and (errors_px < 2).mean() > 0.97
    assert not found[expected[:, 2] < 0].any()


def test_images_without_texture_have_no_matches() -> None:
    overlap, blank = Overlap.of(CAMERA, CAMERA, TURNED), np.full((240, 320), 90, np.uint8)
    assert overlap is not None
    for uv in (np.array([[250, 100], [200, 50]], np.float32), np.zeros((0, 2), np.float32)):
        xy, found = overlap.match(blank, blank, uv, 2.0)
        assert xy.shape == uv.shape and not found.any()


def test_cameras_that_look_apart_have_no_overlap() -> None:
    assert Overlap.of(CAMERA, CAMERA, Pose.from_rotvec(np.array([0, np.pi, 0]), np.zeros(3))) is None
    assert Overlap.of(CAMERA, CAMERA, Pose.from_rotvec(np.array([0, np.radians(85), 0]), np.zeros(3))) is None
