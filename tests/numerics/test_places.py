"""Ids are found where they stand."""

from __future__ import annotations

import numpy as np

from ispom.numerics.places import places


def test_known_ids_have_a_place_and_others_none() -> None:
    known = np.array([2, 3, 7, 11])
    assert places(known, np.array([11, 2, 5, 99, 0, 7])).tolist() == [3, 0, -1, -1, -1, 2]
    assert places(known[:0], np.array([1, 2])).tolist() == [-1, -1]
    assert places(known, known[:0]).tolist() == []
