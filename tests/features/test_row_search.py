"""Disparities of single points, with a guess and without."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.features.row_search import PointSearch


@pytest.mark.parametrize("width", [500, 1000])
@pytest.mark.parametrize("disparity", [3.25, 41.5])
def test_a_shifted_image_has_that_disparity(width: int, disparity: float) -> None:
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.integers(0, 256, (200, width + 100)).astype(np.float32), (0, 0), 2.0)
    texture = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX)
    left = texture[:, 50 : 50 + width].astype(np.uint8)
    shift = np.array([[1, 0, -disparity - 50], [0, 1, 0]], float)
    right = cv2.warpAffine(texture, shift, (width, 200), flags=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    uv = rng.uniform([80, 20], [width - 80, 180], (60, 2)).astype(np.float32)
    found = PointSearch().search(left, right, uv).disparity_px
    assert np.isfinite(found).mean() > 0.9
    np.testing.assert_allclose(found[np.isfinite(found)], disparity, atol=0.1)
    for near in (True, False):
        again = PointSearch().follow(left, right, uv, np.full(60, disparity + 1, np.float32), near)
        there = np.isfinite(again.disparity_px)
        assert there.mean() > 0.9
        np.testing.assert_allclose(again.disparity_px[there], disparity, atol=0.1)
        np.testing.assert_allclose(again.lower_px[there], 0, atol=0.1)
        assert np.abs(again.slants[there]).max() < 0.1


def test_a_repeating_row_is_not_decided() -> None:
    stripes = np.tile(np.repeat(np.array([0, 255], np.uint8), 8), (120, 30))
    uv = np.array([[240.0, 60.0], [250.0, 70.0]], np.float32)
    found = PointSearch().search(stripes, stripes, uv)
    assert np.isnan(found.disparity_px).all() and np.isinf(found.deviations_px).all()


def test_no_points() -> None:
    image = np.zeros((50, 60), np.uint8)
    none = np.zeros((0, 2), np.float32)
    assert PointSearch().search(image, image, none).disparity_px.shape == (0,)
    assert PointSearch().follow(image, image, none, none[:, 0]).slants.shape == (0, 2)
