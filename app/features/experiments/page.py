"""The page of an experiment: one HTML file with its figures, next to the folders of the runs that it links to."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path, PurePath
from typing import Any

from ispom.io.whole import write_whole

from ...presentation.templating import environment
from ...presentation.texts import METRE, Unit, length_unit
from ..report.html import PACKAGE as REPORT
from ..report.html import POLICY, own_text, shown
from .plan import Plan, is_length, label, styles
from .results import write_rows, write_summary
from .row import Row
from .statistics import MIN_PAIRS, Outcome, Paired, Spread, outcomes, paired, spreads, value_of

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
    made = environment(__name__.rpartition(".")[0], REPORT)
    units = {q: _unit(q, rows) for q in plan.quantities}
    made.filters |= {
        "shown": shown,
        "label": lambda quantity: label(quantity, units[quantity]),
        "of": lambda value, quantity: shown(value if value is None else value / units[quantity].size),
    }
    failed = [row for row in rows if row.failure is not None]
    expected = sum(1 for _ in plan.runs())
    return made.get_template("experiment.html").render(
        policy=POLICY,
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
        if line.runs_on(source)
    ]


def _bounds(outcome: Outcome) -> str:
    statement = outcome.statement
    what = f"{label(statement.quantity)} of {statement.line}"
    if statement.source is not None:
        what += f" on {statement.source}"
    if statement.over_line is not None or statement.over_source is not None:
        what += f", over that of {statement.over_line or statement.line}"
        what += f" on {statement.over_source}" if statement.over_source is not None else ""
    limits = [f"≤ {statement.at_most:g}"] if statement.at_most is not None else []
    limits += [f"≥ {statement.at_least:g}"] if statement.at_least is not None else []
    limits += [f"or {kind}" for kind in statement.or_fails]
    limits += [f"with ≥ {statement.least_located_percent:g} % located"] if statement.needs_coverage else []
    return f"{what}: {' '.join(limits)}" + (
        f" in {100 * statement.share:g} % of the runs" if statement.share < 1 else ""
    )


def _values_text(outcome: Outcome) -> str:
    """Median, and the extremes of several."""
    values = sorted(outcome.values)
    if not values:
        return "–"
    middle = values[len(values) // 2] if len(values) % 2 else sum(values[len(values) // 2 - 1 :][:2]) / 2
    spread = f" ({shown(values[0])} to {shown(values[-1])})" if len(values) > 1 else ""
    coverage = f", {outcome.coverage}" if outcome.statement.needs_coverage and outcome.coverage else ""
    return f"{shown(middle)}{spread}{coverage}"


def _cells(plan: Plan, row: Row) -> dict[str, Any]:
    return {
        "run": row.run,
        "link": PurePath(row.run.folder).as_posix(),
        "failure": row.failure,
        "values": [(quantity, value_of(row, quantity)) for quantity in plan.quantities],
    }


PAGE = "index.html"


def write_output(out: Path, plan: Plan, rows: Sequence[Row]) -> list[Outcome]:
    """Tables, figures and page, of as many runs as there are; without Matplotlib no figures.

    InputError where the disk does not take them.
    """
    write_rows(out, plan, rows)
    found = spreads(plan, rows), paired(plan, rows), outcomes(plan, rows)
    write_summary(out, plan, *found)
    vectors: dict[str, bytes] = {}
    for name, form, content in _figures(out, plan, rows) if find_spec("matplotlib") is not None else ():
        write_whole(out / f"{name}.{form}", content)
        if form == "svg":
            vectors[name] = content
    write_whole(out / PAGE, page(plan, rows, *found, vectors))
    return found[2]


def _figures(out: Path, plan: Plan, rows: Sequence[Row]) -> Iterator[tuple[str, str, bytes]]:
    """Name, format and content."""
    from .figures import FORMATS, drawn, file_bytes, path_figures, quantity_figure

    for name, figure in [*path_figures(plan, drawn(rows, out)), ("quantities", quantity_figure(plan, rows))]:
        yield from ((name, form, file_bytes(figure, form)) for form in FORMATS)
