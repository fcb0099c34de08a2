"""Medians and spreads of a line's runs, and lines compared run by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from scipy.stats import wilcoxon

from .plan import COVERAGE, Plan, Statement
from .row import Row

MIN_PAIRS = 5
"""Least number of pairs: with fewer, even differences of only one sign are not rare by chance (2 / 2^5 = 0.06)."""


@dataclass(frozen=True)
class Spread:
    """Of one quantity over the runs of a line on a source that have it."""

    line: str
    source: str
    quantity: str
    runs: int
    failed: int
    """Runs that gave nothing, and runs without this quantity."""
    median: float | None
    quartiles: tuple[float, float] | None
    extremes: tuple[float, float] | None


@dataclass(frozen=True)
class Paired:
    """Two lines on the same images, quantity by quantity."""

    source: str
    quantity: str
    line_a: str
    line_b: str
    pairs: int
    median_difference: float
    """Of b - a."""
    median_ratio: float | None
    """Of b / a; None where an a is 0."""
    smaller: int
    """Pairs in which b is smaller than a."""
    p: float | None
    """Of the Wilcoxon signed-rank test, two-sided; None with fewer than MIN_PAIRS pairs."""
    p_holm: float | None
    """The same, for all pairs of lines of this quantity and source together (Holm 1979)."""


Verdict = Literal["holds", "does not hold", "could not be tested"]


@dataclass(frozen=True)
class Outcome:
    """What became of a statement."""

    statement: Statement
    values: tuple[float, ...]
    """Of its runs that have one, in the order of the seeds."""
    located_percent: tuple[float | None, ...]
    """Of the same runs: the share of their frames that is located."""
    missing: int
    """Runs without the quantity."""
    holding: int
    untested: int
    """Runs that say nothing of it: they could not be computed, or located too few frames."""

    @property
    def runs(self) -> int:
        return len(self.values) + self.missing

    @property
    def verdict(self) -> Verdict:
        """Runs that say nothing decide nothing: what holds or not does so whatever they would have said."""
        needed = self.statement.share * self.runs
        if self.runs and self.holding >= needed and self.untested < self.runs:
            return "holds"
        return "could not be tested" if self.holding + self.untested >= needed else "does not hold"

    @property
    def holds(self) -> bool:
        return self.verdict == "holds"

    @property
    def coverage(self) -> str:
        """The least share of located frames, in words; an empty text where it is unknown."""
        known = [share for share in self.located_percent if share is not None]
        return f"{min(known):.0f} % of the frames located" if known else ""


def spreads(plan: Plan, rows: Sequence[Row]) -> list[Spread]:
    """Of every quantity, source and line, in the plan's order."""
    found = []
    for quantity in plan.quantities:
        for source in plan.sources:
            for line in plan.lines:
                if not line.runs_on(source):
                    continue
                own = [r for r in rows if r.run.line.name == line.name and r.run.source == source]
                values = [v for r in own if (v := value_of(r, quantity)) is not None]
                middle = quartiles = extremes = None
                if values:
                    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
                    quartiles, extremes = (low, high), (min(values), max(values))
                found.append(
                    Spread(line.name, source, quantity, len(own), len(own) - len(values), middle, quartiles, extremes)
                )
    return found


def paired(plan: Plan, rows: Sequence[Row]) -> list[Paired]:
    """Every two lines that share at least two seeds of a source."""
    found = []
    for quantity in plan.quantities:
        for source in plan.sources:
            running = [line.name for line in plan.lines if line.runs_on(source)]
            of_line = {name: _by_seed(rows, name, source, quantity) for name in running}
            some = [_paired(source, quantity, a, b, of_line) for a, b in combinations(of_line, 2)]
            found += _with_holm([item for item in some if item is not None])
    return found


