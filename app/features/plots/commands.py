"""What is plotted over the frames, and choosing it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ispom.errors import InputError

from ...engine.history.quantities import STEP_QUANTITIES
from ...session.commands import PageCommand
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.state import Event, FeatureChanged, FeatureState, State

ERROR = "error"
"""The position errors after alignment, of all methods."""
DEFAULT_PLOTS = (ERROR, "inliers")
"""What is plotted for every method until a person chooses otherwise."""
MOST_PLOTS = 12
NO_PLOTS = "none"
"""Value in an address for no plots."""


def toggled(plots: tuple[str, ...], run: CurrentRun | None, name: str) -> tuple[str, ...]:
    """The plots after a person chose a quantity: it is added at the end, or removed if it is plotted already.

    `name` is METHOD.KEY, or a KEY of Steps for all methods. Raises InputError for what has no numbers in the run.
    """
    if name in plots:
        return tuple(each for each in plots if each != name)
    if not is_plottable(run, name):
        raise InputError(f"{name[:60]!r} is no quantity of this run: choose a check under Explain, or one of the list")
    return (*plots, name)[-MOST_PLOTS:]


def chosen(run: CurrentRun | None, names: tuple[str, ...] | None) -> tuple[str, ...]:
    """These plots, without names that the run has no numbers of; the usual ones for None."""
    if names is None:
        return DEFAULT_PLOTS
    return tuple(dict.fromkeys(name for name in names if is_plottable(run, name)))[:MOST_PLOTS]


def is_plottable(run: CurrentRun | None, name: str) -> bool:
    """Whether the run has numbers of METHOD.KEY, or any method of it has KEY."""
    if run is None:
        return False
    quantities = run.series.quantities
    shared = name == ERROR or name in {quantity.key for quantity in STEP_QUANTITIES if quantity.kind != "text"}
    found = quantities.get(name)
    return shared or (found is not None and bool(found.method) and found.kind != "text")


@dataclass(frozen=True)
class Plots(FeatureState):
    names: tuple[str, ...] = DEFAULT_PLOTS
    """METHOD.KEY, or KEY for all methods."""

    def reduce(self, event: object) -> Plots:
        return self  # also over another source

    def covered(self) -> Plots:
        return Plots(())

    def address(self) -> dict[str, str]:
        return {"plots": "" if self.names == DEFAULT_PLOTS else ",".join(self.names) or NO_PLOTS}


class PlotCommand(PageCommand, frozen=True):
    only_looks: ClassVar[bool] = True

    def look(self, state: State, run: CurrentRun) -> tuple[Event, ...]:
        if state.covers:
            raise InputError("a question of the lesson is open: plots are there when it is answered")
        return (FeatureChanged(self.after(state, run)),)

    def execute(self, session: Controller) -> None:
        session.store.put(self.after(session.state, session.run))

    def after(self, state: State, run: CurrentRun | None) -> Plots:
        """What is plotted then. InputError if that is not possible."""
        raise NotImplementedError(type(self).__name__)


class Plot(PlotCommand, frozen=True):
    """Plot a quantity over the frames, or stop plotting it."""

    name: str
    """METHOD.KEY, or the KEY of Steps for all methods."""

    def after(self, state: State, run: CurrentRun | None) -> Plots:
        return Plots(toggled(state[Plots].names, run, self.name))


class SetPlots(PlotCommand, frozen=True):
    """Plot just these quantities; None for the usual ones."""

    names: tuple[str, ...] | None

    def after(self, state: State, run: CurrentRun | None) -> Plots:
        return Plots(chosen(run, self.names))
