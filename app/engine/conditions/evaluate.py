"""The value of an expression at a frame.

Names stand for what their method reported at its latest step. A missing value (a check that was not made, an error
without ground truth, a division by zero) makes the comparison, or the function, that it stands in false.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ispom.errors import InputError
from ispom.methods import names

from ..events import Stepped
from ..history.quantities import NO_ROW, Row, by_method, quantities, row_after
from ..history.quantity import Value
from ..history.series import Series
from .parser import Expression, parse


def holds(expression: Expression, now: Row, before: Row) -> bool:
    """Returns whether it is true at a frame; `before` is the row of the frame before it."""
    return expression.value(now, before) is True


def number(expression: Expression, now: Row, before: Row) -> float | None:
    """Returns the value of a numeric expression at a frame; None where one of its quantities is missing."""
    value = expression.value(now, before)
    return float(value) if isinstance(value, int | float) else None


def values(expression: Expression, now: Row) -> dict[str, Value]:
    """Returns the values of its quantities by name, from left to right."""
    return {quantity.name: now.get(quantity.method, {}).get(quantity.key) for quantity in expression.quantities}


def matches(expression: Expression, series: Series, index: int) -> bool:
    """Returns whether the expression holds at a frame. As with `ispom run --until`, it never holds at frames where none
    of the methods that it names stepped."""
    if not series.stepped(expression.methods, index):
        return False
    now, before = (series.row(i, expression.quantities) for i in (index, index - 1))
    return holds(expression, now, before)


def first_match(expression: Expression, series: Series, among: Iterable[int]) -> int | None:
    """The first of these frames at which it holds."""
    return next((i for i in among if matches(expression, series, i)), None)


def hits(expression: Expression, series: Series, count: int) -> int:
    """Returns at how many of the first `count` frames the expression holds."""
    return sum(matches(expression, series, i) for i in range(count))


@dataclass(frozen=True)
class Stop:
    """Where a condition held, and what was measured there."""

    expression: Expression
    exposure: int
    time_ns: int
    values: Mapping[str, Value]
    """Values of all quantities that the expression names, by name."""

    def __str__(self) -> str:
        current_values = (f"{q.name} {shown(self.values[q.name], q.unit)}" for q in self.expression.quantities)
        where = f"frame {self.exposure} ({self.time_ns / 1e9:.3f} s)"
        return f"stopped at {where} by --until {self.expression.text}: {', '.join(current_values)}"


@dataclass
class Until:
    """Watches a run for a condition; never stops where there is none. Not a value: it keeps the newest row.

    The condition is evaluated at the frames on which a method that it names stepped, and at all of them where it names
    the frame itself.
    """

    expression: Expression | None
    stop: Stop | None = None
    row: Row = field(default_factory=lambda: NO_ROW)

    def add(self, event: Stepped) -> None:
        """Sets `stop` where the condition holds."""
        if self.expression is None:
            return
        before, time_ns = self.row, event.exposure.time_ns
        self.row = row_after(before, event.index, time_ns, event.steps, event.errors_m)
        relevant_methods = self.expression.methods & {"", *by_method(event.steps)}
        if relevant_methods and holds(self.expression, self.row, before):
            self.stop = Stop(self.expression, event.index, time_ns, values(self.expression, self.row))

    def __str__(self) -> str:
        """Describes how the run ended; empty where there is no condition."""
        never = f"--until never held: {self.expression.text}" if self.expression else ""
        return never if self.stop is None else str(self.stop)


def until(text: str | None) -> Expression | None:
    """The condition of --until, over all methods that there are; InputError names the mistake's column."""
    if text is None:
        return None
    try:
        return parse(text, quantities(names()))
    except InputError as mistake:
        raise InputError(f"--until: {mistake}") from None


def require_run(expression: Expression | None, methods: Iterable[str]) -> None:
    """Raises InputError where the expression names a method that is not one of `methods`."""
    running = tuple(methods)
    if expression and (missing := [q.name for q in expression.quantities if q.method not in ("", *running)]):
        raise InputError(f"--until names {missing[0]}, but {', '.join(running)} run here: give other --methods")


def shown(value: Value, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:.6g} {unit}".rstrip()
    return "missing" if value is None else value
