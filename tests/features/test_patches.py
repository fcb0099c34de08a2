"""Patches are found again with sub-pixel accuracy, warped ones too; corners are spread."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.features.patches import align, warps_of
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Pose
from ispom.types import Camera


def texture() -> np.ndarray:
    noise = np.random.default_rng(0).uniform(0, 255, (240, 320)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.clip(128 + 6 * (smooth - smooth.mean()), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("taper_px", [np.inf, 3.0])
def test_a_turned_and_grown_patch_is_found(taper_px: float) -> None:
    image = texture()
    uv = detect_spread(image, 150, np.zeros((0, 2), np.float32), 10.0, 30)
    motion = cv2.getRotationMatrix2D((160, 120), 4.0, 1.12)
    motion[:, 2] += (0.37, -0.61)
    moved = np.asarray(cv2.warpAffine(image, motion, (320, 240), flags=cv2.INTER_CUBIC), np.uint8)
    true = uv @ motion[:, :2].T + motion[:, 2]
    warps = np.repeat(np.linalg.inv(motion[:, :2])[None], len(uv), axis=0)
    found, score = align(image, uv, moved, true + 1.0, warps, taper_px=taper_px)
    good = score > 0.9
    assert good.mean() > 0.7
    assert np.median(np.linalg.norm(found - true, axis=1)[good]) < 0.05


def test_a_patch_in_perspective_is_found_where_it_is() -> None:
    """Not as far beside as it bends."""
    image = texture()
    uv = detect_spread(image, 150, np.zeros((0, 2), np.float32), 10.0, 30).astype(np.float64)
    tilt = np.array([[1.03, 0.01, 1.4], [0.0, 1.05, -2.3], [0.0, 2.5e-3, 1.0]])  # as of a floor that is driven over
    moved = np.asarray(cv2.warpPerspective(image, tilt, (320, 240), flags=cv2.INTER_CUBIC), np.uint8)
    ahead = np.column_stack([uv, np.ones(len(uv))]) @ tilt.T
    true, back = ahead[:, :2] / ahead[:, 2:], np.linalg.inv(tilt)
    far = np.column_stack([true, np.ones(len(uv))]) @ back[2]
    warps = (back[None, :2, :2] - uv[:, :, None] * back[2, None, :2]) / far[:, None, None]
    bends = back[2, :2] / far[:, None]
    for how, least, most in (({"bends": bends}, 0.0, 0.008), ({}, 0.02, 1.0)):
        found, score = align(image, uv, moved, true + 0.5, warps, **how)
        good = score > 0.9
        assert good.mean() > 0.7
        assert least <= abs((found - true)[good, 1].mean()) < most


def test_what_moves_otherwise_at_its_border_leads_a_patch_less_astray_the_less_it_counts() -> None:
    """Something before the points, from 4 px beside them on, moves 0.6 px to the side; they do not."""
    image = texture()
    uv = np.array([(20.0 + 24 * i, 20.0 + 24 * j) for i in range(12) for j in range(9)])
    aside = np.float32([[1, 0, 0.6], [0, 1, 0]])
    before = np.asarray(cv2.warpAffine(image, aside, (320, 240), flags=cv2.INTER_CUBIC), np.uint8)
    moved, same = image.copy(), np.repeat(np.eye(2)[None], len(uv), axis=0)
    for u, v in uv.astype(int):
        moved[v - 8 : v + 9, u + 4 : u + 9] = before[v - 8 : v + 9, u + 4 : u + 9]
    wrong = []
    for taper_px in (np.inf, 4.0, 3.0):
        found, score = align(image, uv, moved, uv, same, taper_px=taper_px)
        assert (score > 0.8).mean() > 0.9
        wrong.append(np.median(found[:, 0] - uv[:, 0]))
    assert wrong[0] > 0.1 and wrong[1] < 0.8 * wrong[0] and wrong[2] < 0.65 * wrong[0], wrong


@pytest.mark.parametrize("taper_px", [np.inf, 3.0])
def test_a_brighter_image_makes_no_difference(taper_px: float) -> None:
    image = texture()
    uv = detect_spread(image, 100, np.zeros((0, 2), np.float32), 10.0, 30)
    same = np.repeat(np.eye(2)[None], len(uv), axis=0)
    found, score = align(image // 2, uv, image // 2 + 60, uv + 0.5, same, taper_px=taper_px)
    assert score.min() > 0.99 and np.abs(found - uv).max() < 0.02


def test_no_texture_and_no_room_score_minus_one() -> None:
    image = np.full((60, 60), 99, np.uint8)
    uv = np.array([[30.0, 30.0], [1.0, 1.0]])
    assert align(image, uv, image, uv, np.repeat(np.eye(2)[None], 2, axis=0))[1].tolist() == [-1.0, -1.0]


def test_warps_are_the_derivative_of_the_projection() -> None:
    camera = Camera(640, 480, 450.0, 455.0, 320.0, 240.0)
    pose = Pose.from_rotvec(np.array([0.02, -0.05, 0.1]), np.array([0.2, -0.1, 0.6]))
    p = np.array([[0.5, -0.3, 4.0]])
    columns = []
    for axis, focal in ((0, camera.fx), (1, camera.fy)):
        step = np.zeros((1, 3))
        step[0, axis] = 1e-3 * p[0, 2] / focal
        columns.append((camera.project(pose.apply(p + step)) - camera.project(pose.apply(p - step)))[0] / 2e-3)
    np.testing.assert_allclose(
        warps_of(camera, pose.rotation[None], pose.translation[None], p)[0][0], np.stack(columns, axis=1), rtol=1e-4
    )


def test_corners_keep_their_distance_and_fill_what_is_empty() -> None:
    image = texture()
    taken = np.random.default_rng(1).uniform((5, 5), (150, 235), (80, 2)).astype(np.float32)
    uv = detect_spread(image, 160, taken, 9.0)
    every = np.concatenate([taken, uv])
    distance = np.linalg.norm(every[:, None] - uv[None], axis=2)
    distance[np.arange(len(taken), len(every)), np.arange(len(uv))] = np.inf
    assert distance.min() >= 8.0
    assert (uv[:, 0] > 160).mean() > 0.55 and len(uv) <= 80
