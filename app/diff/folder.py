"""The rows of a run's folder, read while they are compared."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists, opened

from ..run.folder.digests import DIGESTS
from ..run.folder.run_folder import DECISIONS, STEPS
from ..run.folder.step_log import DECISION_COLUMNS, POSE, STEP_COLUMNS
from ..run.history.quantities import STEP_QUANTITIES, finite
from .compare import Compared, MethodRow
from .order import Made, in_order

Record = tuple[int, dict[str, str]]
"""Number of the line, and the cells by column."""
KINDS = {quantity.key: quantity.kind for quantity in STEP_QUANTITIES}


@contextmanager
def run_rows(folder: Path) -> Iterator[Iterator[MethodRow]]:
    """Of a run's folder, in order; InputError, also while they are read, where there are none, or not as written."""
    for name in (STEPS, DECISIONS):
        if not exists(folder / name):
            cure = "finish it with `ispom repair`, or run again" if folder.is_dir() else "give the folder of a run"
            raise InputError(f"{folder} has no {name}: {cure}")
    with opened(folder / STEPS) as steps, opened(folder / DECISIONS) as decisions:
        yield _joined(
            folder,
            _records(folder / STEPS, TextIOWrapper(steps, "utf-8", newline=""), STEP_COLUMNS),
            _records(folder / DECISIONS, TextIOWrapper(decisions, "utf-8", newline=""), DECISION_COLUMNS),
        )


def _records(path: Path, file: TextIOWrapper, columns: tuple[str, ...]) -> Iterator[Record]:
    reader = csv.DictReader(file, strict=True)
    try:
        if tuple(reader.fieldnames or ()) != columns:
            raise InputError(f"{path} was not written by this version: run again")
        for row in reader:
            if None in row or None in row.values():
                raise InputError(f"{path} line {reader.line_num} has not {len(columns)} columns: run again")
            yield reader.line_num, row
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path} line {reader.line_num + 1} is no CSV ({error}): run again") from None


def _joined(folder: Path, steps: Iterator[Record], decisions: Iterator[Record]) -> Iterator[MethodRow]:
    """Each step with its decisions; both files are in the same order, and are read side by side.

    Of a run whose disk was full, either file may end first.
    """
    cells = itemgetter(1)
    groups = groupby(decisions, lambda record: (cells(record)["exposure"], cells(record)["method"]))
    place, group = next(groups, (None, iter(())))
    latest = -1
    for line, row in steps:
        said: Iterable[Record] = ()
        if place == (row["exposure"], row["method"]):
            said = group
        exposure, time_ns = (_whole(folder / STEPS, line, row, name) for name in ("exposure", "time_ns"))
        if exposure < latest:
            raise _wrong(folder / STEPS, line, "exposure", row)
        latest = exposure
        yield MethodRow(exposure, time_ns, row["method"], _values(folder, line, row, said))
        if said:
            place, group = next(groups, (None, iter(())))
    while place is not None:
        for line, row in group:
            if _whole(folder / DECISIONS, line, row, "exposure") <= latest:
                raise _wrong(folder / DECISIONS, line, "exposure", row)
        place, group = next(groups, (None, iter(())))


def _values(folder: Path, line: int, row: Mapping[str, str], decisions: Iterable[Record]) -> Mapping[str, Compared]:
    steps, checks = folder / STEPS, folder / DECISIONS
    said = {key: _value(steps, line, row, key) for key in (*KINDS, *DIGESTS)}
    made = [
        Made(
            ".".join(filter(None, (d["key"], d["about"]))),
            _number(checks, number, d, "value"),
            _number(checks, number, d, "threshold"),
            d["passed"] == "1",
            d["consequence"],
        )
        for number, d in decisions
    ]
    pose = tuple(_number(steps, line, row, name) or 0.0 for name in POSE) if row["x"] else None
    return in_order(said, made, pose)


def _value(path: Path, line: int, row: Mapping[str, str], key: str) -> Compared:
    kind = KINDS.get(key, "text")
    if kind == "number":
        return _number(path, line, row, key)
    return row[key] == "1" if kind == "flag" else row[key]


def _number(path: Path, line: int, row: Mapping[str, str], name: str) -> float | None:
    if not row[name]:
        return None
    try:
        found = float(row[name])
    except ValueError:
        found = math.nan
    if finite(found) is None:
        raise _wrong(path, line, name, row)
    return found


def _whole(path: Path, line: int, row: Mapping[str, str], name: str) -> int:
    if not (row[name].removeprefix("-").isdecimal() and len(row[name]) < 20):
        raise _wrong(path, line, name, row)
    return int(row[name])


def _wrong(path: Path, line: int, name: str, row: Mapping[str, str]) -> InputError:
    return InputError(f"{path} line {line}: {name} is {row[name][:40]!r}, not as `ispom run` writes it: run again")
