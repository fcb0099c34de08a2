"""What is said to be left is about what is left, from the first part on, however late that comes."""

from __future__ import annotations

import pytest
from ispom_app.run.pace import LEAST_S, Pace

PARTS = (2, 1, 1, 4, 1, 1, 5, 6, 2, 3, 1, 1, 1, 3, 1, 1, 2, 1, 1, 2, 14, 2, 1, 2, 1, 1, 1, 9, 2, 7, 5, 3, 2, 2)
"""Lengths of what is compiled, one after the other."""


def told(total_s: float, loading_s: float, every_s: float = 0.25) -> list[tuple[float, float]]:
    """(left, said to be left) [s], each time that one looks: what is long is done as fast as what is short."""
    done, at = [0.0], [loading_s]
    for part in PARTS:
        done.append(done[-1] + part / sum(PARTS))
        at.append(loading_s + total_s * done[-1])
    pace, found, now_s = Pace(), list[tuple[float, float]](), 0.0
    while now_s < at[-1] - 1e-9:
        pace = pace.after(now_s, max(share for share, then in zip(done, at, strict=True) if then <= max(now_s, at[0])))
        if (left := pace.left_s(now_s)) is not None:
            found.append((at[-1] - now_s, left))
        now_s += every_s
    return found


@pytest.mark.parametrize("loading_s", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("total_s", [18.0, 25.0, 30.0, 36.0])
def test_it_is_within_half_of_what_is_left(total_s: float, loading_s: float) -> None:
    for left, said in told(total_s, loading_s):
        if left > 5:
            assert left / 1.5 < said < left * 1.5


@pytest.mark.parametrize("total_s", [90.0, 200.0])
def test_a_slow_machine_is_found_out(total_s: float) -> None:
    found = told(total_s, 10.0)
    assert all(said < 1.2 * left for left, said in found if left > 5)
    assert all(said > left / 2 for left, said in found if 5 < left < total_s / 2)


def test_it_counts_down_while_nothing_is_done() -> None:
    assert Pace().left_s(7.0) is None
    pace = Pace().after(10.0, 0.1)
    first = pace.left_s(10.0)
    assert first is not None and pace.after(12.0, 0.1).left_s(12.0) == first - 2
    assert pace.left_s(1000.0) == LEAST_S
