"""Runs one after the other, in this process."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from pathlib import Path

from ispom.ensemble import build

from ..run.playback import Builder
from .execute import execute
from .plan import Plan, Run
from .row import Row


def rows(
    plan: Plan, runs: Iterable[Run], out: Path, recording: bool, builder: Builder = build
) -> Generator[Row, None, None]:
    """In the order of the runs."""
    for run in runs:
        yield execute(plan, run, out, recording, builder)
