"""The error of a sweep's runs against the value of its setting."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from viser import uplot

from ispom.geometry import Array

from ...presentation import colours
from ...views.viser.controls import label_of
from .sweep import Sweep
from .values import shown

HEIGHT_PX = 170
QUANTITIES = {"ate_m": "ATE [m]", "located_percent": "frames located [%]"}
"""The first of them that is known is drawn: without truth there are no errors."""
POINTS: Any = {"show": True, "size": 7}
LOG = 3
"""uPlot's logarithmic distribution."""
APART = 5.0
"""Values that differ by more than this factor are drawn on a logarithmic axis."""
GREY = "#8a8a8a"
AXIS: uplot.Axis = {"stroke": GREY, "grid": {"stroke": f"{GREY}40", "width": 1}, "ticks": {"stroke": f"{GREY}40"}}


class SweepPlot:
    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui, self._folder = gui, gui.add_folder("Error against the value", visible=False)
        self._plot: viser.GuiUplotHandle | None = None
        self._shown: tuple[object, ...] = ()

    def show(self, sweep: Sweep | None) -> None:
        """Drawn anew with each run that is over."""
        wanted = () if sweep is None else (sweep.name, len(sweep.outcomes))
        if wanted == self._shown:
            return
        self._shown = wanted
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
        found = points(sweep) if sweep is not None else None
        self._folder.visible = found is not None
        if sweep is None or found is None:
            return
        x, y, quantity = found
        label, colour = label_of(sweep.swept.setting), colours.css(colours.of(sweep.swept.method))
        numbers = _numbers(sweep)
        if not numbers:
            label = ", ".join(f"{place}: {shown(value)}" for place, value in enumerate(sweep.swept.values))
        logarithmic = numbers and x.min() > 0 and x.max() > APART * x.min()
        scale: uplot.Scale = {"time": False, "distr": LOG} if logarithmic else {"time": False}
        with self._folder:
            self._plot = self._gui.add_uplot(
                (x, y),
                ({"label": label}, {"label": QUANTITIES[quantity], "stroke": colour, "width": 1.5, "points": POINTS}),
                scales={"x": scale, "y": {"range": (0.0, 1.1 * float(np.nanmax(y)) or 1.0)}},
                axes=({**AXIS, "label": label, "labelSize": 18, "size": 28}, {**AXIS, "size": 54}),
                legend={"show": True},
                height=HEIGHT_PX,
            )


def points(sweep: Sweep) -> tuple[Array, Array, str] | None:
    """(N,) values in rising order, or the places of words; (N,) what is drawn of them; and its name.

    None with fewer than two.
    """
    for quantity in QUANTITIES:
        found = [
            (float(o.value) if _numbers(sweep) else float(place), y)  # type: ignore[arg-type]
            for place, o in sweep.outcomes.items()
            if (y := (o.values or {}).get(quantity)) is not None
        ]
        if len(found) >= 2:
            x, y = np.array(sorted(found)).T
            return x, y, quantity
    return None


def _numbers(sweep: Sweep) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in sweep.swept.values)
