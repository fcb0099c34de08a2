"""Matching of descriptors: in pieces as at once."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.frontends import sift


def features(count: int, seed: int) -> sift.Features:
    rng = np.random.default_rng(seed)
    descriptors = rng.random((count, 128)).astype(np.float32)
    return sift.Features(rng.random((count, 2)), descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True))


def test_in_pieces_as_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = features(300, 0), features(250, 1)
    seen = np.random.default_rng(2).permutation(250)[:100]
    a.descriptors[50:150] = b.descriptors[seen]
    whole = sift.match(a, b)
    assert {(50 + i, j) for i, j in enumerate(seen.tolist())} <= {(i, j) for i, j in whole.tolist()}
    monkeypatch.setattr(sift, "ROWS_AT_ONCE", 64)
    np.testing.assert_array_equal(sift.match(a, b), whole)


def test_a_point_that_is_there_twice_is_ambiguous() -> None:
    a, b = features(40, 3), features(30, 4)
    a.descriptors[7] = b.descriptors[12] = b.descriptors[13]
    assert 7 not in sift.match(a, b)[:, 0]


def test_one_feature_matches_nothing() -> None:
    assert len(sift.match(features(1, 0), features(9, 1))) == 0
