"""The command: runs the plan, compares with the baseline, writes the page, and gives the exit code."""

from __future__ import annotations

import sys

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.files import exists, names
from ispom.io.whole import write_whole

from ...engine.outputs import MARKER, claim_folder
from ...engine.playback import Builder
from ..experiments.command import Terminal, completed
from ..experiments.options import Experiment
from ..experiments.plan_file import read_plan
from ..experiments.results import by_plan
from .judge import judged, overall, rules_of
from .options import Gate
from .page import line_text, numbers, page, worst_text
from .pairs import finished, paired
from .worst import worst_case

COMMAND, PAGE, NUMBERS = "gate", "gate.html", "gate.json"
AFTER = "after"
"""Folder of the runs with the code as it is now: an experiment, as the baseline is one."""
EXIT_WORSE = 1


def gate(options: Gate, builder: Builder = build) -> int:
    """Returns 0 where nothing got worse, else 1. Raises InputError for what is wrong with the plan or the folders."""
    after = options.candidate.expanduser() if options.candidate is not None else options.out / AFTER
    experiment = Experiment(
        plan=options.plan,
        out=after,
        sources=options.sources,
        seeds=options.seeds,
        max_exposures=options.max_exposures,
        workers=options.workers,
        memory_gb=options.memory_gb,
    )
    plan, baseline = read_plan(experiment), options.baseline.expanduser()
    rules = rules_of(plan, options.quantities, options.effect, options.level, options.located, options.time)
    before = finished(baseline, plan, "--baseline")
    claim_folder(options.out, COMMAND)
    if options.candidate is not None:
        rows = finished(after, plan, "--candidate")
    else:
        if exists(after) or any(name != MARKER for name in names(options.out)):
            raise InputError(
                f"{options.out} holds an earlier gate, whose runs may be of other code: give a new folder as --out"
            )
        rows = by_plan(plan, completed(experiment, plan, builder, Terminal())[0])
    pairs = paired(before, rows, (baseline, after))
    judgements = judged(plan, pairs, rules)
    verdict, worst = overall(judgements), worst_case(pairs, judgements, rules)
    write_whole(options.out / NUMBERS, numbers(verdict, judgements, pairs, worst, rules))
    write_whole(options.out / PAGE, page(plan, verdict, judgements, pairs, worst, rules))
    lines = [line for judgement in judgements for line in line_text(judgement)]
    if worst is not None:
        lines += [f"worst case: {worst_text(worst, rules)}", *(f"  {line}" for line in worst.text)]
    lines.append(f"{verdict}: {options.out / PAGE}")
    sys.stdout.write("\n".join(map(printable, lines)) + "\n")
    return EXIT_WORSE if verdict == "worse" else 0
