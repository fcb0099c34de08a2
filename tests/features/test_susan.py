"""SUSAN: the corners of an exact square, whatever its brightness, and none on an edge, a line or in noise."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.features.susan import OFFSETS, Susan, response
from ispom.types import Image

NOWHERE = np.zeros((0, 2), np.float32)
CORNERS = {(40, 30), (89, 30), (40, 69), (89, 69)}
"""First and last pixels of the square."""


def square(background: int = 60, contrast: int = 100) -> Image:
    image = np.full((100, 120), background, np.uint8)
    image[30:70, 40:90] += np.uint8(contrast)
    return image


def found(image: Image) -> set[tuple[int, int]]:
    return {(int(u), int(v)) for u, v in Susan().detect(image, 50, NOWHERE, 5.0)}


def test_the_mask_is_the_circle_of_37_pixels() -> None:
    assert len(OFFSETS) == 37 and (np.linalg.norm(OFFSETS, axis=1) < 3.4).all()
    assert not OFFSETS.sum(axis=0).any()


@pytest.mark.parametrize("contrast", [60, 100, 190])
def test_the_corners_of_a_square_are_found_to_the_pixel(contrast: int) -> None:
    assert found(square(contrast=contrast)) == CORNERS


@pytest.mark.parametrize("brighter", [5, 50, 90])
def test_added_brightness_changes_nothing(brighter: int) -> None:
    np.testing.assert_array_equal(response(square()), response(square(60 + brighter)))
    assert found(square(60 + brighter)) == CORNERS


def test_an_edge_and_a_line_have_no_corners_in_between() -> None:
    image = square()
    image[10] = 160  # a line from border to border
    strength = response(image)
    assert not strength[27:73, 50:80].any() and not strength[10, 5:-5].any()


def test_moderate_noise_neither_makes_corners_nor_hides_them() -> None:
    noisy = np.clip(square() + np.random.default_rng(0).normal(0, 2, (100, 120)), 0, 255).astype(np.uint8)
    assert found(noisy) == CORNERS


def test_turned_corners_are_found_near_where_they_are() -> None:
    rows, columns = np.mgrid[:100, :120]
    diamond = np.where(np.abs(rows - 50) + np.abs(columns - 60) <= 30, 160, 60).astype(np.uint8)
    tips = np.array([[60, 20], [60, 80], [30, 50], [90, 50]])
    uv = Susan().detect(diamond, 50, NOWHERE, 5.0)
    distance = np.linalg.norm(uv[:, None] - tips, axis=2)
    assert len(uv) == 4 and distance.min(axis=0).max() <= 1
