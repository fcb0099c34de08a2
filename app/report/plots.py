"""The report's figures as Plotly's JSON. Colours of text and grid come from the page, which knows its theme."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ispom.types import TrackStatus, Trajectory

from .. import colours
from ..run.step_log import DROPPED
from .analysis import drawn, errors, step_scale
from .folder import Run

MAX_POINTS = 1200
"""Of a line: more are not seen."""
ALL_POINTS = 2400
"""Of the lines of all runs for one thing, so that a page of many runs stays small."""
BINS = 150
"""Of counted things over time."""
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
TIME = "time since the first exposure [s]"


@dataclass(frozen=True)
class Figure:
    """One plot."""

    title: str
    traces: list[dict[str, Any]]
    layout: dict[str, Any] = field(default_factory=dict)
    note: str = ""
    """What a reader must know to read it rightly."""


def points_per_line(runs: int) -> int:
    """How many points a line may have in a page of so many runs."""
    return max(100, min(MAX_POINTS, ALL_POINTS // runs))


def paths(run: Run, most: int = MAX_POINTS) -> Figure:
    """From above, from the side and from the front: x right, y down, z forward."""
    planes = (("above", 0, 2, "x [m]", "z [m]"), ("the side", 2, 1, "z [m]", "y, down [m]"))
    planes += (("the front", 0, 1, "x [m]", "y, down [m]"),)
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"annotations": [], "height": 430}
    placed = list(_placed(run))
    for n, (seen, across, up, x_title, y_title) in enumerate(planes, 1):
        number = "" if n == 1 else str(n)
        left = (n - 1) * 0.355
        layout[f"xaxis{number}"] = {"domain": [left, left + 0.29], "title": x_title, "anchor": f"y{number}"}
        layout[f"yaxis{number}"] = {"title": y_title, "anchor": f"x{number}", "scaleanchor": f"x{number}"}
        if up == 1:
            layout[f"yaxis{number}"]["autorange"] = "reversed"
        layout["annotations"].append(
            {"text": f"from {seen}", "x": left + 0.145, "y": 1.09, "xref": "paper", "yref": "paper", "showarrow": False}
        )
        for name, colour, trajectory, dash in placed:
            xyz, seconds = _thinned(run, trajectory, most)
            traces.append(
                _line(name, colour, xyz[:, across], xyz[:, up], dash)
                | {"xaxis": f"x{number}", "yaxis": f"y{number}", "legendgroup": name, "showlegend": n == 1}
                | {"customdata": _rounded(seconds), "hovertemplate": "%{x} m, %{y} m at %{customdata} s"}
                | _marked(trajectory)
            )
    how = "; ".join(f"{method}: {drawn(run, method)[1]}" for method in run.trajectories)
    return Figure(f"{run.label}: path", traces, layout, f"Aligned: {how}.")


def path_3d(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for name, colour, trajectory, dash in _placed(run):
        xyz, _ = _thinned(run, trajectory, most)
        line = _line(name, colour, xyz[:, 0], xyz[:, 1], dash if dash in ("solid", "dash") else "solid")
        traces.append(line | {"z": _rounded(xyz[:, 2]), "type": "scatter3d"})
    axes = {f"{a}axis": {"title": f"{a} [m]"} for a in "xyz"}
    camera = {"up": {"x": 0, "y": -1, "z": 0}, "eye": {"x": 1.9, "y": -1.9, "z": -2.2}}
    return Figure(
        f"{run.label}: path in 3-D", traces, {"scene": {"aspectmode": "data", "camera": camera, **axes}, "height": 560}
    )


def position_errors(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method in run.trajectories:
        colour = colours.css(colours.METHOD[method])
        if (found := errors(run, method)) is not None:
            traces.append(_peaks(most, f"{method}, final", colour, run.seconds(found.times_ns), found.position_m))
        if method in run.steps:
            live = run.steps[method]
            known = np.isfinite(live.columns["error_m"])
            if known.any():
                times, values = run.seconds(live.times_ns[known]), live.columns["error_m"][known]
                traces.append(
                    _peaks(most, f"{method}, as it ran", colour, times, values, "dot") | {"visible": "legendonly"}
                )
    note = (
        "Final: poses as at the end, aligned as above. As it ran (click in the legend): each pose as first given, "
        "from the common start, not aligned."
    )
    return Figure(f"{run.label}: position", traces, _over_time("distance from truth [m]"), note)


def rotation_errors(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = [
        _peaks(most, method, colours.css(colours.METHOD[method]), run.seconds(found.times_ns), found.rotation_deg)
        for method in run.trajectories
        if (found := errors(run, method)) is not None
    ]
    note = "Final poses, all turned alike such that their orientations come closest to the truth on average."
    return Figure(f"{run.label}: orientation", traces, _over_time("angle from truth [deg]"), note)


def together(runs: list[Run], most: int = MAX_POINTS) -> Figure:
    """The errors of all runs in one plot, a kind of line for each run."""
    traces = []
    for run, dash in zip(runs, DASHES * (1 + len(runs) // len(DASHES)), strict=False):
        for method in run.trajectories:
            if (found := errors(run, method)) is not None:
                colour = colours.css(colours.METHOD[method])
                traces.append(
                    _peaks(most, f"{run.label}: {method}", colour, run.seconds(found.times_ns), found.position_m, dash)
                )
    layout = _over_time("distance from truth [m]") | {"height": 420}
    return Figure("All runs", traces, layout, "Final poses. A kind of line per run, a colour per method.")


def step_scales(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method in run.trajectories:
        if (found := step_scale(run, method)) is not None:
            traces.append(
                _peaks(most, method, colours.css(colours.METHOD[method]), run.seconds(found[0]), found[1], keep=None)
            )
    note = (
        "Length moved in a second (in a short run: in a fifth of it) over the true one. "
        "Monocular: relative to its first ten."
    )
    layout = _over_time("estimated / true length [1]")
    layout["yaxis"]["rangemode"] = "normal"
    return Figure(f"{run.label}: scale against truth", traces, layout, note)


def transferred_scales(run: Run, most: int = MAX_POINTS) -> Figure:
    units = {"monocular": "unit carried on [1]", "stereo": "unit [1]", "integrated": "m per monocular unit"}
    traces = []
    for method, steps in run.steps.items():
        known = np.isfinite(steps.columns["scale"])
        if known.any():
            name, colour = f"{method}: {units[method]}", colours.css(colours.METHOD[method])
            values = steps.columns["scale"][known]
            traces.append(_peaks(most, name, colour, run.seconds(steps.times_ns[known]), values, keep=None))
    note = "What each method itself carried from step to step."
    return Figure(f"{run.label}: scale that the method used", traces, _over_time("factor, see the legend"), note)


def tracks(run: Run, method: str) -> Figure:
    steps = run.steps[method]
    known = np.isfinite(steps.columns["alive"])
    times, traces, seen = run.seconds(steps.times_ns[known]), [], {}
    for name, status in (("alive", TrackStatus.ALIVE), ("new", TrackStatus.NEW), *DROPPED.items()):
        values = steps.columns[name][known]
        if not values.any():
            continue
        middles, means = _binned(times, values)
        colour = colours.TRACK[status]
        shades = seen.setdefault(colour, [])
        shades.append(name)
        css = colours.css(colours.shade(colour, (40, 40, 40), 0.45 * (len(shades) - 1)))
        if name == "alive":
            traces.append(_line(status.reason, css, middles, means))
        else:
            sign = -1 if status.dropped else 1
            bar = {"type": "bar", "x": _rounded(middles), "y": _rounded(sign * means), "name": status.reason}
            traces.append(bar | {"marker": {"color": css}})
    layout = _over_time("tracks per exposure") | {"barmode": "relative", "bargap": 0}
    note = f"Upwards: alive and new; downwards: ended, by reason. Means of up to {BINS} spans of time."
    return Figure(f"{run.label}: {method} tracks", traces, layout, note)


def timing(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method, steps in run.steps.items():
        ms = 1e3 * steps.columns["seconds"]
        known = np.isfinite(ms)
        traces.append(
            _peaks(most, method, colours.css(colours.METHOD[method]), run.seconds(steps.times_ns[known]), ms[known])
        )
    layout = _over_time("wall time per exposure [ms]")
    layout["yaxis"] |= {"type": "log", "dtick": 1, "minor": {"showgrid": True, "dtick": "D1"}}
    return Figure(
        f"{run.label}: wall time", traces, layout, "The integrated method contains the time of the two inside it."
    )


def _placed(run: Run) -> Iterator[tuple[str, str, Trajectory, str]]:
    """Name, colour, trajectory and kind of line, the truth first: it lies below."""
    if run.truth is not None:
        last = max((t.times_ns[-1] for t in run.trajectories.values() if len(t)), default=run.truth.times_ns[-1])
        yield "truth", colours.css(colours.TRUTH), run.truth.select(run.truth.times_ns <= last), "solid"
    for method in run.trajectories:
        yield method, colours.css(colours.METHOD[method]), drawn(run, method)[0], "solid"


def _marked(trajectory: Trajectory) -> dict[str, Any]:
    """Few poses are seen as points too: a line between them was never estimated."""
    return {"mode": "lines+markers", "marker": {"size": 5}} if len(trajectory) <= 60 else {}


def _thinned(run: Run, trajectory: Trajectory, most: int) -> tuple[np.ndarray, np.ndarray]:
    keep = np.unique(np.linspace(0, len(trajectory) - 1, min(len(trajectory), most)).astype(int))
    return trajectory.translations[keep], run.seconds(trajectory.times_ns[keep])


def _peaks(
    most: int,
    name: str,
    colour: str,
    times: np.ndarray,
    values: np.ndarray,
    dash: str = "solid",
    keep: Any = np.argmax,
) -> dict[str, Any]:
    """A line thinned such that its peaks stay; without `keep`, evenly."""
    if len(values) > most:
        parts = np.array_split(np.arange(len(values)), most)
        index = np.array([part[keep(values[part])] if keep else part[0] for part in parts])
        times, values = times[index], values[index]
    marks = {"mode": "lines+markers", "marker": {"size": 4}} if len(values) <= 60 else {}
    return _line(name, colour, times, values, dash) | marks


def _line(name: str, colour: str, x: np.ndarray, y: np.ndarray, dash: str = "solid") -> dict[str, Any]:
    """Plotly reads names as its own kind of HTML."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": html.escape(name),
        "x": _rounded(x),
        "y": _rounded(y),
        "line": {"color": colour, "width": 1.8, "dash": dash},
    }


def _binned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(BINS, len(values))
    split = [np.array_split(a, count) for a in (times, values)]
    return tuple(np.array([part.mean() for part in parts]) for parts in split)  # type: ignore[return-value]


def _over_time(title: str) -> dict[str, Any]:
    return {"xaxis": {"title": TIME}, "yaxis": {"title": title, "rangemode": "tozero"}, "height": 330}


def _rounded(values: np.ndarray) -> list[float | None]:
    """Six digits are more than a screen shows; null for what is no number."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in np.asarray(values, float)]
