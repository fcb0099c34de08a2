"""The figures of an experiment, as PNG and SVG: the paths as in Figs. 8 and 9, and every quantity over the seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from ispom.evaluation.scale import StepScale, step_scale
from ispom.evaluation.trajectory_error import alignment, placed
from ispom.geometry import Array, Similarity
from ispom.methods import method as registered
from ispom.types import Trajectory

from ...presentation.colours import TRUTH, css
from .plan import Plan, Run, Style, label, styles
from .row import Row, compared, paths_of
from .statistics import value_of


@dataclass(frozen=True, eq=False)
class Drawn:
    """One run."""

    run: Run
    truth: Trajectory
    path: Trajectory
    """In the truth's world: from the common first pose on; the unit of one that is not metric is that of the first
    tenth of the path, or of all of a path that is too short for that."""
    scale: StepScale | None
    metric: bool
    """Whether the method's unit is the metre."""


def drawn(rows: Sequence[Row], out: Path) -> list[Drawn]:
    """Those runs that have a truth and a path."""
    every = [_placed(row.run, out / row.run.folder) for row in rows if row.failure is None]
    return [found for found in every if found is not None]


def _placed(run: Run, folder: Path) -> Drawn | None:
    paths, both = paths_of(run, folder), compared(run, folder)
    if paths is None or both is None:
        return None
    (own, truth), (pairs, partners) = paths, both
    scale, unit, metric = step_scale(pairs, partners), 1.0, registered(run.line.method).unit == "metric"
    if not metric:
        unit = 1 / scale.first if scale is not None else alignment(pairs, partners, "sim3").scale
    first = partners.pose(0) @ pairs.pose(0).scaled(unit).inverse()
    last_ns = int(own.times_ns[-1])
    return Drawn(run, truth.select(truth.times_ns <= last_ns), placed(own, Similarity(unit, first)), scale, metric)


def windows_percent(scale: StepScale) -> np.ndarray:
    """The middles of the step scale's windows [% of the path]."""
    count = len(scale.windows)
    return 100 * (np.arange(count) + 0.5) / count


AUTHOR = "ISPOM experiment"
"""Author in the head of a figure, by which our own figures are recognised."""
FORMATS = ("png", "svg")
WIDTH_IN = 9.0
MOST_LINES = 12
"""Most paths in one figure; with more lines only the quantities are drawn."""
LOGARITHMIC_RATIO = 30
"""Values that differ by more than this factor are drawn on a logarithmic axis."""


def path_figures(plan: Plan, runs: Sequence[Drawn]) -> Iterator[tuple[str, Figure]]:
    """By name, one for each source that has paths: those of its first seed from above and from the side, and the step
    scale of all seeds along the path."""
    for number, source in enumerate(plan.sources):
        of_source = [d for d in runs if d.run.source == source]
        if of_source and len(plan.lines) <= MOST_LINES:
            name = "paths" if len(plan.sources) == 1 else f"paths-{number + 1}"
            yield name, _paths(plan, source, of_source)


