"""How noisy an image is, and where it shows more than that."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.features.shi_tomasi import detect_spread, grey_noise
from ispom.types import Image

NONE = np.zeros((0, 2), np.float32)
HEIGHT, WIDTH = 240, 320


def with_noise(image: NDArray[np.float64], sigma: float, seed: int = 0) -> Image:
    noise = np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image + sigma * noise), 0, 255).astype(np.uint8)


def clouds(seed: int, softness_px: float, contrast: float) -> NDArray[np.float64]:
    blurred = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((HEIGHT, WIDTH)), (0, 0), softness_px)
    return 128 + contrast * blurred / blurred.std()


def squares(seed: int) -> NDArray[np.float64]:
    return np.kron(np.random.default_rng(seed).uniform(60, 200, (HEIGHT // 10, WIDTH // 10)), np.ones((10, 10)))


@pytest.mark.parametrize("sigma", [0.7, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("scene", ["even", "ramp", "clouds", "squares"])
def test_the_noise_is_found_whatever_else_is_seen(sigma: float, scene: str) -> None:
    image = {
        "even": np.full((HEIGHT, WIDTH), 90.0),
        "ramp": np.add.outer(0.2 * np.arange(HEIGHT), 0.3 * np.arange(WIDTH)) + 30,
        "clouds": clouds(1, 30, 30),
        "squares": squares(1),
    }[scene]
    image = np.where(np.arange(WIDTH) < WIDTH // 2, 90.0, image)
    assert grey_noise(with_noise(image, sigma)) == pytest.approx(sigma, rel=0.1)


def test_no_noise_is_found_where_there_is_none_or_no_room() -> None:
    assert grey_noise(np.full((HEIGHT, WIDTH), 90, np.uint8)) == 0.0
    assert grey_noise(with_noise(np.full((15, 400), 90.0), 2)) == 0.0


def test_corners_are_looked_for_where_there_is_more_than_noise() -> None:
    image, sky = squares(2), slice(0, HEIGHT // 2)
    image[sky] = clouds(2, 30, 20)[sky]
    found = detect_spread(with_noise(image, 2.0), 300, NONE, 8.0)
    assert (found[:, 1] < HEIGHT // 2 - 8).sum() <= 3
    assert (found[:, 1] > HEIGHT // 2).sum() > 120


def test_what_is_faint_is_found_where_there_is_little_noise() -> None:
    image, wall = squares(3), slice(0, HEIGHT // 2)
    image[wall] = 128 + (image[wall] - 128) / 10
    found = detect_spread(with_noise(image, 0.3), 300, NONE, 8.0)
    assert (found[:, 1] < HEIGHT // 2 - 8).sum() > 80


def test_in_the_dark_what_is_faint_has_to_do() -> None:
    image = with_noise(0.1 * squares(4), 3.0)
    assert len(detect_spread(image, 300, NONE, 8.0)) > 200
