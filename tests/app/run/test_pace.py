"""What is said to be left is about what is left, from the first part on, however late that comes, and however little
of a processor is given."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from ispom_app.engine.pace import END_SHARE, LEAST_GIVEN, LEAST_S, Pace

PARTS = (2, 1, 1, 4, 1, 1, 5, 6, 2, 3, 1, 1, 1, 3, 1, 1, 2, 1, 1, 2, 14, 2, 1, 2, 1, 1, 1, 9, 2, 7, 5, 3, 2, 2)
"""Lengths of what is compiled, one after the other."""
Given = Callable[[float], float]
"""Seconds of a processor for each second, at a time [s]."""


def told(total_s: float, loading_s: float, given: Given = lambda _: 1.0, every_s: float = 0.25) -> list[list[float]]:
    """(when, left, said to be left) [s], each time that one looks, where all takes so long on a processor: what is long
    is done as fast as what is short."""
    done, at = [0.0], [loading_s]
    for part in PARTS:
        done.append(done[-1] + part / sum(PARTS))
        at.append(loading_s + total_s * done[-1] / (1 + END_SHARE))
    pace, found, now_s, spent_s = Pace(0.0), list[tuple[float, float]](), 0.0, 0.0
    while spent_s < loading_s + total_s:
        share = max((share for share, then in zip(done, at, strict=True) if then <= spent_s), default=0.0)
        pace = pace.after(now_s, spent_s, share)
        if (left := pace.left_s) is not None:
            found.append((now_s, left))
        spent_s += every_s * given(now_s)
        now_s += every_s
    return [[when, now_s - when, left] for when, left in found]


@pytest.mark.parametrize("loading_s", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("total_s", [17.0, 21.0, 25.0, 30.0, 33.0])
@pytest.mark.parametrize("given", [1.0, 0.5, 0.2, 0.1])
def test_it_is_within_half_of_what_is_left(total_s: float, loading_s: float, given: float) -> None:
    for _, left, said in told(total_s, loading_s, lambda _: given):
        if left > 5:
            assert left / 1.5 < said < left * 1.5


@pytest.mark.parametrize(("first", "then"), [(0.1, 0.4), (0.9, 0.15), (0.1, 0.2)])
def test_how_much_is_given_is_what_was_given_of_late(first: float, then: float) -> None:
    """A browser draws a page for 20 s, or a run begins then: what is said follows in less than a minute."""
    found = told(25.0, 2.0, lambda now_s: first if now_s < 20 else then)
    later = [(left, said) for when, left, said in found if when > 65 and left > 5]
    assert later and all(left / 1.5 < said < left * 1.5 for left, said in later)


def test_what_is_given_in_turns_is_given_evenly() -> None:
    found = told(25.0, 2.0, lambda now_s: float(now_s % 4 < 1))
    assert all(left / 1.6 < said < left * 1.6 for when, left, said in found if when > 20 and left > 10)


@pytest.mark.parametrize("total_s", [90.0, 200.0])
def test_a_slow_machine_is_found_out(total_s: float) -> None:
    found = told(total_s, 10.0)
    assert all(said < 1.2 * left for _, left, said in found if left > 5)
    assert all(said > left / 2 for _, left, said in found if 5 < left < total_s / 2)


def test_it_counts_down_by_what_is_spent_while_no_part_ends() -> None:
    assert Pace(3.0).left_s is None and Pace(3.0).after(7.0, 2.0, 0.0).left_s is None
    pace = Pace(0.0).after(10.0, 10.0, 0.1)
    first = pace.left_s
    assert first is not None and pace.after(12.0, 12.0, 0.1).left_s == pytest.approx(first - 2)
    assert pace.after(1000.0, 1000.0, 0.1).left_s == pytest.approx(LEAST_S)
    waiting = pace.after(1e6, 10.0, 0.1).left_s
    assert waiting == pytest.approx(first / LEAST_GIVEN)
