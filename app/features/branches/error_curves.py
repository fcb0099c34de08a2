"""Error curves of every branch that is drawn and of every other program: the aligned ones, whose root mean square is
the ATE, and the live ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.geometry import Array
from ispom.methods import in_order

from ...engine.history.series import Series
from ...presentation import colours
from ...presentation.texts import ALIGNED, length_unit
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.markup import renderer
from ..external_paths.state import ExternalPaths
from .branches import Branch
from .service import BranchService
from .state import Branches

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

MOST_POINTS = 1000
"""Of a curve; of more frames each point is the largest error of several."""
PLAYING_S = 1.0
"""Between two pictures of the curves while frames are computed."""
HEIGHT_PX = 190
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3))
"""Of methods in branches that are not shown, which have the branch's colour."""
GREY = "#8a8a8a"
AXIS: uplot.Axis = {"stroke": GREY, "grid": {"stroke": f"{GREY}40", "width": 1}, "ticks": {"stroke": f"{GREY}40"}}


RunOf = Callable[[int], CurrentRun | None]
"""Gives the run of a branch."""


@dataclass(frozen=True, eq=False)
class Curve:
    label: str
    colour: colours.Rgb
    values: Array
    """(N,) [m] at the frames; NaN where unknown."""
    dash: tuple[int, ...] = ()

    @property
    def drawn(self) -> uplot.Series:
        return {
            "label": self.label,
            "stroke": colours.css(self.colour),
            "width": 1.5,
            "dash": self.dash,
            "spanGaps": True,
        }


@dataclass(frozen=True)
class Kind:
    """One of the two plots."""

    title: str
    note: str
    curves: Callable[[State, RunOf], Iterator[Curve]]


class ErrorCurvesPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._plots = [_Plot(gui, kind) for kind in KINDS]
        self._shown: tuple[object, ...] = ()
        self._due_s = 0.0

    def show(self, state: State) -> None:
        branches = tuple((b.number, b.name, b.hidden, b.measured) for b in state[Branches].all)
        settled = branches, tuple(state[ExternalPaths].errors.items())
        wanted = (state.run, state[Branches].shown, state.computed, settled)
        playing = state.playing and not state.ended and wanted[:2] == self._shown[:2] and self._same_branches(branches)
        if wanted == self._shown or (playing and time.monotonic() < self._due_s):
            return
        self._shown, self._due_s = wanted, time.monotonic() + PLAYING_S
        for plot in self._plots:
            plot.show(state, self._session.service(BranchService).run_of)

    def _same_branches(self, branches: tuple[tuple[object, ...], ...]) -> bool:
        """Whether they are those that are drawn, but for what was measured of them since."""
        before: tuple[tuple[object, ...], ...] = self._shown[3][0]  # type: ignore[index]
        return [b[:3] for b in branches] == [b[:3] for b in before]


