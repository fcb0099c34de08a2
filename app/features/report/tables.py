"""A run's tables: counts, times and decisions. Units stand in the heads."""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.types import TrackStatus

from ...engine.history.step_quantities.step import DROPPED
from ...engine.run_folder.run_folder import EVENTS
from .analysis import changes, notable
from .blocks import Block, Details, MethodName, Paragraph, Table
from .folder import Run

MOST_DECISIONS = MOST_EVENTS = 60
"""Most decisions, and most events, of a run that are listed in full."""


def counts(run: Run) -> Table:
    """Keyframes, states, tracks, inliers: a column per method."""
    columns = list(run.steps.items())
    rows: list[list[Any]] = [
        ["exposures", *(len(s.status) for _, s in columns)],
        *([f"– {state}", *(s.status.count(state) for _, s in columns)] for state in ("initialising", "lost")),
        ["keyframes (integrated: segments closed)", *(int(s.key_frame.sum()) for _, s in columns)],
        ["time between them, median [s]", *(_between_s(s.times_ns[s.key_frame]) for _, s in columns)],
        ["inliers, median", *(_median(s.columns["inliers"]) for _, s in columns)],
        ["residual, median of medians [px]", *(_median(s.columns["residual_median_px"]) for _, s in columns)],
        ["tracks alive, median", *(_median(s.columns["alive"]) for _, s in columns)],
        ["tracks started", *(_total(s.columns["new"]) for _, s in columns)],
        ["tracks dropped", *(_total(s.dropped) for _, s in columns)],
    ]
    for name, status in DROPPED.items():
        if any(np.nansum(s.columns[name]) for _, s in columns):
            rows.append([f"– {TrackStatus(status).reason}", *(_total(s.columns[name]) for _, s in columns)])
    return Table([run.label, *(MethodName(method) for method, _ in columns)], rows)


def _median(values: np.ndarray) -> float | None:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else None


def _total(values: np.ndarray) -> int | None:
    return int(np.nansum(values)) if np.isfinite(values).any() else None


def _between_s(times_ns: np.ndarray) -> float | None:
    return float(np.median(np.diff(times_ns))) * 1e-9 if len(times_ns) > 1 else None


def stages(run: Run) -> Table:
    """Time per stage."""
    rows = []
    for method, steps in run.steps.items():
        total = sum(float(values.sum()) for values in steps.stages.values())
        for stage, values in steps.stages.items():
            ms = 1e3 * values[values > 0]
            if len(ms):
                share = 100 * float(values.sum()) / (total or 1.0)
                statistics = [float(np.median(ms)), float(np.percentile(ms, 95)), float(ms.max())]
                rows.append([stage, MethodName(method), len(ms), *statistics, share])
    head = [run.label, "method", "runs", "median [ms]", "95th percentile [ms]", "longest [ms]", "share of method [%]"]
    return Table(head, rows)


def events(run: Run) -> list[Block]:
    """What happened when, in words."""
    if run.events is None:
        return [Paragraph("This run was made by an earlier version, which wrote no events.", "quiet")]
    if not run.events:
        return [Paragraph("No loss, jump or warning.")]
    rows = [
        [
            e.frame,
            float(run.seconds(np.array(e.time_ns))),
            MethodName(e.method) if e.method else "",
            str(e.severity),
            e.sentence,
        ]
        for e in run.events[:MOST_EVENTS]
    ]
    more = len(run.events) - MOST_EVENTS
    rest = [Paragraph(f"{more} more in {EVENTS}.", "quiet")] if more > 0 else []
    return [Table(["frame", "time [s]", "method", "severity", "event"], rows, numeric=False), *rest]


def decisions(run: Run) -> list[Block]:
    """Changes of state and failed checks in full; every check as counts."""
    events = sorted(_events(run), key=lambda event: event[0])
    head = ["exposure", "time [s]", "method", "event", "consequence"]
    found: list[Block] = [Paragraph("No check failed, and no method was lost.")]
    if events:
        found = [Table(head, events[:MOST_DECISIONS], numeric=False)]
    if len(events) > MOST_DECISIONS:
        found.append(Paragraph(f"The first {MOST_DECISIONS} of {len(events)}.", "quiet"))
    return [*found, Details(f"All checks of {run.label}, counted", [_checks(run)])]


def _events(run: Run) -> list[list[Any]]:
    found = []
    for method, steps in run.steps.items():
        for row, before, after in changes(steps):
            if before:
                time_s = float(run.seconds(steps.times_ns[row]))
                found.append([int(steps.exposures[row]), time_s, MethodName(method), f"{before} → {after}", ""])
    for row in notable(run):
        what = str(row.decision).removesuffix(f" ({row.decision.consequence})")
        time_s = (row.time_ns - run.first_ns) * 1e-9
        found.append([row.exposure, time_s, MethodName(row.method), what, row.decision.consequence])
    return found


def _checks(run: Run) -> Table:
    grouped: dict[tuple[str, str], list[Any]] = {}
    for row in run.decisions:
        grouped.setdefault((row.method, row.decision.name), []).append(row.decision)
    rows = []
    for (method, name), found in grouped.items():
        values = [d.value for d in found]
        threshold = f"{found[-1].relation} {found[-1].threshold:.4g} {found[-1].unit}".strip()
        passed = sum(d.passed for d in found)
        rows.append(
            [
                MethodName(method),
                name,
                threshold,
                len(found),
                passed,
                float(np.median(values)),
                min(values),
                max(values),
            ]
        )
    return Table(["method", "check", "threshold", "times", "passed", "median", "smallest", "largest"], rows)
