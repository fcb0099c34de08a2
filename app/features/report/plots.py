"""Figures over time: errors, scale, tracks and the time that each frame took."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ispom.methods import method as registered
from ispom.types import TrackStatus, Trajectory

from ...engine.history.step_quantities.step import DROPPED
from ...presentation import colours
from .analysis import errors, plotted, step_scale
from .folder import Run
from .traces import MAX_POINTS, Figure, colour_of, line, over_time, rounded, thinned

BINS = 150
"""Number of bins over time."""
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")


def position_errors(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method in run.trajectories:
        colour = colour_of(method)
        if (found := errors(run, method)) is not None:
            traces.append(thinned(most, f"{method}, final", colour, run.seconds(found.times_ns), found.position_m))
        if method in run.steps:
            live = run.steps[method]
            known = np.isfinite(live.columns["error_m"])
            if known.any():
                times, values = run.seconds(live.times_ns[known]), live.columns["error_m"][known]
                traces.append(
                    thinned(most, f"{method}, live estimate", colour, times, values, "dot") | {"visible": "legendonly"}
                )
    note = (
        "Final: poses at the end of the run, aligned as above. Live estimate (click in the legend): each pose as first "
        "computed, from the common start, not aligned."
    )
    return Figure(f"{run.label}: position", traces, over_time("distance from truth [m]"), note)


def rotation_errors(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = [
        thinned(most, method, colour_of(method), run.seconds(found.times_ns), found.rotation_deg)
        for method in run.trajectories
        if (found := errors(run, method)) is not None
    ]
    note = "Final poses, all turned by the one rotation that brings their orientations closest to the truth on average."
    return Figure(f"{run.label}: orientation", traces, over_time("angle from truth [deg]"), note)


def all_position_errors(runs: list[Run], most: int = MAX_POINTS) -> Figure:
    """The errors of all runs in one plot, a kind of line for each run."""
    traces = []
    for run, dash in zip(runs, DASHES * (1 + len(runs) // len(DASHES)), strict=False):
        for method in run.trajectories:
            if (found := errors(run, method)) is not None:
                colour = colour_of(method)
                traces.append(
                    thinned(most, f"{run.label}: {method}", colour, run.seconds(found.times_ns), found.position_m, dash)
                )
    layout = over_time("distance from truth [m]") | {"height": 420}
    return Figure("All runs", traces, layout, "Final poses. A kind of line per run, a colour per method.")


def step_scales(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method in run.trajectories:
        if (found := step_scale(run, method)) is not None:
            traces.append(thinned(most, method, colour_of(method), run.seconds(found[0]), found[1], peaks=False))
    note = (
        "Length moved in a second (in a short run: in a fifth of it) over the true one. "
        "Monocular: relative to its first ten."
    )
    layout = over_time("estimated / true length [1]")
    layout["yaxis"]["rangemode"] = "normal"
    return Figure(f"{run.label}: scale against truth", traces, layout, note)


def transferred_scales(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method, steps in run.steps.items():
        known = np.isfinite(steps.columns["scale"])
        if known.any():
            name, colour = f"{method}: {registered(method).scale}", colour_of(method)
            values = steps.columns["scale"][known]
            traces.append(thinned(most, name, colour, run.seconds(steps.times_ns[known]), values, peaks=False))
    note = "The factor that each method itself used from step to step."
    return Figure(f"{run.label}: scale used by the method", traces, over_time("factor, see the legend"), note)


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
            traces.append(line(status.reason, css, middles, means))
        else:
            sign = -1 if status.dropped else 1
            bar = {"type": "bar", "x": rounded(middles), "y": rounded(sign * means), "name": status.reason}
            traces.append(bar | {"marker": {"color": css}})
    layout = over_time("tracks per frame") | {"barmode": "relative", "bargap": 0}
    note = f"Above zero: alive and new; below: dropped, by reason. Means of up to {BINS} spans of time."
    return Figure(f"{run.label}: {method} tracks", traces, layout, note)


def timing(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method, steps in run.steps.items():
        ms = 1e3 * steps.columns["seconds"]
        known = np.isfinite(ms)
        traces.append(thinned(most, method, colour_of(method), run.seconds(steps.times_ns[known]), ms[known]))
    layout = over_time("wall time per frame [ms]")
    layout["yaxis"] |= {"type": "log", "dtick": 1, "minor": {"showgrid": True, "dtick": "D1"}}
    return Figure(
        f"{run.label}: wall time", traces, layout, "The integrated method contains the time of the two inside it."
    )


def _binned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(BINS, len(values))
    split = [np.array_split(a, count) for a in (times, values)]
    return tuple(np.array([part.mean() for part in parts]) for parts in split)  # type: ignore[return-value]


PLANES = (
    ("above", 0, 2, "x [m]", "z [m]"),
    ("the side", 2, 1, "z [m]", "y, down [m]"),
    ("the front", 0, 1, "x [m]", "y, down [m]"),
)
"""Seen from, axis to the right, axis upwards, and their titles: x right, y down, z forward."""


def in_planes(run: Run, most: int = MAX_POINTS) -> Figure:
    """From above, from the side and from the front."""
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"annotations": [], "height": 430}
    placed = list(_placed(run))
    for n, (seen, across, up, x_title, y_title) in enumerate(PLANES, 1):
        number = "" if n == 1 else str(n)
        left = (n - 1) * 0.37
        layout[f"xaxis{number}"] = {"domain": [left, left + 0.26], "title": x_title, "anchor": f"y{number}"}
        layout[f"yaxis{number}"] = {"title": y_title, "anchor": f"x{number}", "scaleanchor": f"x{number}"}
        if up == 1:
            layout[f"yaxis{number}"]["autorange"] = "reversed"
        layout["annotations"].append(
            {"text": f"from {seen}", "x": left + 0.13, "y": 1.09, "xref": "paper", "yref": "paper", "showarrow": False}
        )
        for name, colour, trajectory in placed:
            xyz, seconds = _few(run, trajectory, most)
            traces.append(
                line(name, colour, xyz[:, across], xyz[:, up])
                | {"xaxis": f"x{number}", "yaxis": f"y{number}", "legendgroup": name, "showlegend": n == 1}
                | {"customdata": rounded(seconds), "hovertemplate": "%{x} m, %{y} m at %{customdata} s"}
                | _marked(trajectory)
            )
    how = "; ".join(f"{method}: {plotted(run, method)[1]}" for method in run.trajectories)
    return Figure(f"{run.label}: path", traces, layout, f"Aligned: {how}.")


def in_space(run: Run, most: int = MAX_POINTS) -> Figure:
    """To be turned by the reader."""
    traces = []
    for name, colour, trajectory in _placed(run):
        xyz, _ = _few(run, trajectory, most)
        traces.append(line(name, colour, xyz[:, 0], xyz[:, 1]) | {"z": rounded(xyz[:, 2]), "type": "scatter3d"})
    axes = {f"{a}axis": {"title": f"{a} [m]"} for a in "xyz"}
    camera = {"up": {"x": 0, "y": -1, "z": 0}, "eye": {"x": 1.9, "y": -1.9, "z": -2.2}}
    layout = {"scene": {"aspectmode": "data", "camera": camera, **axes}, "height": 560}
    return Figure(f"{run.label}: path in 3-D", traces, layout)


def _placed(run: Run) -> Iterator[tuple[str, str, Trajectory]]:
    """Name, colour and trajectory, the truth first: it lies below."""
    if run.truth is not None:
        last = max((t.times_ns[-1] for t in run.trajectories.values() if len(t)), default=run.truth.times_ns[-1])
        yield "truth", colours.css(colours.TRUTH), run.truth.select(run.truth.times_ns <= last)
    for method in run.trajectories:
        yield method, colour_of(method), plotted(run, method)[0]


def _marked(trajectory: Trajectory) -> dict[str, Any]:
    """Few poses are seen as points too: a line between them was never estimated."""
    return {"mode": "lines+markers", "marker": {"size": 5}} if len(trajectory) <= 60 else {}


def _few(run: Run, trajectory: Trajectory, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns at most `most` positions (N, 3), spread evenly, and their times [s]."""
    keep = np.unique(np.linspace(0, len(trajectory) - 1, min(len(trajectory), most)).astype(int))
    return trajectory.translations[keep], run.seconds(trajectory.times_ns[keep])
