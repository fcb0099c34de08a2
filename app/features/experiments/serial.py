"""Runs one after the other, in this process."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from pathlib import Path

from ispom.ensemble import build

from ...engine.playback import Builder
from ..headless.console import Progress, silent
from .execute import execute
from .plan import Plan, Run
from .row import Row


def rows(
    plan: Plan,
    runs: Iterable[Run],
    out: Path,
    recording: bool,
    builder: Builder = build,
    progress_of: Callable[[Run], Progress] = lambda _: silent,
) -> Generator[Row, None, None]:
    """In the order of the runs; `progress_of` each is told of its exposures."""
    for run in runs:
        yield execute(plan, run, out, recording, builder, progress_of(run))
