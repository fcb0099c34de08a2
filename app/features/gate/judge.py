"""What the pairs say about each line: better, worse, the same, or that they cannot tell; and by what.

`change` defines the tests. A line is

- *worse* where an error grew, where its share of localised frames fell by more than `located`, or its time grew by more
  than `time`: each of them tested. Where every other pair is within the margins, runs that fail now or lose frames are
  no scatter either, and make it worse;
- *better* where an error fell, and no error, share of localised frames or time can have become worse by more than its
  margin; or where runs give a result that failed before, and every other pair is within the margins;
- *the same* where all errors, the share of localised frames and the time are within their margins, and the same runs
  failed;
- else it *cannot tell*.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ispom.errors import InputError, counted

from ..experiments.plan import Plan
from ..experiments.statistics import holm, value_of
from .change import FAILED, Change, change, pairs_needed
from .pairs import Pair
from .power import pairs_that_decide

Verdict = Literal["better", "worse", "same", "cannot tell"]
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
    """The margin: the largest change of an error that is of no interest, as the logarithm of a ratio."""
    level: float
    """Probability of a false alarm, over all lines and quantities together."""
    located: float
    """Fall of the mean share of localised frames [percentage points] beyond which a line is worse."""
    time: float | None
    """Growth of the time per frame beyond which a line is worse, as the logarithm of a ratio; None: never."""


@dataclass(frozen=True)
class Tested:
    """An error of a line, or the fall of its share of localised frames."""

    line: str
    quantity: str
    change: Change | None
    """None where no pair has the share of localised frames on both sides."""
    p_worse: float = 1.0
    """Adjusted for all lines and quantities together (Holm)."""
    p_better: float = 1.0


@dataclass(frozen=True)
class Judgement:
    """Of one line of the plan."""

    line: str
    verdict: Verdict
    reasons: tuple[str, ...]
    """Sentences: what made it better or worse, and what cannot be told."""
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
    coverage: Tested | None = None
    """Of the fall of the share of localised frames [percentage points]."""
    pairs_that_decide: int | None = None
    """Where the verdict is "cannot tell": about how many pairs like these would decide; None: no number would."""
    seeds_that_decide: int | None = None
    """The same as seeds of the plan's simulations; None where it has none, too."""


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


def strictest_level(plan: Plan, rules: Rules) -> float:
    """Returns the level of the first test of Holm's."""
    return rules.level / (len(plan.lines) * len(rules.quantities))


def judged(plan: Plan, pairs: Sequence[Pair], rules: Rules) -> list[Judgement]:
    """Returns a judgement for each line. Raises InputError where no run of a line has one of the errors."""
    errors = [_tested(line.name, q, pairs, rules) for line in plan.lines for q in rules.quantities]
    tested = _adjusted(errors + [_coverage(line.name, pairs, rules) for line in plan.lines])
    return [_judgement(plan, line.name, pairs, tested, rules) for line in plan.lines]


def overall(judgements: Sequence[Judgement]) -> Verdict:
    """Worse where a line is; else "cannot tell" where a line cannot; else better where a line is."""
    found = {judgement.verdict for judgement in judgements}
    order: tuple[Verdict, ...] = ("worse", "cannot tell", "better", "same")
    return next(verdict for verdict in order if verdict in found)


def percent(log_ratio: float) -> float:
    """Returns the change in per cent."""
    return 100 * math.expm1(log_ratio)


def _tested(line: str, quantity: str, pairs: Sequence[Pair], rules: Rules) -> Tested:
    own = [pair for pair in pairs if pair.run.line.name == line]
    logs = [log for pair in own if (log := pair.score(quantity)) is not None]
    if not any(pair.gave(quantity)[0] for pair in own):
        raise InputError(f"no run of line {line!r} had {quantity}: give sources with ground truth, or --quantities")
    return Tested(line, quantity, change(np.array(logs), rules.effect, rules.level))


def _coverage(line: str, pairs: Sequence[Pair], rules: Rules) -> Tested:
    """Of the fall of the share of localised frames."""
    falls = _falls([pair for pair in pairs if pair.run.line.name == line])
    return Tested(line, LOCATED, change(np.array(falls), rules.located, rules.level) if falls else None)


def _falls(pairs: Sequence[Pair]) -> list[float]:
    return [-difference for pair in pairs if (difference := pair.difference(LOCATED)) is not None]


def _adjusted(tested: Sequence[Tested]) -> list[Tested]:
    """With the p of Holm. A coverage that did not change in any pair cannot give a false alarm: it is no test."""
    some = [item.change for item in tested if _counts(item) and item.change is not None]
    worse, better = iter(holm([c.p_worse for c in some])), iter(holm([c.p_better for c in some]))
    return [replace(item, p_worse=next(worse), p_better=next(better)) if _counts(item) else item for item in tested]


def _counts(item: Tested) -> bool:
    return item.change is not None and (item.quantity != LOCATED or item.change.same < item.change.pairs)


