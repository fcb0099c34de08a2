"""Figures over time: errors, scale, tracks and the time that each exposure took."""

from __future__ import annotations

import numpy as np

from ispom.methods import method as registered
from ispom.types import TrackStatus

from ...engine.history.step_quantities.step import DROPPED
from ...presentation import colours
from .analysis import errors, step_scale
from .folder import Run
from .traces import MAX_POINTS, Figure, colour_of, line, over_time, rounded, thinned

BINS = 150
"""Of counted things over time."""
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
    layout = over_time("tracks per exposure") | {"barmode": "relative", "bargap": 0}
    note = f"Above zero: alive and new; below: dropped, by reason. Means of up to {BINS} spans of time."
    return Figure(f"{run.label}: {method} tracks", traces, layout, note)


def timing(run: Run, most: int = MAX_POINTS) -> Figure:
    traces = []
    for method, steps in run.steps.items():
        ms = 1e3 * steps.columns["seconds"]
        known = np.isfinite(ms)
        traces.append(thinned(most, method, colour_of(method), run.seconds(steps.times_ns[known]), ms[known]))
    layout = over_time("wall time per exposure [ms]")
    layout["yaxis"] |= {"type": "log", "dtick": 1, "minor": {"showgrid": True, "dtick": "D1"}}
    return Figure(
        f"{run.label}: wall time", traces, layout, "The integrated method contains the time of the two inside it."
    )


def _binned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(BINS, len(values))
    split = [np.array_split(a, count) for a in (times, values)]
    return tuple(np.array([part.mean() for part in parts]) for parts in split)  # type: ignore[return-value]
