"""steps.csv and decisions.csv, as columns and rows."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.rows import read_text
from ispom.methods import names
from ispom.types import Decision

from ..run.folder.step_log import DECISION_COLUMNS, STEP_COLUMNS
from ..run.history.quantities import DROPPED

NUMBERS = ("error_m", "scale", "inliers", "residual_median_px", "alive", "new", *DROPPED, "seconds")


@dataclass(frozen=True, eq=False)
class Steps:
    """What one method said, exposure by exposure: N rows."""

    exposures: np.ndarray
    times_ns: np.ndarray
    status: tuple[str, ...]
    key_frame: np.ndarray
    columns: Mapping[str, np.ndarray]
    """By name of NUMBERS: (N,), NaN where nothing was said."""
    stages: Mapping[str, np.ndarray]
    """By stage: (N,) seconds, 0 where it was not run."""

    @property
    def dropped(self) -> np.ndarray:
        """(N,) tracks that ended."""
        return np.sum([self.columns[name] for name in DROPPED], axis=0)


@dataclass(frozen=True)
class DecisionRow:
    """One decision, and when."""

    exposure: int
    time_ns: int
    method: str
    decision: Decision


def read_steps(path: Path) -> dict[str, Steps]:
    """By method, in the order of the registry; InputError names the line that is wrong."""
    found: dict[str, list[tuple[int, dict[str, str]]]] = {}
    for line, row in _rows(path, STEP_COLUMNS):
        if row["method"] not in names():
            raise _wrong(path, line, "method", row)
        found.setdefault(row["method"], []).append((line, row))
    return {method: _steps(path, found[method]) for method in names() if method in found}


def read_decisions(path: Path) -> tuple[DecisionRow, ...]:
    """In the order of the file; InputError names the line that is wrong."""
    found = []
    for line, row in _rows(path, DECISION_COLUMNS):
        if row["relation"] not in (">=", "<=", ">", "<", "="):
            raise _wrong(path, line, "relation", row)
        if row["kind"] not in ("requirement", "trigger", "finding"):
            raise _wrong(path, line, "kind", row)
        decision = Decision(
            row["name"],
            _number(path, line, row, "value"),
            _number(path, line, row, "threshold"),
            bool(_whole(path, line, row, "passed")),
            row["unit"],
            row["relation"],  # type: ignore[arg-type]
            row["consequence"],
            row["key"],
            row["question"],
            row["kind"],  # type: ignore[arg-type]
            row["about"],
        )
        exposure, time_ns = _whole(path, line, row, "exposure"), _whole(path, line, row, "time_ns")
        found.append(DecisionRow(exposure, time_ns, row["method"], decision))
    return tuple(found)


def _rows(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and rows."""
    reader = csv.DictReader(read_text(path).splitlines(), strict=True)
    try:
        if tuple(reader.fieldnames or ()) != columns:
            raise InputError(f"{path} line 1 does not name the columns that `ispom run` writes: run again")
        for row in reader:
            if None in row or None in row.values():
                raise InputError(f"{path} line {reader.line_num} has not {len(columns)} columns: run again")
            yield reader.line_num, row
    except csv.Error as error:
        raise InputError(f"{path} line {reader.line_num} is no CSV ({error}): run again") from None


def _steps(path: Path, rows: list[tuple[int, dict[str, str]]]) -> Steps:
    stages: dict[str, np.ndarray] = {}
    for i, (line, row) in enumerate(rows):
        for pair in filter(None, row["stages"].split(";")):
            name, _, seconds = pair.rpartition("=")
            column = stages.setdefault(name, np.zeros(len(rows)))
            column[i] = _number(path, line, {"stages": seconds}, "stages")
    return Steps(
        np.array([_whole(path, line, row, "exposure") for line, row in rows], np.int64),
        np.array([_whole(path, line, row, "time_ns") for line, row in rows], np.int64),
        tuple(row["status"] for _, row in rows),
        np.array([_whole(path, line, row, "key_frame") for line, row in rows], bool),
        {name: np.array([_number(path, line, row, name) for line, row in rows]) for name in NUMBERS},
        stages,
    )


def _number(path: Path, line: int, row: Mapping[str, str], name: str) -> float:
    """NaN where the cell is empty."""
    if not row[name]:
        return math.nan
    try:
        value = float(row[name])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _wrong(path, line, name, row)
    return value


def _whole(path: Path, line: int, row: Mapping[str, str], name: str) -> int:
    try:
        value = int(row[name])
    except ValueError:
        raise _wrong(path, line, name, row) from None
    if abs(value) >= 2**63:
        raise _wrong(path, line, name, row)
    return value


def _wrong(path: Path, line: int, name: str, row: Mapping[str, str]) -> InputError:
    return InputError(f"{path} line {line}: {name} is {row[name][:40]!r}, not as `ispom run` writes it: run again")
