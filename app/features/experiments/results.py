"""The results as files for other programs. Times that were measured stand in a file of their own: all others are the
same to the byte wherever and however often an experiment is run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import pyarrow
import pyarrow.parquet

from ispom.io.whole import write_whole

from ...engine.outputs import csv_of
from .plan import Plan, Run
from .row import Row, milliseconds
from .statistics import Outcome, Paired, Spread

ROWS_CSV, ROWS_PARQUET, SUMMARY, TIMES = "results.csv", "results.parquet", "summary.json", "times.csv"
_OF_RUN = ("line", "method", "source", "seed", "run", "failure", "images_sha256")


def table(plan: Plan, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A flat mapping for each run: every number of metrics.json that any of them has, and the settings of its line."""
    numbers = sorted({key for row in rows for key in row.values or {}})
    settings = sorted({key for line in plan.lines for key, _ in line.settings})
    return [
        {
            **dict(zip(_OF_RUN, _about(row), strict=True)),
            **{key: dict(row.run.line.settings).get(key) for key in settings},
            **{key: None if (row.values or {}).get(key) is None else float(row.values[key]) for key in numbers},  # type: ignore[index, arg-type]
        }
        for row in rows
    ]


def write_rows(out: Path, plan: Plan, rows: Sequence[Row]) -> None:
    """results.csv and results.parquet, a row for each run, and times.csv; InputError where the disk is full."""
    flat = table(plan, rows)
    write_whole(out / ROWS_CSV, _csv(flat))
    columns = {key: [_plain(row[key]) for row in flat] for key in (flat[0] if flat else _OF_RUN)}
    content = BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(columns), content)
    write_whole(out / ROWS_PARQUET, content.getvalue())
    measured = [
        {"run": str(row.run.folder), "median_ms": median, "p95_ms": p95}
        for row in rows
        for median, p95 in [milliseconds(row.run, out / row.run.folder)]
    ]
    write_whole(out / TIMES, _csv(measured))


def write_summary(
    out: Path, plan: Plan, spreads: Sequence[Spread], paired: Sequence[Paired], outcomes: Sequence[Outcome]
) -> None:
    """summary.json: the plan, medians and spreads, comparisons, and what became of the statements."""
    found = {
        "plan": plan,
        "spreads": spreads,
        "paired": paired,
        "statements": [{**vars(item), "verdict": item.verdict, "holds": item.holds} for item in outcomes],
    }
    text = json.dumps(msgspec.to_builtins(found), indent=1, allow_nan=False)
    write_whole(out / SUMMARY, text + "\n")


def by_plan(plan: Plan, rows: Sequence[Row]) -> list[Row]:
    """In the order of the plan, in whatever order they came."""
    place: dict[Run, int] = {run: i for i, run in enumerate(plan.runs())}
    return sorted(rows, key=lambda row: place[row.run])


def _about(row: Row) -> tuple[Any, ...]:
    run = row.run
    folder = run.folder.as_posix()
    return run.line.name, run.line.method, run.source, run.seed, folder, row.failure, row.images_sha256


def _csv(flat: Sequence[dict[str, Any]]) -> str:
    return csv_of(list(flat[0]) if flat else _OF_RUN, (list(row.values()) for row in flat))


def _plain(value: Any) -> Any:
    """A setting may be a word in one line and a number in another: a column has one type."""
    return value if value is None or isinstance(value, float) else str(value)
