"""The results as files for other programs. What was measured stands in a file of its own: where the plan does not ask
for it, all others are the same to the byte wherever and however often an experiment is run."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import msgspec
import pyarrow
import pyarrow.parquet

from ispom.errors import InputError
from ispom.io.files import exists, is_folder
from ispom.io.rows import read_text
from ispom.io.whole import write_whole

from ...engine.outputs import csv_of
from .plan import MEASURED, Plan, Run
from .row import Row, milliseconds, row_of
from .statistics import Outcome, Paired, Spread

ROWS_CSV, ROWS_PARQUET, SUMMARY, TIMES = "results.csv", "results.parquet", "summary.json", "times.csv"
_OF_RUN = ("line", "method", "source", "seed", "run", "failure", "images_sha256")


def table(plan: Plan, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A flat mapping for each run: every number of metrics.json that any of them has, and the settings of its line.
    What was measured is in it only where the plan asks for it."""
    hidden = set(MEASURED) - set(plan.quantities)
    numbers = sorted({key for row in rows for key in row.values or {}} - hidden)
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
        | {key: (row.values or {}).get(key) for key in MEASURED}
        for row in rows
        for median, p95 in [milliseconds(row.run, out / row.run.folder)]
    ]
    write_whole(out / TIMES, _csv(measured))


def read_rows(folder: Path, plan: Plan, option: str) -> list[Row]:
    """Returns the rows of all runs of the plan, in its order, from a folder of `ispom experiment`.

    Raises InputError where the folder, or a run in it, is not there or damaged; a run that failed is a row.
    """
    if not exists(folder) or not is_folder(folder):
        raise InputError(f"{option} {folder} is no folder: give one that 'ispom experiment' wrote")
    failures, rows = _failures(folder), []
    for run in plan.runs():
        try:
            row = row_of(run, folder / run.folder)
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError(
                f"{folder / run.folder} is damaged: remove it, and run 'ispom experiment' on {folder} again"
            ) from None
        failure = failures.get(run.folder.as_posix())
        if row is None and failure is None:
            raise InputError(
                f"{option} {folder} has no finished run of {run} (no {run.folder.as_posix()}): "
                "run 'ispom experiment' with this plan and that folder as --out"
            )
        rows.append(row if row is not None else Row(run, failure))
    return rows


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


def _failures(folder: Path) -> dict[str, str]:
    """By folder, the reasons of runs that failed, as the table of an experiment has them."""
    table = folder / ROWS_CSV
    if not exists(table):
        return {}
    try:
        rows = list(csv.DictReader(StringIO(read_text(table))))
        return {row["run"]: row["failure"] for row in rows if row["failure"]}
    except (KeyError, csv.Error):
        raise InputError(f"{table} is damaged: remove it, and run 'ispom experiment' on {folder} again") from None


def _about(row: Row) -> tuple[Any, ...]:
    run = row.run
    folder = run.folder.as_posix()
    return run.line.name, run.line.method, run.source, run.seed, folder, row.failure, row.images_sha256


def _csv(flat: Sequence[dict[str, Any]]) -> str:
    return csv_of(list(flat[0]) if flat else _OF_RUN, (list(row.values()) for row in flat))


def _plain(value: Any) -> Any:
    """A setting may be a word in one line and a number in another: a column has one type."""
    return value if value is None or isinstance(value, float) else str(value)
