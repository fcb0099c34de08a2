"""The events of a run as a table: events.csv in its folder, and a few lines for the terminal."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

from ispom.errors import InputError
from ispom.io.rows import read_text

from ...presentation import colours
from ..events import Stepped
from ..history.quantities import NO_ROW, Row, row_after
from ..outputs import csv_of
from ..verdict import Severity
from .event import RunEvent
from .log import EventLog

COLUMNS = ("frame", "time_ns", "method", "kind", "severity", "until", "sentence")
PRINTED = 5
"""Most warnings and losses that the terminal shows."""


@dataclass
class EventRecorder:
    """Collects the events of a run without a page. Not a value: it keeps the newest row."""

    log: EventLog = field(default_factory=EventLog)
    row: Row = field(default_factory=lambda: NO_ROW)

    def add(self, event: Stepped) -> None:
        """The next frame."""
        before, time_ns = self.row, event.exposure.time_ns
        self.row = row_after(before, event.index, time_ns, event.steps, event.errors_m)
        self.log.add(event.index, time_ns, event.steps, before, self.row, event.skipped)


def events_text(events: Iterable[RunEvent]) -> str:
    """events.csv; `until` is empty where the event still held at the end."""
    return csv_of(COLUMNS, ((e.frame, e.time_ns, e.method, e.kind, e.severity, e.until, e.sentence) for e in events))


def read_events(path: Path) -> list[RunEvent]:
    """Those of an events.csv. InputError where it is not as written."""
    found: list[RunEvent] = []
    rows = csv.DictReader(StringIO(read_text(path)))
    if tuple(rows.fieldnames or ()) != COLUMNS:
        raise InputError(f"{path} line 1: it has not the columns {', '.join(COLUMNS)}: run again")
    try:
        for row in rows:
            until = int(row["until"]) if row["until"] else None
            place, severity = (int(row["frame"]), int(row["time_ns"])), Severity(row["severity"])
            found.append(RunEvent(row["kind"], row["method"], *place, severity, row["sentence"], until))
    except (ValueError, TypeError, csv.Error) as fault:
        raise InputError(
            f"{path} line {rows.line_num}: it is not as `ispom run` writes it ({fault}): run again"
        ) from None
    return found


def event_lines(events: Iterable[RunEvent], more: str) -> list[str]:
    """Returns lines about the warnings and losses, the first PRINTED in words; `more` says where the others are."""
    found = [e for e in events if e.severity.alarming]
    sentences = [f"frame {e.frame}: {colours.label(e.method)}: {e.sentence}" if e.method else e.sentence for e in found]
    rest = len(found) - PRINTED
    return sentences[:PRINTED] + ([f"... and {rest} more events in {more}"] if rest > 0 else [])
