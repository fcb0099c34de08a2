"""steps.csv and decisions.csv: the values of every method at every frame, written during the run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Self

from ispom.io.values import MAX_TIME_S
from ispom.types import Step

from ..events import Stepped
from ..history.quantities import POSE, STEP_QUANTITIES, by_method, finite, step_values
from ..history.quantity import Value
from .digests import DIGESTS
from .run_folder import DECISIONS, STEPS, RunFolder
from .statistics import RunStatistics
from .table import GrowingTable

STEP_COLUMNS = (
    *("exposure", "time_ns", "method", *(quantity.key for quantity in STEP_QUANTITIES), "stages"),
    *("frame", *POSE, *DIGESTS),
)
"""`error_m` and the pose (world_from_FRAME, in the method's own world and unit) are as given at that time; `stages` is
`name=seconds;...`, `seconds` their sum. Numbers have all digits."""
DECISION_COLUMNS = (
    "exposure",
    "time_ns",
    "method",
    "key",
    "about",
    "question",
    "kind",
    "name",
    "value",
    "relation",
    "threshold",
    "unit",
    "passed",
    "consequence",
)


class StepLog:
    """Writes the two files of one run row by row, and keeps nothing in memory. The files get their final names at the
    end."""

    def __init__(self, folder: RunFolder) -> None:
        self._steps = GrowingTable(folder, STEPS, STEP_COLUMNS)
        self._decisions = GrowingTable(folder, DECISIONS, DECISION_COLUMNS)

    def add(self, event: Stepped) -> None:
        """The rows of one frame."""
        steps = list(by_method(event.steps).values())
        self._steps.add(_step_row(event, step) for step in steps)
        self._decisions.add(row for step in steps for row in _decision_rows(event, step))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Closes both files, which end with a complete row, and gives them their final names."""
        self._steps.close()
        self._decisions.close()


def counted(rows: Iterable[Mapping[str, str]]) -> RunStatistics:
    """Returns times, losses and segments from the rows of steps.csv."""
    statistics = RunStatistics()
    for row in rows:
        with suppress(KeyError, ValueError, OverflowError):
            time_ns, ms = int(row["time_ns"]), 1000 * float(row["seconds"])
            if abs(time_ns) > MAX_TIME_S * 10**9 or not 0 <= ms < math.inf:
                continue
            joins = int(row["joins"]) if row.get("joins") else None
            age_ns = int(row["segment_age_ns"]) if row.get("segment_age_ns") else 0
            statistics.count(row["method"], time_ns, ms, row["status"], row["restarted"] == "1", joins, age_ns)
    return statistics


def _step_row(event: Stepped, step: Step) -> list[str]:
    values = step_values(step, event.errors_m.get(step.method))
    cells = (event.index, step.time_ns, step.method, *(values[quantity.key] for quantity in STEP_QUANTITIES))
    stages = ";".join(f"{stage}={_cell(seconds)}" for stage, seconds in step.seconds.items())
    pose = (values.get(key) for key in POSE)
    return [_cell(c) for c in (*cells, stages, step.frame, *pose, *(of(step) for of in DIGESTS.values()))]


def _decision_rows(event: Stepped, step: Step) -> Iterator[list[str]]:
    for d in step.decisions:
        described = (event.index, step.time_ns, step.method, d.key, d.about, d.question, d.kind, d.name)
        made = (finite(d.value), d.relation, finite(d.threshold), d.unit, d.passed, d.consequence)
        yield [_cell(value) for value in (*described, *made)]


def _cell(value: Value) -> str:
    """Empty for what is not known."""
    if isinstance(value, bool):
        return str(int(value))
    return "" if value is None else repr(float(value)) if isinstance(value, float) else str(value)
