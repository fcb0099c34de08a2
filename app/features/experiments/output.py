"""All files of an experiment, from its rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

from ispom.io.whole import write_whole

from .page import page
from .plan import Plan
from .results import write_rows, write_summary
from .row import Row
from .statistics import Outcome, outcomes, paired, spreads

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
