"""The quantity that is drawn over time."""

from __future__ import annotations

from ispom.errors import InputError

from .current_run import CurrentRun
from .state import State


def plotted(state: State, run: CurrentRun | None, name: str) -> str:
    """What is drawn after it was asked for: this quantity, or nothing where it is drawn already or has no name.

    InputError for a name that the run on the screen has no numbers of.
    """
    if name in ("", state.plotted):
        return ""
    quantity = run.series.quantities.get(name) if run is not None else None
    if quantity is None or quantity.kind == "text":
        raise InputError(f"{name[:60]!r} is nothing that this run could plot: choose a check under Explain")
    return name