def quantity_figure(plan: Plan, rows: Sequence[Row]) -> Figure:
    """A panel for each quantity and source: a dot for each seed, a bar at the median."""
    columns = min(3, len(plan.quantities))
    panels = [(source, quantity) for source in plan.sources for quantity in plan.quantities]
    height = -(-len(panels) // columns)
    figure = Figure(figsize=(WIDTH_IN, 0.4 + 2.5 * height), layout="constrained")
    places = figure.subplots(height, columns, squeeze=False).ravel()
    for axes, (source, quantity) in zip(places, panels, strict=False):
        _quantity(axes, plan, [r for r in rows if r.run.source == source], quantity)
        axes.set_title(label(quantity) + (f"\n{source}" if len(plan.sources) > 1 else ""), fontsize=9)
    for axes in places[len(panels) :]:
        axes.set_visible(False)
    return figure


def file_bytes(figure: Figure, form: str) -> bytes:
    """The same bytes for the same figure."""
    content = BytesIO()
    metadata = {"Software": AUTHOR} if form == "png" else {"Creator": AUTHOR, "Date": None}
    with mpl.rc_context({"svg.hashsalt": AUTHOR}):
        figure.savefig(content, format=form, metadata=metadata, dpi=150)
    return content.getvalue()


def _paths(plan: Plan, source: str, runs: Sequence[Drawn]) -> Figure:
    look, seed = styles(plan), runs[0].run.seed
    shown = [d for d in runs if d.run.seed == seed]
    truth = max((d.truth for d in shown), key=len)
    top, side = ([_projected(t, up) for t in (truth, *(d.path for d in shown))] for up in (0, 1))
    heights = [max(1.0, WIDTH_IN * 0.86 * _height(lines)) for lines in (top, side)]
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 3.4), layout="constrained")
    axes = figure.subplots(3, 1, height_ratios=[*heights, 2.2])
    for place, lines, (up, seen) in zip(
        axes, (top, side), (("x [m]", "above"), ("height [m]", "the side")), strict=False
    ):
        place.plot(*lines[0].T, color=css(TRUTH), linewidth=3, label="A: ground truth")
        for item, line in zip(shown, lines[1:], strict=True):
            style = look[item.run.line.name]
            place.plot(*line.T, color=style.colour, linestyle=style.dash, linewidth=1.3, label=_title(item))
            place.plot(*line[-1], "o", color=style.colour, markersize=4)
        place.plot(*lines[0][0], "k.", markersize=7)
        place.set(xlabel="z [m]", ylabel=up, aspect="equal", adjustable="datalim")
        place.set_title(f"{source} seed {seed} from {seen}", fontsize=9)
        place.yaxis.set_major_locator(MaxNLocator(4))
    axes[0].legend(fontsize=8, loc="best")
    _scales(axes[2], runs, seed, look)
    return figure


def _scales(axes: Axes, runs: Sequence[Drawn], seed: int, look: dict[str, Style]) -> None:
    seeds = len({d.run.seed for d in runs})
    for item in runs:
        if item.scale is None:
            continue
        style, drawn = look[item.run.line.name], item.run.seed == seed
        axes.plot(
            windows_percent(item.scale),
            (item.scale.first if item.metric else 1.0) * np.array(item.scale.windows),
            color=style.colour,
            linestyle=style.dash,
            linewidth=1.8 if drawn else 0.8,
            alpha=1.0 if drawn else 0.4,
        )
    axes.axhline(1, color=css(TRUTH), linewidth=2)
    axes.set(xlabel="share of the path [%]", ylabel="step scale", xlim=(0, 100))
    axes.set_ylim(0, max(1.1, axes.get_ylim()[1]))  # 1, the truth, is never on the frame
    axes.set_title(f"estimated over true length of steps{f', {seeds} seeds' if seeds > 1 else ''}", fontsize=9)


def _quantity(axes: Axes, plan: Plan, rows: Sequence[Row], quantity: str) -> None:
    look, values = styles(plan), list[float]()
    for n, line in enumerate(plan.lines):
        own = [v for r in rows if r.run.line.name == line.name and (v := value_of(r, quantity)) is not None]
        values += own
        if own:
            offsets = 0.5 * (np.arange(len(own)) + 0.5) / len(own) - 0.25  # in the order of the seeds
            axes.plot(n + offsets, own, "o", color=look[line.name].colour, markersize=4, alpha=0.75)
            axes.plot([n - 0.35, n + 0.35], [np.median(own)] * 2, color=look[line.name].colour, linewidth=2.2)
    if values and min(values) > 0 and max(values) > LOGARITHMIC_RATIO * min(values):
        axes.set_yscale("log")
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif values:
        axes.set_ylim(bottom=min(0.0, 1.1 * min(values)))
    turned = max(len(line.name) for line in plan.lines) * len(plan.lines) > 24
    axes.set_xticks(
        range(len(plan.lines)), [line.name for line in plan.lines], fontsize=8, rotation=90 if turned else 0
    )
    axes.set_xlim(-0.6, len(plan.lines) - 0.4)


def _title(item: Drawn) -> str:
    line = item.run.line
    return f"{line.name}: {line.note or line.method}"


def _projected(trajectory: Trajectory, up: int) -> Array:
    """(N, 2): z to the right, x or the height upwards."""
    xyz = trajectory.translations
    return np.column_stack([xyz[:, 2], xyz[:, 0] if up == 0 else -xyz[:, 1]])


def _height(lines: Sequence[Array]) -> float:
    """Of a panel that shows all, over its width; within what can be looked at."""
    every = np.concatenate(lines)
    width, height = np.maximum(np.ptp(every, axis=0), 1e-6)
    return float(np.clip(1.25 * height / width, 0.12, 1.0))
