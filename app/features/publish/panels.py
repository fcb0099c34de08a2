"""The left pane of a published page: the view values of each frame, and what is the same at all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.layers import HINTS, LAYERS, OPTIONAL
from ...views.web.view_values import listed, value_of, views
from ..layers.panel import METHOD_HINT, legend
from ..layers.state import offered

CHUNK = 100
"""Frames whose values are in one file: the page loads those around the frame that it shows."""


def values_at(state: State, run: CurrentRun, index: int) -> dict[str, dict[str, Any]]:
    """By name of the view: its value at a frame."""
    at = replace(state, displayed=run.history[index])
    return {view.name: value_of(view, at, run) for view in views()}


def frame_panels(state: State, run: CurrentRun) -> Iterator[dict[str, dict[str, Any]]]:
    """Of each frame, by name of the view: the fields that differ from those of the first frame."""
    first = values_at(state, run, 0)
    for index in range(len(run.history)):
        yield {
            name: {field: found for field, found in value.items() if found != first[name][field]}
            for name, value in values_at(state, run, index).items()
        }


def fixed_panels(state: State, run: CurrentRun) -> dict[str, Any]:
    """The views and their values at the first frame, the legend, and the layers."""
    return {
        "listed": listed(),
        "first": values_at(state, run, 0),
        "legend": legend(state.methods),
        "layers": [[m, colours.label(m), METHOD_HINT] for m in state.methods]
        + [[name, LAYERS[name], HINTS[name]] for name in offered(run.opened, state.methods) if name not in OPTIONAL],
        "chunk": CHUNK,
        "count": len(run.history),
    }
