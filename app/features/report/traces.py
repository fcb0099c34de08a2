"""Lines and layouts of figures, as Plotly's JSON; the page, which knows its theme, colours text and grid."""

from __future__ import annotations

import html
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...presentation import colours

MAX_POINTS = 1200
"""Most points of a line: more are not visible."""
ALL_POINTS = 2400
"""Most points of the lines of all runs for one quantity, so that a page of many runs stays small."""
TIME = "time since the first frame [s]"


@dataclass(frozen=True)
class Figure:
    """One plot."""

    title: str
    traces: list[dict[str, Any]]
    layout: dict[str, Any] = field(default_factory=dict)
    note: str = ""
    """What a reader must know to read it rightly."""


def points_per_line(runs: int) -> int:
    """Returns the most points that a line may have in a page of `runs` runs."""
    return max(100, min(MAX_POINTS, ALL_POINTS // runs))


def colour_of(method: str) -> str:
    """As CSS writes it."""
    return colours.css(colours.of(method))


def line(name: str, colour: str, x: np.ndarray, y: np.ndarray, dash: str = "solid") -> dict[str, Any]:
    """Plotly reads names as its own kind of HTML, therefore escaped here."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": html.escape(name),
        "x": rounded(x),
        "y": rounded(y),
        "line": {"color": colour, "width": 1.8, "dash": dash},
    }


def thinned(
    most: int,
    name: str,
    colour: str,
    times: np.ndarray,
    values: np.ndarray,
    dash: str = "solid",
    peaks: bool = True,
) -> dict[str, Any]:
    """Returns a line of at most `most` points that keeps the peaks; without `peaks`, it is thinned evenly."""
    if len(values) > most:
        parts = np.array_split(np.arange(len(values)), most)
        index = np.array([part[np.argmax(values[part])] if peaks else part[0] for part in parts])
        times, values = times[index], values[index]
    marks = {"mode": "lines+markers", "marker": {"size": 4}} if len(values) <= 60 else {}
    return line(name, colour, times, values, dash) | marks


def over_time(title: str) -> dict[str, Any]:
    """The layout of a plot over time."""
    return {"xaxis": {"title": TIME}, "yaxis": {"title": title, "rangemode": "tozero"}, "height": 330}


def rounded(values: np.ndarray) -> list[float | None]:
    """Six digits are more than a screen shows; null for what is no number."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in np.asarray(values, float)]
