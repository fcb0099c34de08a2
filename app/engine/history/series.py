"""Every quantity of a run over its frames, in columns: some 10 bytes for each number of each frame."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.methods import with_dependencies

from .quantities import NO_ROW, Row, quantities, row_with
from .quantity import Quantity, Value
from .record import ExposureRecord

MISSING = math.nan


class Series:
    """The columns of one run. One thread appends; any thread reads up to the length that it sees."""

    def __init__(self, methods: Iterable[str]) -> None:
        self.quantities = quantities(with_dependencies(methods))
        """By name."""
        self._columns = {name: array("d") for name in self.quantities}
        """Flags are 0 and 1, texts are indices of their choices; NaN where there is no value."""
        self._stepped = {method: bytearray() for method in {q.method for q in self.quantities.values()}}
        """For each method and frame, whether it stepped on the frame."""
        self._row: Row = NO_ROW
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def append(self, record: ExposureRecord) -> tuple[Row, Row]:
        """Adds the next frame. Returns the values by method at the frame before it and at it."""
        values_by_method, before = record.values_by_method, self._row
        self._row = row_with(before, record.index, record.time_ns, values_by_method)
        for name, quantity in self.quantities.items():
            self._columns[name].append(_as_number(quantity, self._row.get(quantity.method, {}).get(quantity.key)))
        for method, stepped in self._stepped.items():
            stepped.append(not method or method in values_by_method)
        self._length += 1
        return before, self._row

    def replace(self, record: ExposureRecord) -> tuple[Row, Row]:
        """Replaces the values of a known frame by those of another record of it. Returns the same as `append`."""
        index, before = record.index, self.row(record.index - 1, self.quantities.values())
        row = row_with(before, index, record.time_ns, record.values_by_method)
        for name, quantity in self.quantities.items():
            self._columns[name][index] = _as_number(quantity, row.get(quantity.method, {}).get(quantity.key))
        if index == self._length - 1:
            self._row = row
        return before, row

    def until(self, count: int, methods: Iterable[str]) -> Series:
        """Returns the first `count` frames, for another run of these methods that is the same up to there."""
        found = Series(methods)
        for name in found.quantities:
            known = name in self._columns
            found._columns[name] = self._columns[name][:count] if known else array("d", [MISSING]) * count
        for method in found._stepped:
            found._stepped[method] = self._stepped[method][:count] if method in self._stepped else bytearray(count)
        found._length = count
        found._row = found.row(count - 1, found.quantities.values())
        return found

    def row(self, index: int, columns: Iterable[Quantity]) -> Row:
        """Returns the values of these quantities at a frame; none before the first frame."""
        found: dict[str, dict[str, Value]] = {}
        for quantity in columns if index >= 0 else ():
            found.setdefault(quantity.method, {})[quantity.key] = self.value(quantity, index)
        return found

    def value(self, quantity: Quantity, index: int) -> Value:
        """Returns the value at the method's latest step up to the frame; None where it has none."""
        number = self._columns[quantity.name][index]
        if math.isnan(number):
            return None
        if quantity.kind == "text":
            return quantity.choices[int(number)]
        return bool(number) if quantity.kind == "flag" else number

    def values(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Returns a copy (N,) of a column, or of a part of it, in its encoding. KeyError for an unknown name."""
        return np.array(self._columns[name][start:stop])

    def values_of(self, name: str, stop: int, start: int = 0) -> tuple[NDArray[np.int64], Array]:
        """(N,) the frames from `start` to before `stop` at which the quantity's method stepped, and (N,) its values.

        A step without a value has NaN. Raises KeyError for a quantity that the run does not have.
        """
        method = self.quantities[name].method
        stepped = np.frombuffer(bytes(self._stepped[method][start:stop]), bool)
        return np.flatnonzero(stepped) + start, self.values(name, start, stop)[stepped]

    def last_step(self, method: str, index: int) -> int | None:
        """The last frame up to `index` at which a method stepped; None where there is none."""
        found = self._stepped[method].rfind(1, 0, index + 1) if method in self._stepped else -1
        return found if found >= 0 else None

    def median_seconds(self, method: str) -> float | None:
        """Median computing time of the frames on which a method stepped [s]; None where it never did."""
        name = f"{method}.seconds"
        values = self.values_of(name, self._length)[1] if name in self.quantities else np.zeros(0)
        known = values[np.isfinite(values)]
        return float(np.median(known)) if len(known) else None

    def stepped(self, methods: Iterable[str], index: int) -> bool:
        """Whether one of these methods stepped on the frame; "" stands for the frame itself."""
        return any(self._stepped[method][index] for method in methods if method in self._stepped)


def _as_number(quantity: Quantity, value: Value) -> float:
    if value is None:
        return MISSING
    if isinstance(value, str):
        return float(quantity.choices.index(value)) if value in quantity.choices else MISSING
    return float(value)
