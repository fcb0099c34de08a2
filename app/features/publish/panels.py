"""The left pane of a published page as HTML: the tab Explain at each frame, and what is the same at all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.layers import HINTS, LAYERS, OPTIONAL
from ..explain.panel import FOLDERS, Latest, event_values, latest_records, ongoing, render, report_values
from ..layers.panel import METHOD_HINT, legend

CHUNK = 100
"""Frames whose HTML is in one file: the page loads those around the frame that it shows."""
MOST_EVENTS = 1000
"""Events that are listed."""


def frame_panels(state: State, run: CurrentRun) -> Iterator[dict[str, str]]:
    """Of each frame the HTML of its parts: the verdicts, and what is folded below them."""
    latest: Latest = {}
    for index in range(len(run.history)):
        at = replace(state, displayed=run.history[index])
        latest = latest_records(run, at, latest)
        before = {method: record for (_, _, method), record in latest.items()}
        values = report_values(at, before, at.methods) | {"notes": ()}
        parts = {"verdicts.html": render("verdicts.html", **values, ongoing=ongoing(run, index))}
        parts |= {template: render(template, **values) for template in FOLDERS}
        yield {template.removesuffix(".html"): text for template, text in parts.items()}


def fixed_panels(state: State, run: CurrentRun) -> dict[str, Any]:
    """What is the same at every frame: the events, the legend, the layers, and the notes about the source."""
    first = replace(state, displayed=run.history[0])
    return {
        "folded": {template.removesuffix(".html"): label for template, label in FOLDERS.items()},
        "events": render("events.html", **event_values(first, run, MOST_EVENTS)),
        "legend": legend(),
        "layers": [[m, colours.label(m), METHOD_HINT] for m in state.methods]
        + [[name, label, HINTS[name]] for name, label in LAYERS.items() if name not in OPTIONAL],
        "notes": list(state.notes),
        "chunk": CHUNK,
        "count": len(run.history),
    }
