"""What the pairs say about each line: better, worse, or noise, and by what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ispom.errors import InputError, counted

from ..experiments.plan import Plan
from ..experiments.statistics import holm, value_of
from .change import Change, change, pairs_needed
from .pairs import Pair

Verdict = Literal["better", "worse", "noise"]
ERRORS = (
    "ate_m",
    "ate_percent",
    "t_err_percent",
    "r_err_deg_per_100m",
    "rpe_m",
    "rpe_deg",
    "between_stereo_rmse_m",
    "spline_between_stereo_rmse_m",
)
"""Quantities of an experiment of which less is better."""
LOCATED, SEGMENTS, LOST, TIME = "located_percent", "segments", "lost", "time"


@dataclass(frozen=True)
class Rules:
    """What counts as a change."""

    quantities: tuple[str, ...]
    effect: float
    """Smallest change of interest, as the logarithm of a ratio."""
    level: float
    """Probability of a false alarm, over all lines and quantities together."""
    located: float
    """Fall of the mean share of localised frames [percentage points] beyond which a line is worse."""
    time: float | None
    """Growth of the time per frame beyond which a line is worse, as the logarithm of a ratio; None: never."""


@dataclass(frozen=True)
class Tested:
    """A quantity of a line."""

    line: str
    quantity: str
    change: Change | None
    """None where no pair has the quantity on both sides."""
    p_worse: float = 1.0
    """Adjusted for all lines and quantities together (Holm)."""
    p_better: float = 1.0


@dataclass(frozen=True)
class Judgement:
    """Of one line of the plan."""

    line: str
    verdict: Verdict
    reasons: tuple[str, ...]
    """Sentences: what made it better or worse, and what could not be tested."""
    tested: tuple[Tested, ...]
    runs: int
    newly_failed: int
    """Runs with a result before, and none after."""
    recovered: int
    located: tuple[float, float] | None
    """Mean share of localised frames before and after [%], over pairs that have both."""
    lost: tuple[float, float] | None
    """Mean number of lost frames."""
    segments: tuple[float, float] | None
    time: Change | None
    """Of the median time per frame."""


def rules_of(
    plan: Plan, quantities: tuple[str, ...], effect: float, level: float, located: float, time: float | None
) -> Rules:
    """Returns the rules that the command states in per cent. Raises InputError for values out of range, and where the
    plan has too few runs to ever find anything."""
    for name, value, low, high in (
        ("effect", effect, 0, 100),
        ("level", level, 1e-4, 20),
        ("located", located, 0, 100),
        *([] if time is None else [("time", time, 0, 1000)]),
    ):
        if not low <= value <= high:
            raise InputError(f"--{name} is {value:g}, give a value from {low:g} to {high}")
    chosen = quantities or next(((q,) for q in plan.quantities if q in ERRORS), ())
    if other := next((q for q in chosen if q not in ERRORS), None):
        raise InputError(f"--quantities has {other[:40]!r}, which is no error: give some of {', '.join(ERRORS)}")
    if not chosen:
        raise InputError(f"{plan.name} has no error among its quantities: give --quantities, such as ate_m")
    rules = Rules(
        tuple(dict.fromkeys(chosen)),
        math.log1p(effect / 100),
        level / 100,
        located,
        None if time is None else math.log1p(time / 100),
    )
    needed = pairs_needed(rules.level, len(plan.lines) * len(rules.quantities))
    for line in plan.lines:
        runs = sum(run.line == line for run in plan.runs())
        if runs < needed:
            raise InputError(
                f"{plan.name} has {counted(runs, 'run')} of line {line.name!r}, and fewer than {needed} cannot show "
                f"a change at --level {level:g}: add seeds or sources, or raise --level"
            )
    return rules


def judged(plan: Plan, pairs: Sequence[Pair], rules: Rules) -> list[Judgement]:
    """Returns a judgement for each line. Raises InputError where no run of a line has one of the errors."""
    tested = _adjusted([_tested(line.name, q, pairs, rules) for line in plan.lines for q in rules.quantities])
    return [_judgement(line.name, pairs, tested, rules) for line in plan.lines]


def overall(judgements: Sequence[Judgement]) -> Verdict:
    """Worse where a line is; better where one is better and none worse."""
    found = {judgement.verdict for judgement in judgements}
    return "worse" if "worse" in found else "better" if "better" in found else "noise"


def percent(log_ratio: float) -> float:
    """Returns the change in per cent."""
    return 100 * math.expm1(log_ratio)


def _tested(line: str, quantity: str, pairs: Sequence[Pair], rules: Rules) -> Tested:
    own = [pair for pair in pairs if pair.run.line.name == line]
    logs = [log for pair in own if (log := pair.log_ratio(quantity)) is not None]
    if not logs and not any(pair.gave(quantity)[0] for pair in own):
        raise InputError(f"no run of line {line!r} had {quantity}: give sources with ground truth, or --quantities")
    return Tested(line, quantity, change(np.array(logs), rules.effect, rules.level) if logs else None)


def _adjusted(tested: Sequence[Tested]) -> list[Tested]:
    some = [item.change for item in tested if item.change is not None]
    worse, better = iter(holm([c.p_worse for c in some])), iter(holm([c.p_better for c in some]))
    return [
        item if item.change is None else replace(item, p_worse=next(worse), p_better=next(better)) for item in tested
    ]


def _judgement(line: str, pairs: Sequence[Pair], tested: Sequence[Tested], rules: Rules) -> Judgement:
    own = [pair for pair in pairs if pair.run.line.name == line]
    mine = tuple(item for item in tested if item.line == line)
    gave = [pair.gave(rules.quantities[0]) for pair in own]
    newly_failed, recovered = gave.count((True, False)), gave.count((False, True))
    located = _means(own, LOCATED)
    times = [log for pair in own if (log := pair.log_time_ratio) is not None]
    time = change(np.array(times), rules.time or 0.0, rules.level) if times else None
    worse = [f"{i.quantity} grew" for i in mine if i.p_worse <= rules.level]
    if newly_failed > recovered:
        worse.append(f"{counted(newly_failed, 'run')} gave a result before, and none now")
    if located is not None and located[0] - located[1] > rules.located:
        worse.append(f"the share of localised frames fell from {located[0]:.1f} to {located[1]:.1f} %")
    if rules.time is not None and time is not None and time.p_worse <= rules.level:
        worse.append("the time per frame grew")
    better = [f"{i.quantity} fell" for i in mine if i.p_better <= rules.level]
    verdict: Verdict = "worse" if worse else "better" if better else "noise"
    return Judgement(
        line,
        verdict,
        (*worse, *better),
        mine,
        len(own),
        newly_failed,
        recovered,
        located,
        _means(own, LOST),
        _means(own, SEGMENTS),
        time,
    )


def _means(pairs: Sequence[Pair], quantity: str) -> tuple[float, float] | None:
    values = [(value_of(p.before, quantity), value_of(p.after, quantity)) for p in pairs]
    both = [(a, b) for a, b in values if a is not None and b is not None]
    return (sum(a for a, _ in both) / len(both), sum(b for _, b in both) / len(both)) if both else None
