"""Error curves: how far every branch that is drawn, and every other program, is from the truth, on one axis."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import viser
from viser import uplot

from ispom.geometry import Array
from ispom.methods import in_order

from .... import colours
from ....run.history.series import Series
from ....session.state import State

if TYPE_CHECKING:
    from ....session.session import Session

MOST_POINTS = 1000
"""Of a curve; of more exposures each point is the largest error of several."""
PLAYING_S = 1.0
"""Between two pictures of the curves while exposures are computed."""
HEIGHT_PX = 190
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3))
"""Of methods in branches that are not shown, which have the branch's colour."""
GREY = "#8a8a8a"
AXIS: uplot.Axis = {"stroke": GREY, "grid": {"stroke": f"{GREY}40", "width": 1}, "ticks": {"stroke": f"{GREY}40"}}


@dataclass(frozen=True, eq=False)
class Curve:
    label: str
    colour: colours.Rgb
    values: Array
    """(N,) [m] at the exposures; NaN where unknown."""
    dash: tuple[int, ...] = ()

    @property
    def drawn(self) -> uplot.Series:
        return {"label": self.label, "stroke": colours.css(self.colour), "width": 1.5, "dash": self.dash}


class ErrorCurvesPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._gui, self._session = gui, session
        self._folder = gui.add_folder("Position error [m]", visible=False)
        self._plot: viser.GuiUplotHandle | None = None
        self._shown: tuple[object, ...] = ()
        self._names: tuple[tuple[str, str], ...] = ()
        self._due_s = 0.0

    def show(self, state: State) -> None:
        wanted = (state.run, state.branch, state.computed, tuple((b.number, b.name, b.hidden) for b in state.branches))
        soon = wanted[:2] == self._shown[:2] and wanted[3:] == self._shown[3:]
        if wanted == self._shown or (soon and not state.ended and time.monotonic() < self._due_s):
            return
        self._shown, self._due_s = wanted, time.monotonic() + PLAYING_S
        curves = list(error_curves(state, self._series))
        count = max((len(curve.values) for curve in curves), default=0)
        self._folder.visible = bool(curves)
        if curves:
            self._draw(curves, count)

    def _series(self, number: int) -> Series | None:
        run = self._session.branch(number)
        return run.series if run is not None else None

    def _draw(self, curves: list[Curve], count: int) -> None:
        width = -(-count // MOST_POINTS)
        columns = (np.arange(0, count, width), *(thinned(curve.values, count, width) for curve in curves))
        data = tuple(column.astype(np.float64) for column in columns)
        names = tuple((curve.label, colours.css(curve.colour)) for curve in curves)
        scales = _scales(curves)
        if self._plot is not None and names == self._names:
            self._plot.data, self._plot.scales = data, scales
            return
        self._names = names
        if self._plot is not None:
            self._plot.remove()
        with self._folder:
            self._plot = self._gui.add_uplot(
                data,
                ({"label": "exposure"}, *(curve.drawn for curve in curves)),
                scales=scales,
                axes=({**AXIS, "label": "exposure", "labelSize": 18, "size": 28}, {**AXIS, "size": 54}),
                legend={"show": True},
                height=HEIGHT_PX,
            )


def error_curves(state: State, series_of: Callable[[int], Series | None]) -> Iterator[Curve]:
    """Of the branches that are drawn, the shown one first, and of other programs; only those with an error."""
    drawn = [b for b in state.branches if b.number == state.branch or not b.hidden]
    for branch in sorted(drawn, key=lambda b: b.number != state.branch):
        series, shown = series_of(branch.number), branch.number == state.branch
        if series is None:
            continue
        methods = {q.method for q in series.quantities.values() if q.key == "error_m"}
        for i, method in enumerate(in_order(methods)):
            values = series.values(f"{method}.error_m", 0, branch.computed)
            label = colours.label(method)
            if np.isfinite(values).any():
                name = label if shown else f"{branch.name}: {label}"
                dash = () if shown else DASHES[i % len(DASHES)]
                yield Curve(name, colours.of(method) if shown else branch.colour, values, dash)
    for beside in state.beside:
        values = beside.errors_m[: state.computed]
        if np.isfinite(values).any():
            yield Curve(beside.name, beside.colour, values)


def _scales(curves: list[Curve]) -> dict[str, uplot.Scale]:
    """From 0 to the largest error: uPlot finds no range itself where a curve begins with what is unknown."""
    largest_m = max(float(np.nanmax(curve.values)) for curve in curves)
    return {"x": {"time": False}, "y": {"range": (0.0, 1.05 * largest_m or 1.0)}}


def thinned(values: Array, count: int, width: int) -> Array:
    """(ceil(count / width),) the largest of every `width` values, which are filled up to `count` with NaN."""
    filled = np.concatenate([values, np.full(count - len(values), np.nan)])
    return np.fmax.reduceat(filled, np.arange(0, count, width))
