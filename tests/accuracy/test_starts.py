"""The bench of starts: what it asks of a first map."""

from __future__ import annotations

import pytest

from tests.accuracy.starts import Started, starts


@pytest.mark.parametrize(
    ("outcome", "error", "turn_deg", "wrong"),
    [
        ("map", 0.07, 2.9, False),
        ("map", 0.09, 0.1, True),
        ("map", 0.01, 3.1, True),
        ("map", float("nan"), 0.1, True),
        ("none", float("nan"), float("nan"), False),
    ],
)
def test_wrong_is_a_map_of_another_shape(outcome: str, error: float, turn_deg: float, wrong: bool) -> None:
    assert Started("sim:tiny", 0, "map" if outcome == "map" else "none", 9, error, turn_deg).wrong is wrong


@pytest.mark.slow
def test_a_flight_is_started_in_the_middle() -> None:
    first, second = starts("sim:tiny", 80, 50)
    assert (first.frame, second.frame) == (0, 50)
    assert first.outcome == second.outcome == "map" and not first.wrong and not second.wrong
    assert 3 < second.frames < 40
