"""`ispom budget`: opens a run, runs it again without one cause after another, and prints the shares."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.evaluation.budget.budget import Budget as Found
from ispom.io.whole import write_whole
from ispom.methods import with_dependencies
from ispom.types import Sequence

from ...engine.outputs import claim_folder, json_of
from ...engine.playback import Builder
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.signals import terminable
from ...session.review.stored import stored_source
from ..headless.console import compile_first, progress
from .bench import Bench
from .options import Budget
from .split import budgets, frames_of
from .text import rows, title
from .written import written

WIDTH = 88


def budget(options: Budget, builder: Builder = build) -> int:
    """Prints the budget of each method. Raises InputError where the run has no ground truth, or cannot be rerun."""
    folder = options.run.expanduser()
    run = read_run_file(folder)
    chosen = _chosen(run, options.methods)
    sequence = stored_source(folder, run, options.source).open()
    if run.stopped is not None:
        sequence = sequence.truncated(int(run.stopped["exposure"]) + 1)
    require_budget(sequence, bool(run.earlier))
    compile_first(run.methods, run.configs())
    with terminable(), progress(frames_of(sequence, options.repeats)) as advance:
        bench = Bench(sequence, with_dependencies(run.methods), run.configs(), builder, advance)
        found = budgets(bench, options.repeats, chosen)
    if options.out is not None:
        claim_folder(options.out, "budget")
        write_whole(options.out / "budget.json", json_of(written(found)))
    if options.json:
        sys.stdout.write(json_of(written(found)))
    else:
        _print(found)
    return 0


def require_budget(sequence: Sequence, forked: bool) -> None:
    """Raises InputError where there is no truth, or no run from the first frame on that could be repeated."""
    if sequence.truth is None or not len(sequence.truth):
        raise InputError(
            "the source has no ground truth, and without it there is no error to split: `ispom doctor` needs none"
        )
    if forked:
        raise InputError(
            "the run was forked, so its settings changed on the way: give a run with the same ones throughout"
        )


def _chosen(run: RunFile, methods: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in methods if name not in run.methods]
    if unknown:
        raise InputError(f"the run has no method {unknown[0]!r}: choose from {', '.join(run.methods)}")
    return methods or tuple(run.methods)


def _print(found: tuple[Found, ...]) -> None:
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH, highlight=False)
    for each in found:
        table = Table(title=title(each), title_justify="left", box=None)
        for name in ("cause", "share", "90 % interval", "how it was removed"):
            table.add_column(name, justify="right" if name in ("share", "90 % interval") else "left")
        for row in rows(each):
            table.add_row(*row)
        console.print(table)
