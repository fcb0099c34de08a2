"""What `ispom bench --page` measures, and prints."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from .processes import App, serving, visitors
from .served import Served
from .visitor import Visitor, visiting

SAMPLES = 200
"""Of each kind of move."""
QUIET_S = 0.2
"""Without a message of viser, the panels are as they will stay."""
MOST_MS, MOST_RATIO = 100.0, 1.1
"""The goals: from a command to the page, and the worker's time over that of the same run headless."""


@dataclass(frozen=True)
class Attendance:
    """Who looks at a run."""

    name: str
    count: int = 0
    reads: bool = True
    killed: bool = False
    """Half way."""


ATTENDANCES = (
    Attendance("nobody"),
    Attendance("1 page", 1),
    Attendance("10 pages", 10),
    Attendance("10 that read nothing", 10, reads=False),
    Attendance("10 that are killed", 10, killed=True),
)


def attended(served: Served, attendance: Attendance) -> dict[str, Any]:
    """CPU time of the worker per exposure [ms], that of the same run headless, and whether both gave the same
    trajectories to the byte."""
    with serving(served) as app, visitors(app, attendance.count, attendance.reads) as present:

        async def played() -> None:
            async with visiting(app.address) as starter:
                await starter.send({"do": "take_over"})
                await starter.send({"do": "play"})
                half = served.exposures // 2 if attendance.killed else 1
                await starter.until(lambda state: state["computed"] >= half)
                if attendance.killed and present is not None:
                    present.kill()

        asyncio.run(played())
        return {"who": attendance.name, **app.told()}


def answered(served: Served, samples: int = SAMPLES) -> dict[str, Any]:
    """Times of moves in a run and a branch of it [ms], and the app's memory [MB] before and after the branch."""
    with serving(served) as app:
        return asyncio.run(_answered(app, served, samples))


async def _answered(app: App, served: Served, samples: int) -> dict[str, Any]:
    async with visiting(app.address) as visitor:
        await visitor.send({"do": "play"})
        await asyncio.to_thread(app.told)
        memory = {"one_run_mb": app.memory_mb}
        await asyncio.to_thread(app.told)
        memory |= {"two_branches_mb": app.memory_mb}
        places = np.random.default_rng(0).permutation(np.linspace(1, served.exposures - 1, samples).astype(int))
        moves: dict[str, Any] = {}
        for name, move in (("step back", _back), ("seek", _seek), ("show a branch", _show)):
            times = [await move(visitor, int(place)) for place in places]
            moves[name] = {"state_ms": [1e3 * t[0] for t in times], "panels_ms": [1e3 * t[1] for t in times]}
        return memory | {"exposures": served.exposures, "samples": samples, "moves": moves}


async def _timed(
    visitor: Visitor, command: dict[str, Any], holds: Callable[[dict[str, Any]], object]
) -> tuple[float, float]:
    """Seconds from the command to the page's new state, and to the last of viser's messages about it."""
    began = time.monotonic()
    await visitor.send(command)
    state_s = await visitor.until(holds, 60.0)
    return state_s - began, await visitor.quiet(state_s, QUIET_S) - began


async def _back(visitor: Visitor, place: int) -> tuple[float, float]:
    await _seek(visitor, place)
    return await _timed(visitor, {"do": "back"}, lambda state: state["index"] == place - 1)


async def _seek(visitor: Visitor, place: int) -> tuple[float, float]:
    return await _timed(visitor, {"do": "seek", "index": place}, lambda state: state["index"] == place)


async def _show(visitor: Visitor, place: int) -> tuple[float, float]:
    """The other one of two branches, at an exposure that both have."""
    await _seek(visitor, place)
    other = 1 - visitor.state["address"]["branch"]
    command = {"do": "show_branch", "number": other}
    return await _timed(visitor, command, lambda state: state["address"]["branch"] == other)


def print_attended(console: Console, found: list[dict[str, Any]]) -> None:
    table = Table("CPU time per exposure", "app's worker", "headless", "ratio", "trajectories", box=None)
    for row in found:
        ratio = row["worker_ms"] / row["headless_ms"]
        times = f"{row['worker_ms']:.2f} ms", f"{row['headless_ms']:.2f} ms"
        outcome = "the same" if row["same"] else "differ !"
        table.add_row(row["who"], *times, f"{ratio:.2f}{'' if ratio <= MOST_RATIO else ' !'}", outcome)
    console.print(table)


def print_answered(console: Console, found: dict[str, Any]) -> None:
    head = f"{found['exposures']} exposures, {found['samples']} moves of each kind"
    table = Table(head, "state: median", "95 % below", "panels: median", "95 % below", box=None)
    for name, times in found["moves"].items():
        cells = [p for kind in ("state_ms", "panels_ms") for p in np.percentile(times[kind], [50, 95])]
        table.add_row(name, *(f"{ms:.1f} ms{'' if ms <= MOST_MS else ' !'}" for ms in cells))
    console.print(table)
    console.print(f"memory of the app: {found['one_run_mb']:.0f} MB, with a branch {found['two_branches_mb']:.0f} MB")
