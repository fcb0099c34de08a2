"""Matching of descriptors: in pieces as at once."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.features import descriptors
from ispom.features.descriptors import match_near
from ispom.features.front_ends import front_end
from ispom.features.interfaces import Features
from ispom.features.sift import SIFT_MATCHER

MATCHER = replace(SIFT_MATCHER, min_similarity=0.9, max_ratio=0.9**2)


def features(count: int, seed: int) -> Features:
    rng = np.random.default_rng(seed)
    vectors = rng.random((count, 128)).astype(np.float32)
    return Features(rng.random((count, 2)), vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def test_in_pieces_as_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = features(300, 0), features(250, 1)
    seen = np.random.default_rng(2).permutation(250)[:100]
    a.descriptors[50:150] = b.descriptors[seen]
    whole = MATCHER.match(a, b)
    assert {(50 + i, j) for i, j in enumerate(seen.tolist())} <= {(i, j) for i, j in whole.tolist()}
    monkeypatch.setattr(descriptors, "ROWS_AT_ONCE", 64)
    np.testing.assert_array_equal(MATCHER.match(a, b), whole)


def test_a_point_that_is_there_twice_is_ambiguous() -> None:
    a, b = features(40, 3), features(30, 4)
    a.descriptors[7] = b.descriptors[12] = b.descriptors[13]
    assert 7 not in MATCHER.match(a, b)[:, 0]


def test_one_feature_matches_nothing() -> None:
    assert len(MATCHER.match(features(1, 0), features(9, 1))) == 0


def test_near_where_it_is_expected_the_most_similar_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = features(100, 0), features(120, 1)
    place = 100 * np.random.default_rng(2).permutation(120)[:100]
    b.uv[:] = np.column_stack([100 * np.arange(120), np.zeros(120)])
    expected = np.column_stack([place + 3.0, np.zeros(100)])
    b.descriptors[place // 100] = a.descriptors
    expected[7], expected[8], a.descriptors[9] = np.nan, 9e9, -a.descriptors[9]
    expected[11], a.descriptors[11] = expected[10], 0.95 * a.descriptors[10]
    wanted = [(i, j // 100) for i, j in enumerate(place.tolist()) if i not in (7, 8, 9, 11)]
    for rows in (512, 16):
        monkeypatch.setattr(descriptors, "ROWS_AT_ONCE", rows)
        found = match_near(MATCHER, a, b, expected, 5.0)
        assert sorted(map(tuple, found.tolist())) == wanted
    assert len(match_near(MATCHER, a, b, expected - 10, 5.0)) == 0
    assert len(match_near(MATCHER, a, features(0, 0), expected, 5.0)) == 0


@pytest.mark.parametrize("name", ["sift", "orb", "surf"])
def test_points_are_found_where_the_contrast_is_low_too(name: str) -> None:
    """ORB had none there: corners of high contrast, each on several levels of its pyramid, were all its candidates."""
    noise = np.random.default_rng(0).normal(size=(480, 640))
    texture = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2))
    contrast = np.where(np.arange(640) < 320, 40, 12)
    image = np.clip(128 + contrast * texture / texture.std(), 0, 255).astype(np.uint8)
    found = front_end(name).detector.detect(image, 600, np.zeros((0, 2), np.float32), 8.0)
    assert len(found) > 450 and (found[:, 0] > 320).sum() > 100
