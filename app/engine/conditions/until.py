"""Runs that stop at a condition: `ispom run --until 'integrated.error_m > 0.2'`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ispom.errors import InputError
from ispom.methods import names

from ..events import Stepped
from ..history.quantities import NO_ROW, Row, by_method, quantities, row_after
from ..history.quantity import Value
from .evaluate import holds, values
from .parser import Expression, parse


@dataclass(frozen=True)
class Stop:
    """Where a condition held, and what was measured there."""

    expression: Expression
    exposure: int
    time_ns: int
    values: Mapping[str, Value]
    """By name: of all that the expression speaks of."""

    def __str__(self) -> str:
        said = (f"{q.name} {shown(self.values[q.name], q.unit)}" for q in self.expression.quantities)
        where = f"frame {self.exposure} ({self.time_ns / 1e9:.3f} s)"
        return f"stopped at {where} by --until {self.expression.text}: {', '.join(said)}"


@dataclass
class Until:
    """Watches a run for a condition; never stops where there is none. Not a value: it keeps the newest row.

    The condition is asked at the frames on which a method that it names stepped, and at all of them where it names
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
        asked = self.expression.methods & {"", *by_method(event.steps)}
        if asked and holds(self.expression, self.row, before):
            self.stop = Stop(self.expression, event.index, time_ns, values(self.expression, self.row))

    def __str__(self) -> str:
        """How it ended; empty where there is no condition."""
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
    """InputError where it speaks of a method that is not among these."""
    running = tuple(methods)
    if expression and (missing := [q.name for q in expression.quantities if q.method not in ("", *running)]):
        raise InputError(f"--until names {missing[0]}, but {', '.join(running)} run here: give other --methods")


def shown(value: Value, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:.6g} {unit}".rstrip()
    return "missing" if value is None else value
