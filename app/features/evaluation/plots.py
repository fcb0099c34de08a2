"""Plots of an evaluation: the trajectories in three planes, errors over time, local scale over time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from ispom.evaluation.comparison import local_scale
from ispom.geometry import Array
from ispom.methods import names

from ...engine.outputs import write_file
from ...presentation.colours import TRUTH, Rgb, css, of
from .coloured import along
from .evaluated import Evaluated

OTHERS: tuple[Rgb, ...] = ((230, 159, 0), (86, 180, 233), (140, 86, 75), (0, 0, 0), (170, 160, 40))
"""Colours of files whose name is no method: orange, sky blue, brown, black, mustard; none is a method's colour."""
DASHES: tuple[Any, ...] = ("solid", "dashed", "dotted", "dashdot")


@dataclass(frozen=True)
class LineStyle:
    colour: str
    """As CSS writes it."""
    dash: Any
    """As Matplotlib takes it."""

    @property
    def keywords(self) -> dict[str, Any]:
        """Of Matplotlib's `plot`."""
        return {"color": self.colour, "linestyle": self.dash}


def line_styles(paths: Sequence[Path]) -> list[LineStyle]:
    """One each, all different: where a colour is taken, the next kind of dashes."""
    used: Counter[Rgb] = Counter()
    found = []
    for path in paths:
        colour = of(path.stem) if path.stem in names() else min(OTHERS, key=lambda other: used[other])
        found.append(LineStyle(css(colour), _dash(used[colour])))
        used[colour] += 1
    return found


def _dash(n: int) -> Any:
    """From the fifth on: a long dash and n dots."""
    return DASHES[n] if n < len(DASHES) else (0, (8, 2, *(1, 2) * n))


AUTHOR = "ISPOM evaluate"
"""Author in the head of a plot, by which our own plots are recognised."""
PLANES = ((0, 1), (0, 2), (1, 2))
Styled = Sequence[tuple[Evaluated, LineStyle]]


@dataclass(frozen=True)
class PlotStyle:
    form: Literal["png", "svg"]
    alignment: str
    """In words."""
    timed: bool
    runs: bool = False
    """Whether the estimates are runs of one method, whose errors are a band."""
    colour_by: str | None = None
    """The quantity of `along` by which another plot colours the paths."""


def write_plots(folder: Path, items: Sequence[Evaluated], style: PlotStyle) -> None:
    """trajectory, errors and scale, and coloured where asked for, as .png or .svg; InputError where the folder cannot
    be written to, or the quantity of the colours is unknown."""
    form, timed = style.form, style.timed
    styled = list(zip(items, line_styles([item.file.path for item in items]), strict=True))
    figures = {} if style.colour_by is None else {"coloured": _coloured(items, style.colour_by)}
    figures |= {
        "trajectory": _trajectory(styled),
        "errors": _band(items, timed) if style.runs else _errors(styled, timed),
        "scale": _scale(styled, timed),
    }
    for name, figure in figures.items():
        figure.suptitle(style.alignment if name != "scale" else "local scale, before alignment")
        content = BytesIO()
        metadata = {"Software": AUTHOR} if form == "png" else {"Creator": AUTHOR, "Date": None}
        figure.savefig(content, format=form, metadata=metadata)
        write_file(folder / f"{name}.{form}", content.getvalue(), AUTHOR)


def _trajectory(items: Styled) -> Figure:
    figure = Figure(figsize=(15, 5), layout="constrained")
    for axes, (i, j) in zip(figure.subplots(1, 3), PLANES, strict=True):
        for k, (item, style) in enumerate(items):
            true, own = item.found.reference.translations, item.found.estimate.translations
            axes.plot(true[:, i], true[:, j], color=css(TRUTH), label="reference" if k == 0 else None)
            axes.plot(own[:, i], own[:, j], **style.keywords, linewidth=1, label=item.name)
        axes.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", aspect="equal", adjustable="datalim")
    figure.axes[0].legend()
    return figure


