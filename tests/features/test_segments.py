"""Segments of drawn squares at known places, and their matches and disparities on a plane."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from ispom.features.segments import Detector, detect_segments, disparity_along, match_segments
from ispom.types import Image

CORNERS = np.array([(60.3, 50.6), (180.7, 62.4), (170.2, 170.9), (52.8, 160.1)])


def drawn(corners: np.ndarray = CORNERS, shift: tuple[float, float] = (0, 0)) -> Image:
    """Returns a bright quadrangle on a dark, textured ground; edges are exact to a 16th of a pixel."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (240, 320)).astype(np.float32), (0, 0), 3)
    moved = cv2.warpAffine(
        ground, np.array([[1.0, 0, shift[0]], [0, 1, shift[1]]]), (320, 240), borderMode=cv2.BORDER_WRAP
    )
    image = np.clip(50 + 0.8 * (moved - 127), 0, 120)
    big = np.zeros((240 * 8, 320 * 8), np.float32)
    cv2.fillPoly(big, [np.rint((corners + shift + 0.5) * 8 * 16).astype(np.int32)], 1.0, shift=4)
    inside = cv2.resize(big, (320, 240), interpolation=cv2.INTER_AREA)
    return (
        np.asarray(image + inside * (210 - image) + rng.normal(0, 1, image.shape), np.float32)
        .clip(0, 255)
        .astype(np.uint8)
    )


def distance(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = (b - a) / np.linalg.norm(b - a)
    return np.abs((points - a) @ np.array([-along[1], along[0]]))


@pytest.mark.parametrize("detector", ["lsd", "hough", "canny"])
def test_the_sides_of_a_square_are_found_to_the_sub_pixel(detector: Detector) -> None:
    found = detect_segments(drawn(), detector, 40.0)
    for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        off = np.array([distance(segment, a, b).max() for segment in found])
        assert off.min() < 0.7
    lengths = np.linalg.norm(found[:, 1] - found[:, 0], axis=1)
    assert (lengths >= 40).all() and (np.diff(lengths) <= 0).all() and found.dtype == np.float32
    assert len(detect_segments(drawn(), detector, 40.0, most=2)) == 2


def exact(corners: np.ndarray, noise: float, seed: int = 0) -> Image:
    """Returns a bright quadrangle whose edges are those of a Gaussian blur, exactly; `corners` are clockwise."""
    v, u = np.mgrid[:240, :320]
    light = np.ones((240, 320))
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        x, y = (b - a) / np.linalg.norm(b - a)
        light *= norm.cdf(((v - a[1]) * x - (u - a[0]) * y) / 0.7)
    light = 50 + 140 * light + np.random.default_rng(seed).normal(0, 1, light.shape) * noise
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("noise", "limit_px"), [(0.0, 0.06), (4.0, 0.12)])
@pytest.mark.parametrize("detector", ["hough", "canny"])
def test_segments_of_edge_pixels_lie_on_the_exact_edges(detector: Detector, noise: float, limit_px: float) -> None:
    off, missed = list[float](), 0
    for k in range(10):
        angle, middle = 0.16 * k - 0.8, CORNERS.mean(axis=0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        corners = (CORNERS - middle) @ turn.T + middle + (0.1 * k, 0.07 * k)
        found = detect_segments(exact(corners, noise, k), detector, 40.0).astype(float)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            nearest = min((distance(segment, a, b).max() for segment in found), default=np.inf)
            missed += nearest > 1.5
            off += [nearest] if nearest <= 1.5 else []
    assert missed <= 1 and max(off) < limit_px and np.median(off) < limit_px / 2


@pytest.mark.parametrize("detector", ["hough", "canny"])
def test_each_edge_is_found_once(detector: Detector) -> None:
    found = detect_segments(exact(CORNERS, 0.0), detector, 60.0)
    assert len(found) == 4


@pytest.mark.parametrize("detector", ["lsd", "hough", "canny"])
def test_opposite_sides_of_a_square_have_opposite_directions(detector: Detector) -> None:
    found = detect_segments(drawn(), detector, 60.0)
    middle = CORNERS.mean(axis=0)
    along, outwards = found[:, 1] - found[:, 0], found.mean(axis=1) - middle
    side = np.sign(along[:, 0] * outwards[:, 1] - along[:, 1] * outwards[:, 0])
    assert len(found) >= 4 and abs(side.sum()) == len(found)


@pytest.mark.parametrize("detector", ["lsd", "hough", "canny"])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_an_image_without_texture_has_no_segments(detector: Detector, level: int) -> None:
    assert detect_segments(np.full((240, 320), level, np.uint8), detector).shape == (0, 2, 2)


def test_segments_are_matched_over_a_shift() -> None:
    before, now = drawn(), drawn(shift=(7.0, -4.0))
    old, new = detect_segments(before, min_length_px=40), detect_segments(now, min_length_px=40)
    match, followed = match_segments(before, now, old.astype(float), new)
    sides = [
        int(np.argmin([distance(s, a, b).max() for s in old]))
        for a, b in zip(CORNERS, np.roll(CORNERS, -1, 0), strict=True)
    ]
    assert (match[sides] >= 0).all()
    for n in sides:
        assert distance(new[match[n]] - (7.0, -4.0), *old[n].astype(float)).max() < 1.0
        assert distance(followed[n] - (7.0, -4.0), *old[n].astype(float)).max() < 1.5
    assert len(set(match[match >= 0])) == (match >= 0).sum()
    nothing, lost = match_segments(before, np.full_like(now, 90), old.astype(float), new)
    assert (nothing < 0).all() and lost.shape == old.shape


def test_the_disparity_along_a_segment_is_that_of_both_ends() -> None:
    left, right = drawn(), drawn(shift=(-12.0, 0.0))
    uv = detect_segments(left, min_length_px=40)
    disparity, sigma = disparity_along(left, right, uv)
    steep = np.abs(uv[:, 1, 1] - uv[:, 0, 1]) > 40
    assert np.isfinite(disparity[steep]).any()
    np.testing.assert_allclose(disparity[np.isfinite(disparity)], 12.0, atol=0.5)
    assert (sigma[np.isfinite(disparity)] < 1.5).all()
    nothing, _ = disparity_along(left, np.full_like(right, 90), uv)
    assert np.isnan(nothing).all()


@pytest.mark.parametrize("detector", ["hough", "canny"])
def test_a_texture_without_edges_has_no_long_segments(detector: Detector) -> None:
    rng = np.random.default_rng(4)
    ground = cv2.GaussianBlur(rng.normal(0, 1, (240, 320)).astype(np.float32), (0, 0), 1.5)
    image = np.clip(127 + 60 * ground / ground.std(), 0, 255).astype(np.uint8)
    assert len(detect_segments(image, detector, 25.0)) <= 2
