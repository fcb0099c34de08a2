"""The page of a gate: one HTML file; and the same in words and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ...engine.outputs import json_text
from ...presentation.templating import environment
from ..experiments.plan import Plan, label
from ..experiments.statistics import value_of
from ..report.html import PACKAGE as REPORT
from ..report.html import POLICY, own_text, shown
from .change import FAILED, Change
from .judge import LOCATED, SEGMENTS, Judgement, Rules, Tested, Verdict, percent
from .pairs import Pair
from .power import MOST_PAIRS, POWER, Power
from .worst import Worst, worst_first

GENERATOR = "ISPOM gate"
MOST_ROWS = 200
"""Pairs in the table of the page, the worst first; gate.json has all of them."""
PLOT_WIDTH, PLOT_HEIGHT = 640, 44
"""Size of the drawing of a quantity's pairs [px]."""


def signed_percent(log_ratio: float | None) -> str:
    """As a change in per cent: +3.1 %, and ±0 % where nothing changed."""
    if log_ratio is None:
        return "–"
    if abs(log_ratio) > FAILED / 4:
        return "without limit (failed runs)"
    value = percent(log_ratio)
    return "±0 %" if value == 0 else f"{value:+.3g} %".replace("-", "−")


def interval(change: Change) -> str:
    if change.low is None or change.high is None:
        return f"{change.pairs} pairs are too few for bounds"
    return f"between {signed_percent(change.low)} and {signed_percent(change.high)}"


def line_text(judgement: Judgement) -> list[str]:
    """What the command prints of a line of the plan."""
    found = [f"{judgement.verdict}: {judgement.line}: {', '.join(map(_tested_text, judgement.tested))}"]
    found += [f"  {reason}" for reason in judgement.reasons]
    return found + ([f"  {decides_text(judgement)}"] if judgement.verdict == "cannot tell" else [])


def decides_text(judgement: Judgement) -> str:
    """How many runs would decide where these cannot tell."""
    pairs, seeds = judgement.pairs_that_decide, judgement.seeds_that_decide
    if pairs is None:
        return (
            f"fewer than {MOST_PAIRS} runs like these would not decide: the change is too near to the margin, "
            "so give another --effect"
        )
    of_seeds = "" if seeds is None else f", that is {seeds} seeds of each simulation"
    return f"about {pairs} runs like these would decide{of_seeds}; there are {judgement.runs}"


def power_text(power: Power, known: int | None = None) -> str:
    """What the gate can find, before its runs, or after the first `known` ones."""
    found = "no change" if power.smallest is None else f"a change of {signed_percent(power.smallest)} and more"
    scatter = f"a factor of {math.exp(power.spread):.3g}"
    because = {
        "baseline": f"if before and after scatter as seeds of the baseline do, by {scatter}",
        "assumed": f"if pairs scatter by {scatter}, which is assumed",
        "pairs": f"as the {'pairs' if known is None else f'first {known} pairs'} scatter by {scatter}",
    }[power.source]
    return (
        f"{power.line}: {power.pairs} runs find {found} of {power.quantity} with a probability of {100 * POWER:g} %, "
        f"{because}"
    )


def _tested_text(tested: Tested) -> str:
    if tested.change is None:
        return f"{tested.quantity}: no pair has it"
    c = tested.change
    if c.same == c.pairs:
        return f"{tested.quantity} is the same in all {c.pairs} pairs"
    return f"{tested.quantity} {signed_percent(c.estimate)} ({interval(c)}), {c.pairs} pairs"


def worst_text(worst: Worst, rules: Rules) -> str:
    """Which run got worse most, and by what."""
    values = [
        f"{q} {shown(value_of(worst.pair.before, q))} → {shown(value_of(worst.pair.after, q))}"
        for q in rules.quantities
    ]
    return f"{worst.pair.run}: {', '.join(values)}"


