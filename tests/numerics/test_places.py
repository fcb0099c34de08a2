"""Ids are found where they stand."""

from __future__ import annotations

import numpy as np

from ispom.numerics.places import common, places


def test_known_ids_have_a_place_and_others_none() -> None:
    known = np.array([2, 3, 7, 11])
    assert places(known, np.array([11, 2, 5, 99, 0, 7])).tolist() == [3, 0, -1, -1, -1, 2]
    assert places(known[:0], np.array([1, 2])).tolist() == [-1, -1]
    assert places(known, known[:0]).tolist() == []


def test_common_ids_stand_at_these_places_in_both_lists() -> None:
    a, b = np.array([2, 3, 7, 11]), np.array([0, 3, 5, 11, 12])
    here, there = common(a, b)
    assert (here.tolist(), there.tolist()) == ([1, 3], [1, 3])
    assert all(not len(found) for found in common(a, b[:0])) and all(not len(found) for found in common(a[:0], b))
