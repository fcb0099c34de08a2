"""Reads steps.csv and decisions.csv row by row. Every value is checked; messages name the line of a mistake."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, get_args

from ispom.errors import InputError
from ispom.io.files import exists, opened
from ispom.io.values import is_name
from ispom.types import Decision, DecisionKind, FrameName, Status

from ..history.quantities import POSE, STEP_QUANTITIES, check_values, finite
from ..history.quantity import Value
from .digests import DIGESTS
from .run_folder import DECISIONS, STEPS
from .step_log import DECISION_COLUMNS, STEP_COLUMNS
from .table import LONGEST_LINE

Record = tuple[int, dict[str, str]]
"""Number of the line, and the cells by column."""
KINDS = {quantity.key: quantity.kind for quantity in STEP_QUANTITIES}
LATER = frozenset({"provisional", "segment_age_ns"})
"""Columns that runs of earlier versions lack; their values are unknown there."""
RELATIONS, DECISION_KINDS = (">=", "<=", ">", "<", "="), get_args(DecisionKind)


@dataclass(frozen=True, eq=False)
class StoredStep:
    """The values of one method at one frame, as they are in the folder."""

    exposure: int
    time_ns: int
    method: str
    frame: FrameName
    values: Mapping[str, Value]
    """By key: quantities, checks, the pose as POSE (absent without one), and digests."""
    seconds: Mapping[str, float]
    """By stage."""
    decisions: tuple[Decision, ...]
    """NaN for a value or threshold that was not finite."""


@contextmanager
def stored_steps(folder: Path) -> Iterator[Iterator[StoredStep]]:
    """Yields the steps of a run's folder in order. InputError, also during reading, where the files are missing or
    invalid."""
    for name in (STEPS, DECISIONS):
        if not exists(folder / name):
            cure = "finish it with `ispom repair`, or run again" if folder.is_dir() else "give the folder of a run"
            raise InputError(f"{folder} has no {name}: {cure}")
    with opened(folder / STEPS) as steps, opened(folder / DECISIONS) as decisions:
        yield _joined(
            folder,
            _records(folder / STEPS, _lines(folder / STEPS, steps), STEP_COLUMNS),
            _records(folder / DECISIONS, _lines(folder / DECISIONS, decisions), DECISION_COLUMNS),
        )


def _lines(path: Path, file: BinaryIO) -> Iterator[str]:
    """One at a time, and none that is longer than we write: a large file without line ends is no table."""
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise InputError(f"{path} has a line of more than {LONGEST_LINE >> 20} MB, so it is no table: run again")
        yield line.decode()


def _records(path: Path, lines: Iterator[str], columns: tuple[str, ...]) -> Iterator[Record]:
    reader = csv.DictReader(lines, strict=True)
    try:
        named = tuple(reader.fieldnames or ())
        if named != tuple(name for name in columns if name in named or name not in LATER):
            raise InputError(f"{path} line 1 does not name the columns that this version writes: run again")
        for row in reader:
            if None in row or None in row.values():
                count = len(reader.fieldnames or ())
                raise InputError(f"{path} line {reader.line_num} has not {count} columns: run again")
            yield reader.line_num, row
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file: run again") from None
    except csv.Error as error:
        raise InputError(f"{path} line {reader.line_num + 1} is no CSV ({error}): run again") from None


def _joined(folder: Path, steps: Iterator[Record], decisions: Iterator[Record]) -> Iterator[StoredStep]:
    """Each step with its decisions; both files are in the same order, and are read side by side.

    Of a run whose disk was full, either file may end first.
    """
    cells = itemgetter(1)
    groups = groupby(decisions, lambda record: (cells(record)["exposure"], cells(record)["method"]))
    place, group = next(groups, (None, iter(())))
    latest = -1
    for line, row in steps:
        made: Iterable[Record] = ()
        if place == (row["exposure"], row["method"]):
            made = group
        found = _step(folder, line, row, made)
        if found.exposure < latest:
            raise _wrong(folder / STEPS, line, "exposure", row)
        latest = found.exposure
        yield found
        if made:
            place, group = next(groups, (None, iter(())))
    while place is not None:
        for line, row in group:
            if _whole(folder / DECISIONS, line, row, "exposure") <= latest:
                raise _wrong(folder / DECISIONS, line, "exposure", row)
        place, group = next(groups, (None, iter(())))


def _step(folder: Path, line: int, row: Mapping[str, str], made: Iterable[Record]) -> StoredStep:
    path = folder / STEPS
    decisions = tuple(_decision(folder / DECISIONS, number, cells) for number, cells in made)
    values = {key: _value(path, line, row, key) for key in (*KINDS, *DIGESTS)} | check_values(decisions)
    if any(row[name] for name in POSE):
        values |= {name: _number(path, line, row, name) for name in POSE}
        _require_pose(path, line, row, [values[name] for name in POSE])
    if values["status"] not in set(Status):
        raise _wrong(path, line, "status", row)
    if not is_name(row["frame"]):
        raise _wrong(path, line, "frame", row)
    exposure, time_ns = (_whole(path, line, row, name) for name in ("exposure", "time_ns"))
    seconds = {
        name: _number(path, line, {"stages": value}, "stages") or 0.0
        for name, _, value in (pair.rpartition("=") for pair in filter(None, row["stages"].split(";")))
    }
    return StoredStep(exposure, time_ns, row["method"], row["frame"], values, seconds, decisions)  # type: ignore[arg-type]


def _require_pose(path: Path, line: int, row: Mapping[str, str], numbers: list[Any]) -> None:
    for name, number in zip(POSE, numbers, strict=True):
        if number is None:
            raise _wrong(path, line, name, row)
    if not math.isclose(math.hypot(*numbers[3:]), 1.0, abs_tol=0.01):
        raise _wrong(path, line, "qw", row)


def _decision(path: Path, line: int, row: Mapping[str, str]) -> Decision:
    for name, known in (("relation", RELATIONS), ("kind", DECISION_KINDS)):
        if row[name] not in known:
            raise _wrong(path, line, name, row)
    value, threshold = (_number(path, line, row, name) for name in ("value", "threshold"))
    return Decision(
        row["name"],
        math.nan if value is None else value,
        math.nan if threshold is None else threshold,
        row["passed"] == "1",
        row["unit"],
        row["relation"],  # type: ignore[arg-type]
        row["consequence"],
        row["key"],
        row["question"],
        row["kind"],  # type: ignore[arg-type]
        row["about"],
    )


def _value(path: Path, line: int, row: Mapping[str, str], key: str) -> Value:
    kind = KINDS.get(key, "text")
    if key in LATER and key not in row:
        return None
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