def page(
    plan: Plan,
    verdict: Verdict,
    judgements: Sequence[Judgement],
    pairs: Sequence[Pair],
    worst: Worst | None,
    rules: Rules,
    power: Sequence[Power],
) -> str:
    """Everything of the plan and the runs is escaped."""
    made = environment(__name__.rpartition(".")[0], REPORT)
    made.filters |= {
        "shown": shown,
        "label": label,
        "change": signed_percent,
        "interval": interval,
        "power": power_text,
    }
    made.filters["decides"] = decides_text
    rows = [_cells(pair, rules) for pair in worst_first(pairs, rules)]
    return made.get_template("gate.html").render(
        policy=POLICY,
        generator=GENERATOR,
        css=own_text("page.css"),
        plan=plan,
        verdict=verdict,
        judgements=judgements,
        rules=rules,
        effect=percent(rules.effect),
        level=100 * rules.level,
        rows=rows[:MOST_ROWS],
        left=max(0, len(rows) - MOST_ROWS),
        pairs=len(pairs),
        power=power,
        worst=worst,
        worst_text=None if worst is None else worst_text(worst, rules),
        plots=[_plot(item, pairs, rules) for j in judgements for item in j.tested if item.change is not None],
    )


def numbers(
    verdict: Verdict,
    judgements: Sequence[Judgement],
    pairs: Sequence[Pair],
    worst: Worst | None,
    rules: Rules,
    power: Sequence[Power],
) -> str:
    """gate.json: verdicts, tests, power, pairs and the first divergence."""
    found: dict[str, Any] = {"verdict": verdict, "rules": asdict(rules), "lines": [asdict(j) for j in judgements]}
    found["power"] = [asdict(each) for each in power]
    found["pairs"] = [_cells(pair, rules) for pair in pairs]
    found["worst"] = None
    if worst is not None:
        comparison = worst.comparison
        found["worst"] = {
            "run": worst.pair.run.folder.as_posix(),
            "settings": [asdict(s) for s in comparison.settings] if comparison else [],
            "frames": comparison.differing_frames if comparison else None,
            "first": [asdict(d) for d in comparison.first] if comparison else [],
        }
    return json_text(found, 1)


def _cells(pair: Pair, rules: Rules) -> dict[str, Any]:
    run = pair.run
    return {
        "line": run.line.name,
        "source": run.source,
        "seed": run.seed,
        "errors": [[q, value_of(pair.before, q), value_of(pair.after, q), pair.log_ratio(q)] for q in rules.quantities],
        "located": [value_of(pair.before, LOCATED), value_of(pair.after, LOCATED)],
        "segments": [value_of(pair.before, SEGMENTS), value_of(pair.after, SEGMENTS)],
        "log_time_ratio": pair.log_time_ratio,
        "failures": [pair.before.failure, pair.after.failure],
    }


def _plot(tested: Tested, pairs: Sequence[Pair], rules: Rules) -> dict[str, Any]:
    """Positions [px] of the pairs, the interval and the smallest change of interest, all within what is widest."""
    own = [pair for pair in pairs if pair.run.line.name == tested.line]
    dots = [(pair, log) for pair in own if (log := pair.log_ratio(tested.quantity)) is not None]
    most = 1.1 * max(rules.effect, *(abs(log) for _, log in dots), 1e-6)

    def x(log: float) -> float:
        return round(PLOT_WIDTH * (0.5 + 0.5 * log / most), 1)

    change = tested.change
    bounds = None if change is None or change.low is None or change.high is None else (x(change.low), x(change.high))
    return {
        "line": tested.line,
        "quantity": tested.quantity,
        "width": PLOT_WIDTH,
        "height": PLOT_HEIGHT,
        "dots": [
            (x(log), round(PLOT_HEIGHT * (0.3 + 0.4 * (n % 5) / 4), 1), f"{pair.run}: {signed_percent(log)}")
            for n, (pair, log) in enumerate(dots)
        ],
        "bounds": bounds,
        "effect": (x(-rules.effect), x(rules.effect)),
        "ends": (signed_percent(-most), signed_percent(most)) if math.isfinite(most) else ("", ""),
    }
