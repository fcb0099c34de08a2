"""The quantities that the page plots over the frames of a run. Each value is sent to a page once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.methods import in_order

from ...engine import frame_record
from ...engine.error_curve import ErrorCurve
from ...engine.history.quantities import STEP_QUANTITIES
from ...engine.history.quantity import Quantity
from ...engine.history.series import Series
from ...presentation import colours
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.external_paths import ExternalPaths
from ...session.state import State, covered
from ...views.web.news import Look, News
from .commands import ERROR, Plots

SLICE = 4000
"""Most values of one curve in one message."""
DIGITS = 5
"""Significant digits of a value: a plot shows three."""
MOST_POINTS = 600
"""Most points of a curve of errors; with more poses each point is the largest error of several."""
_TITLES = {key: definition.label for key, definition in frame_record.DEFINITIONS.items()}
_STEP_KEYS = {quantity.key for quantity in STEP_QUANTITIES}


@dataclass(frozen=True)
class Curve:
    """One line of a plot."""

    id: str
    """The name of the quantity, METHOD.KEY."""
    label: str
    colour: str
    """As CSS writes it."""
    threshold: bool = False
    """Whether it is the threshold of the plot's check, drawn as a dashed line."""


@dataclass(frozen=True)
class Plot:
    """A row of the time dock: one quantity of one method, or the same key of every method."""

    name: str
    """KEY, or METHOD.KEY."""
    title: str
    help: str
    unit: str
    curves: tuple[Curve, ...]


class PlotNews(News):
    """What one page has of the plots so far."""

    def __init__(self) -> None:
        self._run: CurrentRun | None = None
        self._plots: tuple[Plot, ...] | None = None
        self._sent: dict[str, int] = {}
        """By curve: the number of frames whose values the page has."""
        self._errors: list[tuple[Curve, ErrorCurve]] = []
        """What the curves of errors that the page has are from."""

    def of(self, look: Look) -> dict[str, Any]:
        found = self.since(covered(look.local), look.run)
        return {} if found is None else {"plots": found}

    def since(self, state: State, run: CurrentRun | None) -> dict[str, Any] | None:
        """What is new to the page; None if nothing is.

        `plots` lists the rows whenever they change, `choices` what else can be plotted whenever the run changes.
        `values` holds [curve, frames, values] for each curve that has grown; null stands for a missing value. `errors`
        holds the same for curves of aligned errors, which are replaced as a whole: each alignment changes all of them.
        """
        if run is None:
            return None
        news: dict[str, Any] = {}
        if run is not self._run:
            self._run, self._plots, self._sent, self._errors = run, None, {}, []
            news["choices"] = [[name, title] for name, title in choices(run.series.quantities)]
        errors = list(error_curves(state))
        found = (
            error_plot(errors) if name == ERROR else plot_of(name, run.series.quantities) for name in state[Plots].names
        )
        plots = tuple(plot for plot in found if plot is not None)
        if plots != self._plots:
            self._plots = plots
            news["plots"] = [asdict(plot) for plot in plots]
        if [e for _, e in errors] != [e for _, e in self._errors] or "plots" in news:
            self._errors = errors
            if any(plot.name == ERROR for plot in plots):
                times_ns = run.playback.sequence.times_ns
                news["errors"] = [(curve.id, *_over_frames(error, times_ns)) for curve, error in errors]
        grows = {curve.id for plot in plots if plot.name != ERROR for curve in plot.curves}
        values = list(self._values(run.series, grows))
        return news | ({"values": values} if values else {}) or None

    def _values(self, series: Series, curves: set[str]) -> Iterator[tuple[str, list[int], list[float | None]]]:
        computed = len(series)
        self._sent = {curve: count for curve, count in self._sent.items() if curve in curves}
        for curve in sorted(curves):
            first = self._sent.get(curve, 0)
            last = min(computed, first + SLICE)
            if last == first:
                continue
            self._sent[curve] = last
            frames, values = series.values_of(curve, last, first)
            yield curve, frames.tolist(), [_rounded(value) for value in values.tolist()]


