"""Sweep: one setting of a method with a few values, run in parallel, and how they compare."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from viser import uplot

from ispom.geometry import Array
from ispom.methods import possible_methods

from ...presentation import colours
from ...presentation.texts import Unit, digits, duration, length, length_unit
from ...session.state import State
from ...views.viser.controls import hint_of, label_of
from ...views.viser.panels import Panel, renderer
from .commands import CancelSweep, RunSweep, ShowSwept
from .sweep import Outcome, Sweep, SweepState
from .values import FEWEST, MOST, offered, proposed, shown

if TYPE_CHECKING:
    from ...session.session import Session


HEIGHT_PX = 170
QUANTITIES = {"ate_m": "ATE [m]", "located_percent": "frames localised [%]"}
"""The first of them that is known is drawn: without truth there are no errors."""
POINTS: Any = {"show": True, "size": 7}
LOG = 3
"""uPlot's logarithmic distribution."""
LOGARITHMIC_RATIO = 5.0
"""Values that differ by more than this factor are drawn on a logarithmic axis."""
GREY = "#8a8a8a"
AXIS: uplot.Axis = {"stroke": GREY, "grid": {"stroke": f"{GREY}40", "width": 1}, "ticks": {"stroke": f"{GREY}40"}}


class SweepPlot:
    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui, self._folder = gui, gui.add_folder("Error against the value", visible=False)
        self._plot: viser.GuiUplotHandle | None = None
        self._shown: tuple[object, ...] = ()

    def show(self, sweep: Sweep | None) -> None:
        """Drawn again with each run that is over."""
        version = () if sweep is None else (sweep.name, len(sweep.outcomes))
        if version == self._shown:
            return
        self._shown = version
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
        logarithmic = numbers and x.min() > 0 and x.max() > LOGARITHMIC_RATIO * x.min()
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


render = renderer(__package__)

TITLE, RUN, CANCEL, SHOW = "Sweep", "Run the values", "Cancel", "Show as a branch"
NONE: tuple[str, ...] = ("-",)
RUN_HINT = (
    "Runs the source once with each value, in processes of their own; all other settings are those of the run shown. "
    "The page goes on meanwhile."
)
VALUES_HINT = f"{FEWEST} to {MOST} of them, with commas between; proposed from the range of the setting."
SHOW_HINT = "The run of the value above as a branch: in the views, the error curves and the mode Compare."


class SweepPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._run, self._sweep = session, -1, session.state[SweepState].sweep
        with gui.add_folder(TITLE, expand_by_default=False):
            self._method = gui.add_dropdown(
                "method", NONE, hint="The method whose setting is varied; others that it depends on run as well."
            )
            self._method.on_update(lambda _: self._offer_settings())
            self._setting = gui.add_dropdown(
                "setting", NONE, hint="The setting that takes the values; all others keep theirs."
            )
            self._setting.on_update(lambda _: self._propose())
            self._about = gui.add_html("")
            self._values = gui.add_text("values", "", hint=VALUES_HINT)
            self._start = gui.add_button(RUN, icon=viser.Icon.PLAYER_PLAY, hint=RUN_HINT, disabled=True)
            self._start.on_click(lambda _: self._begin())
            hint = "Ends it; what was computed by then stays."
            self._cancel = gui.add_button(CANCEL, icon=viser.Icon.X, color="gray", hint=hint, visible=False)
            self._cancel.on_click(lambda _: session.post(CancelSweep()))
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._text = gui.add_html(_text(None))
            self._plot = SweepPlot(gui)
            self._choice = gui.add_dropdown("value", NONE, hint="One of the values that were run.", visible=False)
            self._show = gui.add_button(SHOW, icon=viser.Icon.GIT_BRANCH, hint=SHOW_HINT, visible=False)
            self._show.on_click(lambda _: self._show_chosen())

    @property
    def _named(self) -> tuple[str, str]:
        """The method, and the setting as a field of its config."""
        labels = {colours.label(name): name for name in self._possible}
        method = labels.get(self._method.value, "")
        found = {label_of(s.name): s.name for s in offered(method)} if method else {}
        return method, found.get(self._setting.value, "")

    @property
    def _possible(self) -> tuple[str, ...]:
        opened = self._session.opened
        return tuple(name for name in possible_methods(opened.sequence.rig) if offered(name)) if opened else ()

    def _begin(self) -> None:
        method, setting = self._named
        if setting:
            self._session.post(RunSweep(method, setting, self._values.value))

    def _show_chosen(self) -> None:
        if self._sweep is not None:
            ended = _ended(self._sweep)
            if self._choice.value in ended:
                self._session.post(ShowSwept(ended[self._choice.value]))

    def _offer_methods(self, state: State) -> None:
        labels = tuple(colours.label(name) for name in self._possible) or NONE
        if labels != tuple(self._method.options):
            first = next((colours.label(name) for name in state.methods if colours.label(name) in labels), labels[0])
            selected = self._method.value if self._method.value in labels else first
            self._method.options = labels
            self._method.value = selected
        self._start.disabled = labels == NONE
        self._offer_settings()

    def _offer_settings(self) -> None:
        method, _ = self._named
        labels = tuple(label_of(s.name) for s in offered(method)) if method else NONE
        if labels != tuple(self._setting.options):
            self._setting.options = labels
            self._setting.value = labels[0]
        self._propose()

    def _propose(self) -> None:
        method, setting = self._named
        found = next((s for s in offered(method) if s.name == setting), None) if method else None
        if found is not None:
            values = proposed(method, setting, self._session.state.config)
            self._values.value = ", ".join(map(shown, values))
            self._about.content = render("note.html", text=hint_of(found))

    def show(self, state: State) -> None:
        if state.run != self._run:
            self._run = state.run
            self._offer_methods(state)
        sweep = state[SweepState].sweep
        if sweep is self._sweep:
            return
        self._sweep = sweep
        self._text.content = _text(sweep)
        self._plot.show(sweep)
        under_way = sweep is not None and not sweep.ended
        self._start.visible, self._cancel.visible, self._bar.visible = not under_way, under_way, under_way
        self._bar.value = 100 * sweep.share if sweep is not None else 0.0
        values = tuple(_ended(sweep)) if sweep is not None else ()
        self._choice.visible = self._show.visible = bool(values)
        if values and values != tuple(self._choice.options):
            selected = self._choice.value
            self._choice.options = values
            self._choice.value = selected if selected in values else values[0]


def _ended(sweep: Sweep) -> dict[str, int]:
    """Values whose runs came to their end, with their places."""
    return {shown(o.value): place for place, o in sorted(sweep.outcomes.items()) if o.failure is None}


def _text(sweep: Sweep | None) -> str:
    """How far it is, and what came of each value, as HTML."""
    if sweep is None:
        return render("sweep.html", sweep=None)
    places = range(len(sweep.swept.values))
    unit = length_unit((outcome.values or {}).get("ate_m") for outcome in sweep.outcomes.values())
    known = [_row(sweep.swept.values[p], sweep.outcomes.get(p), sweep.under_way.get(p), unit) for p in places]
    progress = f"{len(sweep.outcomes)} of {len(places)} runs"
    if not sweep.ended:
        progress += f", {duration(sweep.left_s)} left" if sweep.left_s is not None else ""
    elif sweep.problem:
        progress += f": {sweep.problem}"
    return render("sweep.html", sweep=sweep, label=colours.label(sweep.swept.method), progress=progress, rows=known)


def _row(value: Any, outcome: Outcome | None, under_way: float | None, unit: Unit) -> dict[str, str]:
    row = {"value": shown(value), "ate": "", "relative": "", "located": "", "ms": "", "said": ""}
    if outcome is None:
        return row | {"said": "waits" if under_way is None else f"{100 * under_way:.0f} % of the frames"}
    if outcome.failure is not None:
        return row | {"said": f"failed: {outcome.failure}"}
    found = outcome.values or {}
    ate, relative, located = (found.get(name) for name in ("ate_m", "t_err_percent", "located_percent"))
    return row | {
        "ate": "n/a" if ate is None else length(ate, unit),
        "relative": "n/a" if relative is None else f"{relative:.2f} %",
        "located": "n/a" if located is None else f"{located:.0f} %",
        "ms": "" if outcome.ms is None else digits(outcome.ms),
    }


PANELS = (Panel("Branches", 440, SweepPanel),)
