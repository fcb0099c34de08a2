"""Patches of slanted surfaces are found in the right image, with their slants; what sees two surfaces is told."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.features.slanted import Slanted, align_slanted, slanted_warps
from ispom.geometry import Array, Pose
from ispom.types import Camera

SIZE = 240, 320


def texture(across_px: float = 2.0, contrast: float = 25.0, seed: int = 2) -> Array:
    noise = np.random.default_rng(seed).uniform(0, 255, SIZE).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), across_px, sigmaY=2.0)
    return 128 + contrast * (smooth - smooth.mean()) / smooth.std()


def grid() -> Array:
    """(N, 2) [px] away from the border."""
    return np.stack(np.meshgrid(np.arange(60.0, 260, 13), np.arange(20.0, 220, 13)), axis=-1).reshape(-1, 2) + 0.3


def seen(image: Array, noise: float, seed: int = 0) -> np.ndarray:
    grey = image + np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(grey, 0, 255).round().astype(np.uint8)


def plane(wider: float, sheared: float, noise: float = 1.0) -> tuple[Slanted, Array]:
    """What is found of a plane whose right image is wider by a share, and moves to the right from row to row; and where
    it is. From 1 px beside."""
    left = texture()
    across, down = (v.astype(np.float32) for v in np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0])))
    middle = np.array([160.0, 120.0])
    back = (across - middle[0] - sheared * (down - middle[1])) / (1 + wider) + middle[0]
    right = cv2.remap(left, back.astype(np.float32), down, cv2.INTER_CUBIC)
    uv = grid()
    true = uv.copy()
    true[:, 0] = middle[0] + (1 + wider) * (uv[:, 0] - middle[0]) + sheared * (uv[:, 1] - middle[1])
    inside = (true[:, 0] > 30) & (true[:, 0] < SIZE[1] - 30)
    start = (true + np.array([1.0, 0.0])).astype(np.float32)
    found = align_slanted(seen(left, noise), uv.astype(np.float32), seen(right, noise, 1), start)
    return Slanted(*(values[inside] for values in found)), true[inside]


@pytest.mark.parametrize(("wider", "sheared"), [(0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.0, -0.33), (-0.2, 0.3)])
def test_place_and_slant_of_a_plane_are_found(wider: float, sheared: float) -> None:
    found, true = plane(wider, sheared)
    good = found.correlation > 0.9
    off = (found.uv - true)[good]
    assert good.mean() > 0.95
    assert np.median(np.abs(off)) < 0.03 and np.percentile(np.abs(off), 95) < 0.12
    np.testing.assert_allclose(np.median(found.slants[good], axis=0), (wider, sheared), atol=0.01)


@pytest.mark.parametrize(("along", "least", "most"), [(2.0, 0.01, 0.03), (4.0, 0.03, 0.07)])
def test_matches_are_as_far_off_as_the_patches_predict(along: float, least: float, most: float) -> None:
    """By noise alone, where texture is fine and where it is coarse along u, but above the noise."""
    image, uv = texture(along), grid()
    found = align_slanted(seen(image, 1.0), uv.astype(np.float32), seen(image, 1.0, 1), uv.astype(np.float32))
    told = found.deviations
    assert least < np.median(told) < most
    assert 1.2 < np.median(found.differences) < 1.7, "of two images with noise of 1 grey level, and rounded"
    ratio = (found.uv - uv)[:, 0] / told
    assert 0.8 < 1.48 * np.median(np.abs(ratio)) < 1.25


def test_what_sees_two_surfaces_differs_and_is_less_sure() -> None:
    image = texture()
    right = np.roll(image, -6, axis=1)
    right[:, 150:] = np.roll(image, -2, axis=1)[:, 150:]
    uv = np.array([[100.0, 120.0], [155.0, 120.0]], np.float32)
    found = align_slanted(seen(image, 1.0), uv, seen(right, 1.0, 1), uv - np.array([[6, 0], [4, 0]], np.float32))
    assert found.differences[1] > 3 * found.differences[0]
    assert found.deviations[1] > 3 * found.deviations[0]


def test_a_brighter_image_makes_no_difference() -> None:
    image, uv = texture(contrast=20.0), grid().astype(np.float32)
    found = align_slanted(seen(image - 20, 0.0), uv, seen(image + 20, 0.0), uv + 0.5)
    assert found.correlation.min() > 0.99 and np.abs(found.uv - uv).max() < 0.03


def test_no_texture_no_room_and_an_edge_alone_are_not_found() -> None:
    flat, uv = np.full(SIZE, 99, np.uint8), np.array([[100.0, 100.0], [2.0, 100.0]], np.float32)
    found = align_slanted(flat, uv, flat, uv)
    assert (found.correlation == -1).all() and np.isinf(found.deviations).all() and np.isinf(found.differences).all()
    edge = np.tile(np.where(np.arange(SIZE[1]) < 100, 50, 200).astype(np.uint8), (SIZE[0], 1))
    assert align_slanted(edge, uv[:1], edge, uv[:1]).correlation[0] == -1
    narrow = np.ascontiguousarray(seen(texture(), 0.0)[:, :30])
    assert (
        align_slanted(narrow, np.full((1, 2), 15, np.float32), narrow, np.full((1, 2), 15, np.float32))[2] == -1
    ).all()


def test_warps_are_those_of_a_plane_in_perspective() -> None:
    camera, baseline = Camera(640, 480, 450.0, 455.0, 320.0, 240.0), 0.4
    pose = Pose.from_rotvec(np.array([0.02, -0.05, 0.1]), np.array([0.2, -0.1, -0.6]))
    normal, height = np.array([0.1, 0.9, 0.1]), 1.6  # n . x = h

    def on_plane(uv: Array) -> Array:
        rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
        return rays * (height / (rays @ normal))[:, None]

    def in_right(uv: Array) -> Array:
        return camera.project(on_plane(uv) - (baseline, 0, 0))

    uv, steps = np.array([[350.0, 330.0]]), np.eye(2)[:, None] * 1e-3
    slants = np.array([[(in_right(uv + s) - in_right(uv - s))[0, 0] / 2e-3 for s in steps]]) - (1.0, 0.0)
    warps, bends, known = slanted_warps(camera, pose, camera.normalise(uv), on_plane(uv)[:, 2], slants, baseline)
    assert known.all()
    beside = np.array([[12.0, 0.0], [-9.0, 7.0], [0.0, -12.0]])
    there = camera.project(pose.apply(on_plane(uv + beside))) - camera.project(pose.apply(on_plane(uv)))
    np.testing.assert_allclose(there @ warps[0].T / (1 + there @ bends[0])[:, None], beside, atol=1e-4)
    assert np.abs(there @ warps[0].T - beside).max() > 0.1, "without how they bend"
    behind = Pose(np.eye(3), np.array([0.0, 0.0, -50.0]))
    assert not slanted_warps(camera, behind, camera.normalise(uv), on_plane(uv)[:, 2], slants, baseline)[2].any()
