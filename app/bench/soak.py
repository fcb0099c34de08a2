"""`ispom bench --soak`: does an exposure cost as much at the end of a long run as near its start?

`python -m ispom_app.bench.soak '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from ispom.ensemble import build
from ispom.methods import Config, in_order, with_asked
from ispom.methods import method as registered

from ..run.history.history import History
from ..run.history.record import ExposureRecord
from ..run.playback import Builder, Playback
from .rounds import SCENARIOS, Scenario
from .unit import Unit, cpu_clock

EARLY = slice(1000, 2000)
"""The exposures that the last 1,000 are compared with."""
LAST = 1000
MIN_EXPOSURES = 4000
HISTORY_BYTES = 20_000_000
"""So little that the history's budget is used up early, and memory is compared after that."""
MOST = 1.1
"""The goal: time of the last exposures over that of the early ones, both in units U of their time."""
UNIT_EVERY = 25
"""Exposures between two measurements of U: an hour changes a machine's speed by more than a leak would."""
TRACKS = {"max_tracks": 80, "max_points": 80}
"""Settings for small images, of the methods that have them."""


def scenarios(method: str) -> tuple[Scenario, ...]:
    """Those whose exposures the method uses, all of them."""
    return tuple(s for s in SCENARIOS if s.kinds == registered(method).needs)


def soaked(method: str, scenario: Scenario, exposures: int, builder: Builder = build) -> dict[str, float]:
    """CPU time per exposure [ms] of estimating and remembering, and U, early and at the end; resident memory [MB]."""
    cv2.setNumThreads(1)
    early, last = Unit(), Unit()
    playback = Playback(scenario.sequence(exposures), (method,), small_images(method), builder)
    history, process = History(HISTORY_BYTES), psutil.Process()
    ms, mb, located = np.zeros(exposures), np.zeros(exposures // LAST), 0
    for i in range(exposures):
        start = cpu_clock()
        event = playback.step()
        history.append(ExposureRecord.of(event, history.last))
        ms[i] = 1e3 * (cpu_clock() - start)
        located += any(step.world_from_frame is not None for step in event.steps)
        unit = early if EARLY.start <= i < EARLY.stop else last if i >= exposures - LAST else None
        if unit is not None and i % UNIT_EVERY == 0:
            unit.measure(1)
        if (i + 1) % LAST == 0:
            mb[(i + 1) // LAST - 1] = process.memory_info().rss / 2**20
    return {
        "exposures": exposures,
        "early_ms": float(ms[EARLY].mean()),
        "last_ms": float(ms[-LAST:].mean()),
        "early_unit_ms": early.ms,
        "last_unit_ms": last.ms,
        "half_mb": float(mb[len(mb) // 2 - 1]),
        "last_mb": float(mb[-1]),
        "located_percent": 100 * located / exposures,
    }


def small_images(method: str) -> Config:
    """Settings with few tracks, of the method and those that it asks; else the defaults."""
    config = Config()
    for name in with_asked(in_order((method,))):
        settings = config.of(name)
        few = {key: value for key, value in TRACKS.items() if hasattr(settings, key)}
        config = config.with_settings(name, replace(settings, **few))
    return config


def print_soak(console: Console, method: str, rows: dict[str, dict[str, Any]]) -> None:
    """By scenario what `soaked` found, or {"error": ...}."""
    head = ("ms, 1,000 to 2,000", "ms, last 1,000", "ratio in U", "MB, half way", "MB, end", "located")
    table = Table(method, *head, box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for name, found in rows.items():
        if "error" in found:
            console.print(f"{method}, {name}: {found['error']}")
            continue
        ratio = found["last_ms"] / found["last_unit_ms"] / (found["early_ms"] / found["early_unit_ms"])
        times = (f"{found['early_ms']:.2f}", f"{found['last_ms']:.2f}", f"{ratio:.2f}{'' if ratio <= MOST else ' !'}")
        memory = (f"{found['half_mb']:.0f}", f"{found['last_mb']:.0f}")
        table.add_row(name, *times, *memory, f"{found['located_percent']:.0f} %")
    console.print(table)


def main(argument: str) -> None:
    task = json.loads(argument)
    scenario = next(s for s in scenarios(task["method"]) if s.name == task["scenario"])
    sys.stdout.write(json.dumps(soaked(task["method"], scenario, task["exposures"])) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
