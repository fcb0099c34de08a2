"""The quantity that was clicked, over time, with its threshold: what the page draws below its time axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from .. import colours
from ..decisions import number
from ..run.history.series import Series
from ..session.current_run import CurrentRun
from ..session.state import State

WIDTH, HEIGHT, PAD = 1000.0, 100.0, 6.0
"""Of the drawing, which is stretched to its place; and what stays free above and below the curves."""
COLUMNS = 600
"""With more steps than this, some go together, and their least and largest values are drawn."""
FAR = 8.0
"""A threshold that would make the plot higher than so many times the largest value is named, not drawn."""


@dataclass(frozen=True)
class CheckPlot:
    name: str
    help: str
    """What it is, with its unit."""
    colour: str
    now: str
    """What was said at the exposure shown."""
    values: str = ""
    """Paths of SVG: the values, and the thresholds; empty where there is nothing to draw."""
    thresholds: str = ""
    low: str = ""
    high: str = ""
    """What the lower and the upper edge stand for."""
    beyond: str = ""
    """A threshold that is too far to be drawn."""


def plot_of(state: State, run: CurrentRun | None) -> CheckPlot | None:
    """As far as the run on the screen is computed; None where nothing was asked for."""
    if not state.plotted or run is None:
        return None
    return check_plot(state.plotted, run.series, run.playback.sequence.times_ns, state.index)


def check_plot(name: str, series: Series, times_ns: NDArray[np.int64], index: int) -> CheckPlot:
    """Of a quantity METHOD.KEY, with the values at exposure `index`; `times_ns` (N,) of all exposures there are."""
    quantity = series.quantities.get(name)
    if quantity is None:
        return CheckPlot(name, "", "currentColor", "No method of this branch gives it.")
    computed = min(len(series), len(times_ns))
    at, values = series.said(name, computed)
    has_threshold = f"{name}.threshold" in series.quantities
    thresholds = series.said(f"{name}.threshold", computed)[1] if has_threshold else np.full(len(at), np.nan)
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    colour = colours.css(colours.of(quantity.method)) if quantity.method else "currentColor"
    found = CheckPlot(name, f"{quantity.help}{unit}", colour, _now(at, values, thresholds, index, quantity.unit))
    if not np.isfinite(values).any():
        return found
    low, high, drawn = _range(values, thresholds)
    x = WIDTH * (times_ns[at] - times_ns[0]) / max(int(times_ns[-1] - times_ns[0]), 1)
    said = np.isfinite(thresholds)
    return replace(
        found,
        values=_path(*_thinned(x, values), low, high),
        thresholds=_path(*_thinned(x[said], thresholds[said]), low, high) if drawn else "",
        low=number(low),
        high=number(high),
        beyond=f"threshold {number(float(thresholds[said][-1]))}, beyond the plot" if said.any() and not drawn else "",
    )


def _now(at: NDArray[np.int64], values: Array, thresholds: Array, index: int, unit: str) -> str:
    """In words, of the exposure shown, or of the latest before it at which something was said."""
    said = np.flatnonzero((at <= index) & np.isfinite(values))
    if not len(said):
        return "nothing said so far"
    i, unit = int(said[-1]), f" {unit}" if unit else ""
    threshold = f", threshold {number(thresholds[i])}{unit}" if np.isfinite(thresholds[i]) else ""
    where = f"exposure {index}" if at[i] == index else f"nothing said at exposure {index}; at {at[i]}"
    return f"{where}: {number(values[i])}{unit}{threshold}"


def _range(values: Array, thresholds: Array) -> tuple[float, float, bool]:
    """Lower and upper edge, and whether the thresholds are between them."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not np.isfinite(thresholds).any():
        return low, high, False
    lower, upper = min(low, float(np.nanmin(thresholds))), max(high, float(np.nanmax(thresholds)))
    drawn = upper == lower or upper - lower <= FAR * max(abs(low), abs(high))
    return (lower, upper, True) if drawn else (low, high, False)


def _thinned(x: Array, values: Array) -> tuple[Array, Array]:
    """At most two of each column, the least and the largest, in order; columns without any are NaN."""
    each = -(-len(values) // COLUMNS)
    if each <= 1:
        return x, values
    padded = np.full(-(-len(values) // each) * each, np.nan)
    padded[: len(values)] = values
    columns = padded.reshape(-1, each)
    least = np.where(np.isnan(columns), np.inf, columns).argmin(axis=1)
    most = np.where(np.isnan(columns), -np.inf, columns).argmax(axis=1)
    first = np.arange(len(columns)) * each
    chosen = np.unique(np.concatenate([first + least, first + most]))
    return x[chosen], values[chosen]


def _path(x: Array, values: Array, low: float, high: float) -> str:
    """A line through what was said at successive steps; what stands alone is a dot."""
    scale = (HEIGHT - 2 * PAD) / (high - low) if high > low else 0.0
    bottom = HEIGHT - PAD if high > low else HEIGHT / 2
    parts, drawing = [], False
    for across, value in zip(x.tolist(), values.tolist(), strict=True):
        known = math.isfinite(value)
        if known:
            place = f"{across:.1f} {bottom - scale * (value - low):.1f}"
            parts.append(f"L{place}" if drawing else f"M{place}h0")
        drawing = known
    return "".join(parts)
