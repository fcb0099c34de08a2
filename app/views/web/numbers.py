"""The numbers that the page shows, as CSV: those of one frame, or all quantities over the frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...engine.history.quantity import Value
from ...engine.history.series import Series
from ...engine.outputs import csv_of

FORMULA = ("=", "+", "-", "@", "\t")
"""What a text must not begin with, for a spreadsheet would compute it; negative numbers are no texts."""


def of_exposure(series: Series, index: int) -> str:
    """A row for each quantity that has values, with its unit and meaning."""
    found = ((q, series.value(q, index)) for q in series.quantities.values())
    rows = [(q.name, _cell(value), q.unit, q.help) for q, value in found if value is not None]
    return csv_of(("quantity", "value", "unit", "meaning"), map(_plain, rows))


def over_time(series: Series, count: int) -> str:
    """A row for each of the first `count` frames, a column for each quantity that has a value at any of them."""
    columns = {
        name: (quantity, values)
        for name, quantity in series.quantities.items()
        if np.isfinite(values := series.values(name, 0, count)).any()
    }
    cells = [[_cell(series.value(quantity, i)) for i in range(count)] for quantity, _ in columns.values()]
    return csv_of(tuple(columns), map(_plain, zip(*cells, strict=True)))


def _cell(value: Value) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return str(int(value))
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _plain(row: Sequence[str]) -> list[str]:
    """A method's own text, such as a check's name, may come from a program."""
    is_formula = [cell.startswith(FORMULA) and not (cell[0] == "-" and cell[1:2].isdigit()) for cell in row]
    return [f"'{cell}" if formula else cell for cell, formula in zip(row, is_formula, strict=True)]