def _judgement(plan: Plan, line: str, pairs: Sequence[Pair], tested: Sequence[Tested], rules: Rules) -> Judgement:
    own = [pair for pair in pairs if pair.run.line.name == line]
    mine = tuple(item for item in tested if item.line == line and item.quantity != LOCATED)
    coverage = next(item for item in tested if item.line == line and item.quantity == LOCATED)
    gave = [pair.gave(rules.quantities[0]) for pair in own]
    newly_failed, recovered = gave.count((True, False)), gave.count((False, True))
    located, steady = _means(own, LOCATED), _rest_is_steady(own, rules)
    times = [log for pair in own if (log := pair.log_time_ratio) is not None]
    time = change(np.array(times), rules.time or 0.0, rules.level) if times else None
    slower = rules.time is not None and (time is None or not time.at_most(rules.time))
    covered = coverage.change is None or coverage.change.at_most(rules.located)

    worse = [f"{i.quantity} grew" for i in mine if i.p_worse <= rules.level]
    if newly_failed > recovered and (steady or worse):
        worse.append(f"{counted(newly_failed, 'run')} gave a result before, and none now")
    fell = located is not None and located[0] - located[1] > rules.located
    if coverage.p_worse <= rules.level or (fell and steady):
        worse.append(_coverage_text(located))
    if rules.time is not None and time is not None and time.p_worse <= rules.level:
        worse.append("the time per frame grew")

    fallen = [i for i in mine if i.p_better <= rules.level and i.change is not None and i.change.mean < 0]
    better = [f"{i.quantity} fell" for i in fallen]
    if recovered > newly_failed and steady:
        better.append(f"{counted(recovered, 'run')} failed before, and gave a result now")
    doubts = [
        f"{i.quantity} may have grown by more than {percent(rules.effect):.3g} %"
        for i in mine
        if i not in fallen and (i.change is None or not i.change.at_most(rules.effect))
    ]
    if newly_failed:
        doubts.append(f"{counted(newly_failed, 'run')} gave a result before, and none now")
    if not covered:
        doubts.append(f"the share of localised frames may have fallen by more than {rules.located:g} percentage points")
    if slower:
        doubts.append("the time per frame may have grown")
    same = all(i.change is not None and i.change.within(rules.effect) for i in mine) and not recovered
    steady_coverage = coverage.change is None or coverage.change.within(rules.located)

    verdict: Verdict = "cannot tell"
    if worse:
        verdict, reasons = "worse", [*worse, *better]
    elif better and (not doubts or (steady and recovered > newly_failed and covered and not slower)):
        verdict, reasons = "better", better
    elif same and steady_coverage and not doubts:
        verdict, reasons = "same", []
    else:
        reasons = [*better, *doubts] or ["the change is not within the margins on both sides"]
    decide = _pairs_that_decide(own, mine, rules, covered, slower) if verdict == "cannot tell" else None
    return Judgement(
        line,
        verdict,
        tuple(reasons),
        mine,
        len(own),
        newly_failed,
        recovered,
        located,
        _means(own, LOST),
        _means(own, SEGMENTS),
        time,
        coverage,
        decide,
        None if decide is None else _seeds(plan, line, decide),
    )


def _coverage_text(located: tuple[float, float] | None) -> str:
    assert located is not None  # its change was tested
    return f"the share of localised frames fell from {located[0]:.1f} to {located[1]:.1f} %"


def _rest_is_steady(pairs: Sequence[Pair], rules: Rules) -> bool:
    """Whether some pairs are within the margins, and all others fail or localise another share of the frames."""
    steady = 0
    for pair in pairs:
        if abs(pair.score(rules.quantities[0]) or 0.0) == FAILED or abs(pair.difference(LOCATED) or 0) > rules.located:
            continue
        if any(abs(pair.score(quantity) or 0.0) > rules.effect for quantity in rules.quantities):
            return False
        steady += 1
    return steady > 0


def _pairs_that_decide(
    pairs: Sequence[Pair], tested: Sequence[Tested], rules: Rules, covered: bool, slower: bool
) -> int | None:
    """Returns the largest of the numbers that what is undecided needs; None where one of them cannot be decided."""
    level = rules.level / len(tested)
    needs = [
        pairs_that_decide(np.array(logs), rules.effect, level)
        for item in tested
        if (logs := [log for pair in pairs if (log := pair.score(item.quantity)) is not None])
    ]
    if not covered:
        needs.append(pairs_that_decide(np.array(_falls(pairs)), rules.located, level, one_sided=True))
    if slower and rules.time is not None:
        times = [log for pair in pairs if (log := pair.log_time_ratio) is not None]
        needs.append(pairs_that_decide(np.array(times), rules.time, level, one_sided=True) if times else None)
    known = [need for need in needs if need is not None]
    return max(len(pairs) + 1, *known) if len(known) == len(needs) else None


def _seeds(plan: Plan, line: str, pairs: int) -> int | None:
    """Returns how many seeds of each simulation give `pairs` pairs; a recording gives one pair."""
    sources = [source for source in plan.sources if plan.line(line).runs_on(source)]
    simulated = sum(source.startswith("sim:") for source in sources)
    return math.ceil((pairs - len(sources) + simulated) / simulated) if simulated else None


def _means(pairs: Sequence[Pair], quantity: str) -> tuple[float, float] | None:
    values = [(value_of(p.before, quantity), value_of(p.after, quantity)) for p in pairs]
    both = [(a, b) for a, b in values if a is not None and b is not None]
    return (sum(a for a, _ in both) / len(both), sum(b for _, b in both) / len(both)) if both else None
