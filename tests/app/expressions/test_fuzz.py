"""Some of the cases that `python -m tests.fuzz.expressions` works through."""

from __future__ import annotations

from tests.fuzz.expressions import case, fault


def test_every_text_is_a_value_or_one_sentence() -> None:
    outcomes = [(text, *fault(text)) for text in map(case, range(2000))]
    assert not [(text[:300], wrong) for text, _, wrong in outcomes if wrong]
    assert 300 < sum(valued for _, valued, _ in outcomes) < 1700
