"""The page of an experiment: one HTML file with its figures, beside the folders of the runs that it links to."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from ...presentation.templating import environment
from ...presentation.texts import METRE, Unit, length_unit
from ..report.html import own_text, shown
from .names import is_length, label, styles
from .plan import Plan
from .row import Row
from .statistics import MIN_PAIRS, Outcome, Paired, Spread, value_of

GENERATOR = "ISPOM experiment"


def page(
    plan: Plan,
    rows: Sequence[Row],
    spreads: Sequence[Spread],
    paired: Sequence[Paired],
    outcomes: Sequence[Outcome],
    figures: Mapping[str, bytes],
) -> str:
    """`figures`: SVG by name. Everything of the plan and the runs is escaped."""
    made = environment(__name__.rpartition(".")[0])
    units = {q: _unit(q, rows) for q in plan.quantities}
    made.filters |= {
        "shown": shown,
        "label": lambda quantity: label(quantity, units[quantity]),
        "of": lambda value, quantity: shown(value if value is None else value / units[quantity].size),
    }
    failed = [row for row in rows if row.failure is not None]
    expected = sum(1 for _ in plan.runs())
    return made.get_template("experiment.html").render(
        generator=GENERATOR,
        css=own_text("page.css"),
        plan=plan,
        counts=f"{len(rows)} of {expected} runs, {len(failed)} failed",
        colours={name: style.colour for name, style in styles(plan).items()},
        outcomes=outcomes,
        bounds=_bounds,
        values_of=_values_text,
        medians=_medians(plan, spreads),
        paired=paired,
        min_pairs=MIN_PAIRS,
        figures={name: base64.b64encode(content).decode() for name, content in figures.items()},
        rows=[_cells(plan, row) for row in rows],
        several=len(plan.sources) > 1,
    )


def _unit(quantity: str, rows: Sequence[Row]) -> Unit:
    """In which a column is printed: of lengths, one that suits them all."""
    return length_unit(value_of(row, quantity) for row in rows) if is_length(quantity) else METRE


def _medians(plan: Plan, spreads: Sequence[Spread]) -> list[tuple[str, str, list[Spread]]]:
    """(line, source, its quantities)."""
    return [
        (line.name, source, [s for s in spreads if s.line == line.name and s.source == source])
        for source in plan.sources
        for line in plan.lines
    ]


def _bounds(outcome: Outcome) -> str:
    said = outcome.statement
    what = f"{label(said.quantity)} of {said.line}"
    if said.source is not None:
        what += f" on {said.source}"
    if said.over_line is not None or said.over_source is not None:
        what += f", over that of {said.over_line or said.line}"
        what += f" on {said.over_source}" if said.over_source is not None else ""
    limits = [f"≤ {said.at_most:g}"] if said.at_most is not None else []
    limits += [f"≥ {said.at_least:g}"] if said.at_least is not None else []
    limits += ["or none"] if said.or_fails else []
    return f"{what}: {' '.join(limits)}" + (f" in {100 * said.share:g} % of the runs" if said.share < 1 else "")


def _values_text(outcome: Outcome) -> str:
    """Median, and the extremes of several."""
    values = sorted(outcome.values)
    if not values:
        return "–"
    middle = values[len(values) // 2] if len(values) % 2 else sum(values[len(values) // 2 - 1 :][:2]) / 2
    return shown(middle) + (f" ({shown(values[0])} to {shown(values[-1])})" if len(values) > 1 else "")


def _cells(plan: Plan, row: Row) -> dict[str, Any]:
    return {
        "run": row.run,
        "link": PurePath(row.run.folder).as_posix(),
        "failure": row.failure,
        "values": [(quantity, value_of(row, quantity)) for quantity in plan.quantities],
    }
