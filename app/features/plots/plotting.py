"""The quantities that are plotted over the frames."""

from __future__ import annotations

from ispom.errors import InputError

from ...engine.history.quantities import STEP_QUANTITIES
from ...session.current_run import CurrentRun

ERROR = "error"
"""The position errors after alignment, of all methods."""
DEFAULT_PLOTS = (ERROR, "inliers")
"""What is plotted for every method until a person chooses otherwise."""
MOST_PLOTS = 12


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
