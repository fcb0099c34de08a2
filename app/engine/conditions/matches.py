"""Where in a run that is computed already an expression holds."""

from __future__ import annotations

from collections.abc import Iterable

from ..history.series import Series
from .evaluate import holds
from .parser import Expression


def matches(expression: Expression, series: Series, index: int) -> bool:
    """Whether it holds at an exposure: asked where a method that it names stepped, as `ispom run --until` asks."""
    if not series.stepped(expression.methods, index):
        return False
    now, before = (series.row(i, expression.quantities) for i in (index, index - 1))
    return holds(expression, now, before)


def first_match(expression: Expression, series: Series, among: Iterable[int]) -> int | None:
    """The first of these frames at which it holds."""
    return next((i for i in among if matches(expression, series, i)), None)


def hits(expression: Expression, series: Series, count: int) -> int:
    """At how many of the first `count` frames it holds."""
    return sum(matches(expression, series, i) for i in range(count))
