"""`python -m tests.accuracy soak`: does a frame cost as much at the end of a long run as near its start?

`python -m tests.accuracy.soak '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import psutil
from ispom_app.engine.history.history import History
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.playback import Builder, Playback
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.methods import Config, in_order, with_dependencies
from ispom.methods import method as registered
from ispom.stopwatch import cpu_clock
from tests.rounds import SCENARIOS, Scenario

EARLY = 1000
"""The first of the exposures that the last 1,000 are compared with."""
LAST = 1000
MIN_EXPOSURES = 4000
HISTORY_BYTES = 20_000_000
"""So little that the history's budget is used up early, and memory is compared after that."""
MOST = 1.1
"""The goal: time of the last exposures over that of the early ones."""
TRACKS = {"max_tracks": 80, "max_points": 300}
"""Settings for small images, of the methods that have them."""


def scenarios(method: str) -> tuple[Scenario, ...]:
    """Those whose exposures the method uses, all of them."""
    return tuple(s for s in SCENARIOS if s.kinds == registered(method).sensors)


class Soaked:
    """A run that is remembered as the app does it, and what its exposures took."""

    def __init__(self, method: str, scenario: Scenario, exposures: int, builder: Builder) -> None:
        self._playback = Playback(scenario.sequence(exposures), (method,), small_images(method), builder)
        self._history, self._process = History(HISTORY_BYTES), psutil.Process()
        self.located = 0
        self.mb: list[float] = []
        """Resident memory after every LAST exposures."""

    def step(self) -> float:
        """CPU time of estimating and remembering one exposure [ms]."""
        start = cpu_clock()
        event = self._playback.step()
        self._history.append(ExposureRecord.of(event, self._history.last))
        taken = 1e3 * (cpu_clock() - start)
        self.located += any(step.world_from_frame is not None for step in event.steps)
        if (event.index + 1) % LAST == 0:
            self.mb.append(self._process.memory_info().rss / 2**20)
        return taken


def soaked(method: str, scenario: Scenario, exposures: int, builder: Builder = build) -> dict[str, float]:
    """CPU time per exposure [ms] of estimating and remembering, early and at the end; resident memory [MB].

    A second run waits before the early exposures, until the first one comes to its last: then both go on by turns. So
    they meet the machine in the same mood; within an hour it changes its speed by more than a leak would.
    """
    cv2.setNumThreads(1)
    early, late = (Soaked(method, scenario, exposures, builder) for _ in range(2))
    for _ in range(EARLY):
        early.step()
    for _ in range(exposures - LAST):
        late.step()
    ms = np.array([(early.step(), late.step()) for _ in range(LAST)])
    return {
        "exposures": exposures,
        "early_ms": float(ms[:, 0].mean()),
        "last_ms": float(ms[:, 1].mean()),
        "half_mb": late.mb[len(late.mb) // 2 - 1],
        "last_mb": late.mb[-1],
        "located_percent": 100 * late.located / exposures,
    }


def small_images(method: str) -> Config:
    """Settings with few tracks, of the method and those that it asks; else the defaults."""
    config = Config()
    for name in with_dependencies(in_order((method,))):
        settings = config.of(name)
        few = {key: value for key, value in TRACKS.items() if hasattr(settings, key)}
        config = config.with_settings(name, replace(settings, **few))
    return config


def print_soak(console: Console, method: str, rows: dict[str, dict[str, Any]]) -> None:
    """By scenario what `soaked` found, or {"error": ...}."""
    head = ("ms, 1,000 to 2,000", "ms, last 1,000", "ratio", "MB, half way", "MB, end", "located")
    table = Table(method, *head, box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for name, found in rows.items():
        if "error" in found:
            console.print(f"{method}, {name}: {found['error']}")
            continue
        ratio = found["last_ms"] / found["early_ms"]
        times = (f"{found['early_ms']:.2f}", f"{found['last_ms']:.2f}", f"{ratio:.2f}{'' if ratio <= MOST else ' !'}")
        memory = (f"{found['half_mb']:.0f}", f"{found['last_mb']:.0f}")
        table.add_row(name, *times, *memory, f"{found['located_percent']:.0f} %")
    console.print(table)


def main(argument: str) -> None:
    task = json.loads(argument)
    scenario = next(s for s in scenarios(task["method"]) if s.name == task["scenario"])
    sys.stdout.write(json.dumps(soaked(task["method"], scenario, task["exposures"])) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
