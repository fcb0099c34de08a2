"""Figures of the trajectories: in three planes, and in space."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ispom.types import Trajectory

from ...presentation import colours
from .analysis import plotted
from .folder import Run
from .traces import MAX_POINTS, Figure, colour_of, line, rounded

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
    """At most so many positions (N, 3) and their times [s]."""
    keep = np.unique(np.linspace(0, len(trajectory) - 1, min(len(trajectory), most)).astype(int))
    return trajectory.translations[keep], run.seconds(trajectory.times_ns[keep])