def _coloured(items: Sequence[Evaluated], name: str) -> Figure:
    """A plot for each estimate, in the two axes along which the reference moves most; all have one scale of colours."""
    found = [along(item, name) for item in items]
    spread = np.max([np.ptp(item.found.reference.translations, axis=0) for item in items], axis=0)
    i, j = sorted(np.argsort(spread)[1:])
    known = np.concatenate([values[np.isfinite(values)] for _, values in found])
    ends = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    figure = Figure(figsize=(6 * len(items), 5), layout="constrained")
    plots = figure.subplots(1, len(items), squeeze=False)[0]
    for axes, item, (_, values) in zip(plots, items, found, strict=True):
        true, own = item.found.reference.translations, item.found.estimate.translations
        axes.plot(true[:, i], true[:, j], color=css(TRUTH), linewidth=0.8, label="reference")
        unknown = ~np.isfinite(values)
        axes.scatter(own[unknown, i], own[unknown, j], s=6, color="lightgrey")
        shown = axes.scatter(
            own[~unknown, i], own[~unknown, j], s=9, c=values[~unknown], vmin=ends[0], vmax=ends[1], cmap="viridis"
        )
        axes.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", title=item.name)
        axes.set(aspect="equal", adjustable="datalim")
    figure.colorbar(shown, ax=list(plots), label=found[0][0])
    return figure


def _errors(items: Styled, timed: bool) -> Figure:
    figure = Figure(figsize=(10, 6), layout="constrained")
    position, rotation = figure.subplots(2, 1, sharex=True)
    for item, style in items:
        times = _since(item, item.found.reference.times_ns)
        position.plot(times, item.found.position_errors, **style.keywords, linewidth=1, label=item.name)
        rotation.plot(times, item.found.rotation_errors_deg, **style.keywords, linewidth=1)
    position.set(ylabel="position error [m]")
    rotation.set(ylabel="rotation error [deg]", xlabel=_abscissa(timed))
    position.legend()
    return figure


BAND_POINTS = 500
"""Number of times at which the errors of several runs are compared."""


def _band(items: Sequence[Evaluated], timed: bool) -> Figure:
    """Median of the errors of all runs over time, and the band from the least to the largest, where all have poses."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    position, rotation = figure.subplots(2, 1, sharex=True)
    clocks = [item.found.reference.times_ns for item in items]
    first, last = max(int(c[0]) for c in clocks), min(int(c[-1]) for c in clocks)
    times = np.linspace(0, max(last - first, 0) * 1e-9, BAND_POINTS)
    for axes, errors in (
        (position, [item.found.position_errors for item in items]),
        (rotation, [item.found.rotation_errors_deg for item in items]),
    ):
        at = [np.interp(times, (c - first) * 1e-9, e) for c, e in zip(clocks, errors, strict=True)]
        colour = css(OTHERS[1])
        axes.fill_between(times, np.min(at, axis=0), np.max(at, axis=0), color=colour, alpha=0.3, linewidth=0)
        axes.plot(times, np.median(at, axis=0), color=colour, label=f"median and range of {len(items)} runs")
    position.set(ylabel="position error [m]")
    rotation.set(ylabel="rotation error [deg]", xlabel=_abscissa(timed))
    position.legend()
    return figure


def _scale(items: Styled, timed: bool) -> Figure:
    figure = Figure(figsize=(10, 4), layout="constrained")
    axes = figure.subplots()
    for item, style in items:
        local = local_scale(item.found)
        times = _since(item, np.array(local["times_ns"], np.int64))
        axes.plot(times, local["scale"], **style.keywords, marker="o", label=item.name)
    axes.set(ylabel="estimate / reference", xlabel=_abscissa(timed))
    axes.legend()
    return figure


def _since(item: Evaluated, times_ns: np.ndarray) -> Array:
    """Seconds (or rows) since the estimate's first compared pose."""
    return (times_ns - item.found.reference.times_ns[0]) * 1e-9


def _abscissa(timed: bool) -> str:
    return "time since the first compared pose [s]" if timed else "row"