class _Plot:
    def __init__(self, gui: viser.GuiApi, kind: Kind) -> None:
        self._gui, self._kind = gui, kind
        self.folder = gui.add_folder(kind.title, visible=False)
        with self.folder:
            gui.add_html(render("note.html", text=kind.note))
        self.plot: viser.GuiUplotHandle | None = None
        self._names: tuple[tuple[str, str], ...] = ()

    def show(self, state: State, run_of: RunOf) -> None:
        curves = list(self._kind.curves(state, run_of))
        self.folder.visible = bool(curves)
        if curves:
            self._draw(curves)

    def _draw(self, curves: list[Curve]) -> None:
        count = max(len(curve.values) for curve in curves)
        largest_m = max(float(np.nanmax(curve.values)) for curve in curves)
        unit = length_unit([largest_m])
        self.folder.label = f"{self._kind.title} [{unit.name}]"
        width = -(-count // MOST_POINTS)
        columns = (np.arange(0, count, width), *(thinned(curve.values, count, width) / unit.size for curve in curves))
        data = tuple(column.astype(np.float64) for column in columns)
        names = tuple((curve.label, colours.css(curve.colour)) for curve in curves)
        scales = _scales(count, largest_m / unit.size)
        if self.plot is not None and names == self._names:
            self.plot.data, self.plot.scales = data, scales
            return
        self._names = names
        if self.plot is not None:
            self.plot.remove()
        with self.folder:
            self.plot = self._gui.add_uplot(
                data,
                ({"label": "exposure"}, *(curve.drawn for curve in curves)),
                scales=scales,
                axes=({**AXIS, "label": "exposure", "labelSize": 18, "size": 28}, {**AXIS, "size": 54}),
                legend={"show": True},
                height=HEIGHT_PX,
            )


def aligned_curves(state: State, run_of: RunOf) -> Iterator[Curve]:
    """Of the trajectories as known now, aligned to the ground truth; the branch that is shown first."""
    for branch, shown in _drawn(state):
        run = run_of(branch.number)
        times_ns = run.playback.sequence.times_ns if run is not None else np.zeros(0, np.int64)
        for i, method in enumerate(in_order(branch.measured.errors)):
            error = branch.measured.errors[method]
            values = _at_exposures(error, times_ns[: branch.computed])
            if np.isfinite(values).any():
                label = f"{colours.label(method)}, {ALIGNED[error.alignment]}"
                name = label if shown else f"{branch.name}: {label}"
                dash = () if shown else DASHES[i % len(DASHES)]
                yield Curve(name, colours.of(method) if shown else branch.colour, values, dash)
    for beside in state[ExternalPaths].all:
        if (error := state[ExternalPaths].errors.get(beside.name)) is not None:
            values = _at_exposures(error, beside.times_ns[: state.computed])
            yield Curve(f"{beside.name}, {ALIGNED[error.alignment]}", beside.colour, values)


def live_curves(state: State, run_of: RunOf) -> Iterator[Curve]:
    """Of the poses as they were given at their frames, without an alignment and without provisional ones."""
    for branch, shown in _drawn(state):
        run = run_of(branch.number)
        for i, (method, values) in enumerate(_live(run.series, branch.computed) if run is not None else ()):
            label = f"{colours.label(method)}, live"
            name = label if shown else f"{branch.name}: {label}"
            dash = () if shown else DASHES[i % len(DASHES)]
            yield Curve(name, colours.of(method) if shown else branch.colour, values, dash)


def _live(series: Series, count: int) -> Iterator[tuple[str, Array]]:
    """(N,) live errors of each method that has any."""
    for method in in_order({q.method for q in series.quantities.values() if q.key == "error_m"}):
        values = series.values(f"{method}.error_m", 0, count)
        if np.isfinite(values).any():
            yield method, values


def _drawn(state: State) -> list[tuple[Branch, bool]]:
    """The branches that are drawn, that which is shown first."""
    branches = state[Branches]
    drawn = [(b, b.number == branches.shown) for b in branches.all if b.number == branches.shown or not b.hidden]
    return sorted(drawn, key=lambda each: not each[1])


def _at_exposures(error: TrajectoryError, times_ns: NDArray[np.int64]) -> Array:
    """(N,) of an error curve at frames; NaN where it has no pose."""
    values = np.full(len(times_ns), np.nan)
    if len(times_ns):
        after = np.searchsorted(times_ns, error.estimate.times_ns).clip(0, len(times_ns) - 1)
        before = (after - 1).clip(0)
        earlier = abs(error.estimate.times_ns - times_ns[before]) < abs(times_ns[after] - error.estimate.times_ns)
        values[np.where(earlier, before, after)] = error.position_errors_m
    return values


KINDS = (
    Kind(
        "Position error",
        "Of the trajectories as known now, aligned to the ground truth as named. The root mean square of a curve is "
        "the ATE in the table above.",
        aligned_curves,
    ),
    Kind(
        "Live error",
        "Of each pose as it was first given, in the gauge of the first stereo pair, without an alignment. Poses before "
        "the first fit of an integration are provisional, and have none.",
        live_curves,
    ),
)


def _scales(count: int, largest: float) -> dict[str, uplot.Scale]:
    """All frames, and from 0 to the largest error. uPlot finds no range itself where a curve begins with what is
    unknown, and keeps that of the first frames where more come."""
    last = float(max(count - 1, 1))
    return {"x": {"time": False, "range": (0.0, last)}, "y": {"range": (0.0, 1.05 * largest or 1.0)}}


def thinned(values: Array, count: int, width: int) -> Array:
    """(ceil(count / width),) the largest of every `width` values, which are filled up to `count` with NaN."""
    filled = np.concatenate([values, np.full(count - len(values), np.nan)])
    return np.fmax.reduceat(filled, np.arange(0, count, width))
