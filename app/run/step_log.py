"""steps.csv and decisions.csv: what every method said about every exposure, written while a run goes on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any, Self

import numpy as np

from ispom.types import Status, Step, TrackStatus

from .events import Stepped
from .run_folder import DECISIONS, STEPS, RunFolder
from .statistics import RunStatistics
from .table import GrowingTable

DROPPED = {f"dropped_{status.name.lower()}": status for status in TrackStatus if status.dropped}
"""By column: why a track ended."""
STEP_COLUMNS = (
    *("exposure", "time_ns", "method", "status", "key_frame", "error_m", "scale", "inliers", "residual_median_px"),
    *("alive", "new", *DROPPED, "seconds", "stages"),
)
"""`error_m` is of the pose as it was given at that time; `stages` is `name=seconds;...`, `seconds` their sum."""
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
    """The two files of one run, growing row by row; nothing is kept in memory. They get their names at the end."""

    def __init__(self, folder: RunFolder) -> None:
        self._steps = GrowingTable(folder, STEPS, STEP_COLUMNS)
        self._decisions = GrowingTable(folder, DECISIONS, DECISION_COLUMNS)

    def add(self, event: Stepped) -> None:
        """The rows of one exposure."""
        steps = list(_by_method(event.steps).values())
        self._steps.add(_step_row(event, step) for step in steps)
        self._decisions.add(row for step in steps for row in _decision_rows(event, step))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Closes both files, whole as far as they go, and gives them their names."""
        self._steps.close()
        self._decisions.close()


def counted(rows: Iterable[Mapping[str, str]]) -> RunStatistics:
    """The times and losses that the rows of steps.csv tell."""
    statistics = RunStatistics()
    for row in rows:
        with suppress(ValueError):
            statistics.count(row["method"], 1000 * float(row["seconds"]), row["status"] == Status.LOST)
    return statistics


def _by_method(steps: tuple[Step, ...]) -> dict[str, Step]:
    """The asked methods' steps, and those of the estimators inside them that were not asked for themselves."""
    found = {step.method: step for step in steps}
    for step in steps:
        for method, part in _by_method(step.parts).items():
            found.setdefault(method, part)
    return found


def _step_row(event: Stepped, step: Step) -> list[Any]:
    statuses = np.concatenate([[], *(tracks.status for tracks in step.tracks.values())])
    counts = [int((statuses == status).sum()) for status in (TrackStatus.ALIVE, TrackStatus.NEW, *DROPPED.values())]
    residuals = step.residuals_px
    return [
        *(event.index, step.time_ns, step.method, str(step.status), int(step.key_frame)),
        *(_number(event.errors_m.get(step.method)), _number(step.scale)),
        *((len(residuals), _number(float(np.median(residuals)))) if len(residuals) else ("", "")),
        *(counts if step.tracks else [""] * len(counts)),
        _number(sum(step.seconds.values())),
        ";".join(f"{stage}={_number(seconds)}" for stage, seconds in step.seconds.items()),
    ]


def _decision_rows(event: Stepped, step: Step) -> Iterator[list[Any]]:
    for d in step.decisions:
        value, threshold = _number(d.value), _number(d.threshold)
        yield [
            *(event.index, step.time_ns, step.method, d.key, d.about, d.question, d.kind, d.name),
            *(value, d.relation, threshold, d.unit, int(d.passed), d.consequence),
        ]


def _number(value: float | None) -> str:
    """Nine digits; empty for what is not known."""
    return "" if value is None or not math.isfinite(value) else f"{value:.9g}"
