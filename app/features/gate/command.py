"""The command: runs the plan, compares with the baseline, writes the page, and gives the exit code."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.files import exists, names
from ispom.io.whole import write_whole

from ...engine.outputs import MARKER, claim_folder
from ...engine.playback import Builder
from ..experiments.command import Terminal, completed
from ..experiments.plan import Plan
from ..experiments.plan_file import read_plan
from ..experiments.results import by_plan, read_rows
from ..experiments.row import Row
from .change import FAILED
from .judge import Rules, judged, overall, rules_of, strictest_level
from .options import Gate
from .page import line_text, numbers, page, power_text, worst_text
from .pairs import Pair, paired
from .power import Power, baseline_spread, power_of
from .worst import worst_case

COMMAND, PAGE, NUMBERS = "gate", "gate.html", "gate.json"
AFTER = "after"
"""Folder of the runs with the code as it is now: an experiment, as the baseline is one."""
EXIT_CODES = {"better": 0, "same": 0, "worse": 1, "cannot tell": 3}
"""Exit codes by verdict; 2 is for a mistake of the user."""
FIRST_PAIRS = 5
"""Number of pairs of a line with which its scatter is known roughly, and its power is stated again."""


def gate(options: Gate, builder: Builder = build) -> int:
    """Returns the exit code of the verdict. Raises InputError for what is wrong with the plan or the folders."""
    after = options.candidate.expanduser() if options.candidate is not None else options.out / AFTER
    plan, baseline = read_plan(options), options.baseline.expanduser()
    rules = rules_of(plan, options.quantities, options.effect, options.level, options.located, options.time)
    before = read_rows(baseline, plan, "--baseline")
    claim_folder(options.out, COMMAND)
    power = stated(plan, before, (), rules)
    _print(power_text(each) for each in power)
    if options.candidate is not None:
        rows = read_rows(after, plan, "--candidate")
    else:
        if exists(after) or any(name != MARKER for name in names(options.out)):
            raise InputError(
                f"{options.out} holds an earlier gate, whose runs may be of other code: give a new folder as --out"
            )
        rows = by_plan(plan, completed(replace(options, out=after), plan, builder, FirstPairs(plan, before, rules))[0])
    pairs = paired(before, rows, (baseline, after))
    judgements, after_runs = judged(plan, pairs, rules), stated(plan, before, pairs, rules)
    verdict, worst = overall(judgements), worst_case(pairs, judgements, rules)
    write_whole(options.out / NUMBERS, numbers(verdict, judgements, pairs, worst, rules, (*power, *after_runs)))
    write_whole(options.out / PAGE, page(plan, verdict, judgements, pairs, worst, rules, (*power, *after_runs)))
    lines = [line for judgement in judgements for line in line_text(judgement)]
    if worst is not None:
        lines += [f"worst case: {worst_text(worst, rules)}", *(f"  {line}" for line in worst.text)]
    lines.append(f"{verdict}: {options.out / PAGE}")
    _print(lines)
    return EXIT_CODES[verdict]


def stated(plan: Plan, before: Sequence[Row], pairs: Sequence[Pair], rules: Rules) -> list[Power]:
    """Returns what the plan's runs can find, by the scatter of the pairs, or of the baseline where there are none."""
    found = []
    for line in plan.lines:
        own = [row for row in before if row.run.line.name == line.name]
        for quantity in rules.quantities:
            if pairs:
                logs = [p.score(quantity) for p in pairs if p.run.line.name == line.name]
                known = [log for log in logs if log is not None and abs(log) < FAILED]
                source, spread = "pairs", float(np.std(known, ddof=1)) if len(known) > 1 else None
            else:
                source, spread = "baseline", baseline_spread(own, quantity)
            level = strictest_level(plan, rules)
            found.append(power_of(line.name, quantity, len(own), spread, source, rules.effect, level))
    return found


class FirstPairs(Terminal):
    """States the power of each line again, when its first pairs are known."""

    def __init__(self, plan: Plan, before: Sequence[Row], rules: Rules) -> None:
        self._plan, self._before, self._rules = plan, before, rules

    def rows(self, rows: Iterable[Row], total: int, before: int) -> Iterator[Row]:
        partners, known = {row.run: row for row in self._before}, {line.name: [] for line in self._plan.lines}
        for row in super().rows(rows, total, before):
            pairs = known[row.run.line.name]
            pairs.append(Pair(partners[row.run], row))
            if len(pairs) == FIRST_PAIRS:
                said = stated(self._plan, self._before, pairs, self._rules)
                _print(power_text(each, len(pairs)) for each in said if each.line == row.run.line.name)
            yield row


def _print(lines: Iterable[str]) -> None:
    sys.stdout.write("".join(f"{printable(line)}\n" for line in lines))
    sys.stdout.flush()
