"""A list of any length is a value that can be copied, pickled and printed."""

from __future__ import annotations

import copy
import pickle

import pytest

from ispom.persistent_list import PersistentList


@pytest.fixture(scope="module")
def long() -> PersistentList[int]:
    return PersistentList[int]().extended(range(50_000))


def test_items_come_in_the_order_in_which_they_were_added(long: PersistentList[int]) -> None:
    assert list(long) == list(range(50_000))
    grown = PersistentList[int]()
    for n in range(2_100):
        assert len(grown) == n
        grown = grown.appended(n)
    assert list(grown) == list(range(2_100))


def test_what_was_there_stays_as_it_was_and_is_shared(long: PersistentList[int]) -> None:
    longer = long.appended(-1)
    assert len(long) == 50_000 and list(long)[-1] == 49_999
    assert list(longer)[-1] == -1
    assert longer.levels[-1] is long.levels[-1]
    assert long == long and long != PersistentList(long.levels)


def test_thousands_of_items_are_copied_pickled_and_printed(long: PersistentList[int]) -> None:
    assert list(copy.deepcopy(long)) == list(long)
    assert list(pickle.loads(pickle.dumps(long))) == list(long)  # noqa: S301 - what was pickled just now
    assert repr(long) == "PersistentList(50000 items)"


def test_nesting_does_not_grow_with_the_length(long: PersistentList[int]) -> None:
    assert len(long.levels) == 4
    assert max(len(level) for level in long.levels) < 32


def test_a_part_is_what_a_slice_gives(long: PersistentList[int]) -> None:
    for count in (0, 1, 31, 32, 33, 1025, 2_100):
        some = PersistentList[int]().extended(range(count))
        for start, stop in ((0, count), (0, 5), (30, 70), (max(count - 3, 0), count + 9), (7, 7), (9, 3)):
            assert some.part(start, stop) == list(range(count))[start:stop]
    assert long.part(31_990, 32_100) == list(range(31_990, 32_100))
