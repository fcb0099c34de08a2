"""What `ispom bench` prints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from .plan import PEERS, PEERS_UNIT_MS, Case

COLUMNS = ("ms", "p95", "in U", "t_err %", "ATE m", "poses", "MB")


@dataclass(frozen=True)
class Row:
    """One method on one source: what measure.py found, or {"error": ...}."""

    case: str
    method: str
    found: dict[str, Any]


def print_case(console: Console, case: Case, rows: list[Row]) -> None:
    """A table of accuracy, speed and memory with the peers' figures, and one of the stages."""
    table = Table("", *COLUMNS, title=case.title, title_justify="left", pad_edge=False, box=None)
    _aligned(table)
    for kind in dict.fromkeys(map(_kind, rows)):
        for row in (r for r in rows if _kind(r) == kind and "error" not in r.found):
            table.add_row(row.method, *_cells(row.found))
        for peer in PEERS.get((case.key, kind), ()):
            table.add_row(
                f"  {peer.name}", "", "", peer.unit_ratio, peer.t_err_percent, peer.ate_m, "", "", style="dim"
            )
    console.print(table)
    for row in rows:
        for note in _notes(row.found):
            console.print(f"{row.method}: {note}")
    for kind in dict.fromkeys(map(_kind, rows)):
        for peer in PEERS.get((case.key, kind), ()):
            if peer.note:
                console.print(f"  {peer.name}, {kind}: {peer.note}")
    stages = [(row, stage, ms) for row in rows for stage, ms in row.found.get("stages_ms", {}).items()]
    if stages:
        console.print(_stages(stages))
    console.print()


def _kind(row: Row) -> str:
    """What other programs are compared with: `stereo` of stereo.paper."""
    return row.method.partition(".")[0]


def _cells(found: dict[str, Any]) -> list[str]:
    ms = found["ms"]
    return [
        _number(ms["median"], ".1f"),
        _number(ms["p95"], ".1f"),
        _number(ms["median"] / found["unit_ms"], ".2f"),
        _number(found.get("t_err_percent"), ".2f"),
        _number(found.get("ate_m"), ".3f") + f" {found['aligned']}" if found.get("ate_m") is not None else "-",
        f"{found['poses']}/{found['asked']}",
        _number(found["peak_mb"], ".0f"),
    ]


def _notes(found: dict[str, Any]) -> list[str]:
    """What has no column."""
    if "error" in found:
        return [f"skipped: {found['error']}"]
    notes = []
    if found["lost"]:
        notes.append(f"lost at {found['lost']} frames")
    if found.get("largest_drift_m") is not None and found.get("t_err_percent") is None:
        notes.append(f"largest distance from the truth, first pose given: {1e3 * found['largest_drift_m']:.1f} mm")
    if found.get("between_stereo_rmse_m") is not None:
        own, spline = found["between_stereo_rmse_m"], found["spline_between_stereo_rmse_m"]
        notes.append(f"between stereo frames {1e3 * own:.1f} mm, stereo by spline {1e3 * spline:.1f} mm")
    if found.get("step_scale_end_over_start") is not None:
        notes.append(f"step scale at the end {found['step_scale_end_over_start']:.3f} of that at the start")
    return notes


def _stages(stages: list[tuple[Row, str, dict[str, float]]]) -> Table:
    table = Table("stage", "median ms", "p95 ms", pad_edge=False, box=None)
    _aligned(table)
    for row, stage, ms in stages:
        table.add_row(f"{row.method}: {stage}", _number(ms["median"], ".2f"), _number(ms["p95"], ".2f"))
    return table


def print_blocks(console: Console, blocks: Any) -> None:
    if isinstance(blocks, dict):
        console.print(f"building blocks: {blocks['error']}")
        return
    table = Table("building block", "", "in U", "goal", "", pad_edge=False, box=None)
    _aligned(table)
    for block in blocks:
        reached = "reached" if block["reached"] else "missed"
        value = f"{block['value']:.2f} {block['unit']}"
        table.add_row(block["name"], value, _number(block["unit_ratio"], ".2f"), block["wanted"], reached)
    console.print(table)
    for block in blocks:
        if block["note"]:
            console.print(f"{block['name']}: {block['note']}")
    console.print()


def print_unit(console: Console, rows: list[dict[str, Any]]) -> None:
    """How to read the numbers."""
    units = [row["found"]["unit_ms"] for row in rows if "unit_ms" in row["found"]]
    if not units:
        return
    pair = next(row["found"]["unit_pair"] for row in rows if "unit_pair" in row["found"])
    low, high = float(np.min(units)), float(np.max(units))
    console.print(
        f"U = {np.median(units):.1f} ms (in the rows' processes {low:.1f} to {high:.1f}): forward-backward KLT of 500 "
        f"points, 21x21, 4 levels, 30 iterations, one thread, on {pair}; the peers' was {PEERS_UNIT_MS} ms.\n"
        "ms and p95: CPU time per frame (of stages: wall time), one thread, decoding excluded, medians of the runs; "
        "t_err over 5, 10, 20 and 40 m (from 200 m on 100 to 800 m); ATE after the alignment that stands beside it; "
        "MB: peak of the process."
    )


def _aligned(table: Table) -> None:
    for column in table.columns:
        column.no_wrap = True
        column.justify = "left" if column is table.columns[0] else "right"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None or not np.isfinite(value) else format(value, form)
