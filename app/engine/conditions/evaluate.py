"""The value of an expression at a frame.

Names stand for what their method reported at its latest step. A missing value (a check that was not made, an error
without ground truth, a division by zero) makes the comparison, or the function, that it stands in false.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..history.quantities import Row
from ..history.quantity import Value
from ..history.series import Series
from .parser import Expression


def holds(expression: Expression, now: Row, before: Row) -> bool:
    """Returns whether it is true at a frame; `before` is the row of the frame before it."""
    return expression.value(now, before) is True


def number(expression: Expression, now: Row, before: Row) -> float | None:
    """Returns its number at a frame; None where something in it is missing."""
    value = expression.value(now, before)
    return float(value) if isinstance(value, int | float) else None


def values(expression: Expression, now: Row) -> dict[str, Value]:
    """Returns the values of its quantities by name, from left to right."""
    return {quantity.name: now.get(quantity.method, {}).get(quantity.key) for quantity in expression.quantities}


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