def plot_of(name: str, quantities: Mapping[str, Quantity]) -> Plot | None:
    """The plot of KEY (a curve for each method that has it) or METHOD.KEY; None if the run has no such numbers."""
    quantity = quantities.get(name)
    if quantity is not None and quantity.kind != "text" and quantity.method:
        label, threshold = colours.label(quantity.method), f"{name}.threshold"
        curves = [Curve(name, label, colours.css(colours.of(quantity.method)))]
        if threshold in quantities:
            curves.append(Curve(threshold, "threshold", "", threshold=True))
        return Plot(name, f"{label}: {title(quantity)}", quantity.help, quantity.unit, tuple(curves))
    shared = [found for found in quantities.values() if found.key == name and found.method and found.kind != "text"]
    if name not in _STEP_KEYS or not shared:
        return None
    methods = in_order(found.method for found in shared)
    curves = [Curve(f"{m}.{name}", colours.label(m), colours.css(colours.of(m))) for m in methods]
    return Plot(name, title(shared[0]), shared[0].help, shared[0].unit, tuple(curves))


def error_curves(state: State) -> Iterator[tuple[Curve, ErrorCurve]]:
    """The position errors after alignment: of the branch that is shown, of others that are drawn, and of other
    programs."""
    branches = state[Branches]
    for branch in sorted(branches.all, key=lambda each: each.number != branches.shown):
        is_shown = branch.number == branches.shown
        for method in in_order(branch.measured.curves) if is_shown or not branch.hidden else ():
            error = branch.measured.curves[method]
            label, colour = colours.label(method), colours.of(method)
            if not is_shown:
                label, colour = f"{branch.name}: {label}", branch.colour
            curve = f"{method}.{ERROR}" if is_shown else f"{method}.{ERROR}/{branch.number}"
            yield Curve(curve, f"{label} ({_how(error)})", colours.css(colour)), error
    for external in state[ExternalPaths].all:
        if (known := state[ExternalPaths].errors.get(external.name)) is not None:
            found = _of_external(known)
            label = f"{external.name} ({_how(found)})"
            yield Curve(f"beside.{external.name}.{ERROR}", label, colours.css(external.colour)), found


@lru_cache(maxsize=32)
def _of_external(error: TrajectoryError) -> ErrorCurve:
    """The same object for the same error: a page is sent each once."""
    return ErrorCurve.of(error)


def _how(curve: ErrorCurve) -> str:
    """The alignment, and what a point is where it stands for several poses."""
    width = _width(len(curve.times_ns))
    return curve.aligned if width == 1 else f"{curve.aligned}, largest of {width} poses"


def _width(poses: int) -> int:
    """The number of poses that one point of a curve stands for."""
    return max(-(-poses // MOST_POINTS), 1)


def error_plot(curves: list[tuple[Curve, ErrorCurve]]) -> Plot | None:
    """None without ground truth."""
    if not curves:
        return None
    alignments = dict.fromkeys(error.aligned for _, error in curves)
    alone = all(error.branches == 1 for _, error in curves)
    rms = "its root mean square is the ATE" if alone else "frames that branches share have one error"
    help = f"{frame_record.ERROR.text}, by {' or '.join(alignments)}; {rms}"
    return Plot(ERROR, frame_record.ERROR.label, help, frame_record.ERROR.unit, tuple(curve for curve, _ in curves))


def _over_frames(error: ErrorCurve, times_ns: NDArray[np.int64]) -> tuple[list[int], list[float | None]]:
    """Frames, and the largest error of the poses at each of them."""
    frames = np.searchsorted(times_ns, error.times_ns)
    starts = np.arange(0, len(frames), _width(len(frames)))
    values = np.fmax.reduceat(error.metres, starts)
    return frames[starts].tolist(), [_rounded(value) for value in values.tolist()]


def choices(quantities: Mapping[str, Quantity]) -> Iterator[tuple[str, str]]:
    """Name and title of all that can be plotted: keys that methods share first, then each method's own."""
    numbers = [q for q in quantities.values() if q.method and q.kind != "text"]
    numbers = [q for q in numbers if not q.key.endswith((".threshold", ".passed"))]
    yield ERROR, "Position error, aligned (all methods)"
    yield from _once((q.key, f"{title(q)} (all methods)") for q in numbers if q.key in _STEP_KEYS)
    yield from ((q.name, f"{colours.label(q.method)}: {title(q)}") for q in numbers)


def title(quantity: Quantity) -> str:
    """The key in words: `residual_median_px` is "Residual median"."""
    if quantity.key in _TITLES:
        return _TITLES[quantity.key]
    words = quantity.key.removesuffix("_px").removesuffix("_deg").removesuffix("_m").replace(".", " ")
    words = words.replace("_", " ").replace("-", " ")
    return words[:1].upper() + words[1:]


def _once(pairs: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    yield from dict(pairs).items()


def _rounded(value: float) -> float | None:
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


NEWS = (PlotNews,)
