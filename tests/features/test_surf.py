"""SURF: exact sums of boxes, blobs of known place and size, and the same points in turned and scaled images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.features.surf import SCALE, Integral, Surf, without_signs
from ispom.geometry import Array
from ispom.types import Image

SIDE = 320


def texture(seed: int = 0) -> Image:
    """Blobs of many sizes."""
    rng, image = np.random.default_rng(seed), np.zeros((SIDE, SIDE), np.float32)
    for sigma in (2, 4, 8, 16):
        layer = cv2.GaussianBlur(rng.normal(0, 1, image.shape).astype(np.float32), (0, 0), sigma)
        image += layer / layer.std()
    return np.clip(128 + 30 * image, 0, 255).astype(np.uint8)


def turned(image: Image, degrees: float, scale: float) -> tuple[Image, Array]:
    """The image turned and scaled about its centre, and the affine map (2, 3) of its pixels."""
    middle = (SIDE - 1) / 2
    matrix = np.asarray(cv2.getRotationMatrix2D((middle, middle), degrees, scale), float)
    flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    smooth = cv2.GaussianBlur(image, (0, 0), 0.5 / scale) if scale < 1 else image
    return np.asarray(cv2.warpAffine(smooth, matrix, (SIDE, SIDE), flags=flags, borderValue=128), np.uint8), matrix


def positions(keypoints: list[cv2.KeyPoint]) -> Array:
    return np.array([k.pt for k in keypoints])


def test_boxes_with_fractional_sides_have_the_exact_sum() -> None:
    image = texture()[:20, :30]
    integral, values = Integral.of(image), image - image.mean()

    def below(u: float, v: float) -> float:
        return float(integral.at(np.array([[u]]), np.array([[v]]))[0, 0])

    assert below(6.5, 3.5) == pytest.approx(values[:4, :7].sum(), abs=0.1)
    parts = values[:4, :7].sum() + 0.25 * values[:4, 7].sum() + 0.5 * values[4, :7].sum() + 0.125 * values[4, 7]
    assert below(6.75, 4.0) == pytest.approx(parts, abs=0.1)


def test_haar_wavelets_of_a_ramp_are_its_slopes() -> None:
    rows, columns = np.mgrid[:60, :60]
    ramp = (2 * columns + rows).astype(np.uint8)
    half = np.array([[4.0]])
    x, y = Integral.of(ramp).wavelets(np.array([[30.0]]), np.array([[25.3]]), half)
    # The means of two halves of a side of 8 px are 4 px apart, and each has 32 px^2.
    assert x[0, 0] == pytest.approx(2 * 4 * 32, rel=1e-4) and y[0, 0] == pytest.approx(4 * 32, rel=1e-4)


@pytest.mark.parametrize("sigma", [3.0, 4.0, 5.5, 7.0])
def test_a_blob_is_found_where_it_is_and_with_a_size_in_proportion(sigma: float) -> None:
    rows, columns = np.mgrid[:160, :160]
    blob = 60 + 150 * np.exp(-((columns - 81.3) ** 2 + (rows - 74.6) ** 2) / (2 * sigma**2))
    best = Surf(1).detect(blob.astype(np.uint8))[0]
    assert np.linalg.norm(np.array(best.pt) - (81.3, 74.6)) < 0.15 * sigma
    # Boxes of the side 9 smooth as Gaussians of 1.5 px do, not of the 1.2 px that they are named by.
    assert best.size * SCALE == pytest.approx(0.72 * sigma, rel=0.06)


TURNS = [(0.0, 1.0), (35.0, 1.0), (90.0, 1.0), (160.0, 1.0), (0.0, 0.75), (20.0, 1.4)]


@pytest.mark.parametrize(("degrees", "scale"), TURNS)
def test_points_are_repeated_and_matched_in_turned_and_scaled_images(degrees: float, scale: float) -> None:
    image = texture()
    other, matrix = turned(image, degrees, scale)
    keypoints, described = Surf(300).detectAndCompute(image)
    others, other_described = Surf(500).detectAndCompute(other)
    there, seen = positions(list(keypoints)) @ matrix[:, :2].T + matrix[:, 2], positions(list(others))
    inside = np.linalg.norm(there - SIDE / 2, axis=1) < 0.5 * SIDE - 30
    inside &= np.linalg.norm(positions(list(keypoints)) - SIDE / 2, axis=1) < 0.5 * SIDE - 30
    distance = np.linalg.norm(there[:, None] - seen[None], axis=2)
    assert inside.sum() > 40 and (distance[inside].min(axis=1) < 2 * max(scale, 1)).mean() > 0.7
    nearest = (described @ other_described.T).argmax(axis=1)
    right = distance[np.arange(len(nearest)), nearest] < 3 * max(scale, 1)
    assert right[inside].mean() > 0.6
    sizes = np.array([others[i].size for i in nearest]) / np.array([k.size for k in keypoints])
    assert np.median(sizes[right & inside]) == pytest.approx(scale, rel=0.1)
    angles = np.array([others[i].angle for i in nearest]) - np.array([k.angle for k in keypoints]) + degrees
    assert np.median(np.abs((angles[right & inside] + 180) % 360 - 180)) < 6


def test_contrast_and_brightness_do_not_change_descriptors() -> None:
    image = texture()
    darker = np.rint(0.5 * image + 20).astype(np.uint8)
    keypoints = Surf(100).detect(image)
    here, there = (Surf(100).compute(i, keypoints)[1] for i in (image, darker))
    assert ((here * there).sum(axis=1) > 0.99).mean() > 0.98


def test_descriptors_without_signs_are_as_far_from_one_another() -> None:
    _, described = Surf(60).detectAndCompute(texture())
    changed = without_signs(described)
    assert described.shape[1] == 64 and (changed >= 0).all()
    np.testing.assert_allclose(changed @ changed.T, described @ described.T, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(changed, axis=1), 1, atol=1e-5)


def test_an_image_without_texture_has_no_points() -> None:
    assert Surf(100).detect(np.full((120, 160), 90, np.uint8)) == []
    keypoints, described = Surf(100).detectAndCompute(np.full((8, 9), 90, np.uint8))
    assert len(keypoints) == 0 and described.shape == (0, 64)