def outcomes(plan: Plan, rows: Sequence[Row]) -> list[Outcome]:
    """Of the plan's statements."""
    found = []
    for statement in plan.statements:
        values, located, results = list[float](), list[float | None](), list[bool | None]()
        for source in plan.sources if statement.source is None else (statement.source,):
            own, over = _rows_by_seed(rows, statement.line, source), None
            if statement.over_line is not None or statement.over_source is not None:
                over = _rows_by_seed(rows, statement.over_line or statement.line, statement.over_source or source)
            for seed, row in sorted(own.items()):
                value = value_of(row, statement.quantity)
                if over is not None and value is not None:
                    below = value_of(over[seed], statement.quantity) if seed in over else None
                    value = value / below if below else None
                if value is not None:
                    values.append(value)
                    located.append(value_of(row, COVERAGE))
                results.append(_result(statement, row, value, over is None or _covers(statement, over.get(seed))))
        holding, untested = results.count(True), results.count(None)
        missing = len(results) - len(values)
        found.append(Outcome(statement, tuple(values), tuple(located), missing, holding, untested))
    return found


def _result(statement: Statement, row: Row, value: float | None, comparable: bool) -> bool | None:
    """Returns whether a run holds; None where it says nothing."""
    failed = row.failed(statement.quantity)
    if failed is not None and failed in statement.or_fails:
        return True
    if row.failure is not None and failed is None:
        return None  # it was not computed
    if not comparable:
        return None
    if failed is not None or not _covers(statement, row):
        small = statement.needs_coverage and statement.at_most is not None
        return False if small else None  # who finds no way has no small error; of a large one that says nothing
    return None if value is None else _within(statement, value)


def _covers(statement: Statement, row: Row | None) -> bool:
    """Whether enough frames are located for a statement on an error."""
    if row is None:
        return False
    located = value_of(row, COVERAGE)
    return not statement.needs_coverage or (located is not None and located >= statement.least_located_percent)


def value_of(row: Row, quantity: str) -> float | None:
    """None where the run failed or has no such number."""
    value = (row.values or {}).get(quantity)
    return float(value) if value is not None and np.isfinite(value) else None


def _by_seed(rows: Sequence[Row], line: str, source: str, quantity: str) -> dict[int, float]:
    own = [r for r in rows if r.run.line.name == line and r.run.source == source]
    return {r.run.seed: v for r in own if (v := value_of(r, quantity)) is not None}


def _rows_by_seed(rows: Sequence[Row], line: str, source: str) -> dict[int, Row]:
    return {r.run.seed: r for r in rows if r.run.line.name == line and r.run.source == source}


def _within(statement: Statement, value: float) -> bool:
    return (statement.at_most is None or value <= statement.at_most) and (
        statement.at_least is None or value >= statement.at_least
    )


def _paired(source: str, quantity: str, a: str, b: str, of_line: dict[str, dict[int, float]]) -> Paired | None:
    seeds = sorted(of_line[a].keys() & of_line[b].keys())
    if len(seeds) < 2:
        return None
    one, other = (np.array([of_line[name][seed] for seed in seeds]) for name in (a, b))
    difference, p = other - one, None
    if len(seeds) >= MIN_PAIRS:
        tested: Any = wilcoxon(difference) if difference.any() else None
        p = float(tested.pvalue) if tested is not None else 1.0
    ratio = float(np.median(other / one)) if one.all() else None
    smaller = int((difference < 0).sum())
    return Paired(source, quantity, a, b, len(seeds), float(np.median(difference)), ratio, smaller, p, None)


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns the adjusted p of several tests: each times the number of tests that are left when it is its turn,
    never decreasing (Holm 1979)."""
    adjusted, highest = [0.0] * len(p_values), 0.0
    for place, (p, i) in enumerate(sorted((p, i) for i, p in enumerate(p_values))):
        highest = max(highest, min(1.0, p * (len(p_values) - place)))
        adjusted[i] = highest
    return adjusted


def _with_holm(found: list[Paired]) -> list[Paired]:
    tested = [(i, item.p) for i, item in enumerate(found) if item.p is not None]
    adjusted = dict(zip((i for i, _ in tested), holm([p for _, p in tested]), strict=True))
    return [replace(item, p_holm=adjusted.get(i)) for i, item in enumerate(found)]
