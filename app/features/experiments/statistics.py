"""Medians and spreads of a line's runs, and lines compared run by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

from .plan import Plan, Statement
from .row import Row

MIN_PAIRS = 5
"""With fewer pairs not even a difference of one sign is rare by chance: 2 / 2^5 = 0.06."""


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


@dataclass(frozen=True)
class Outcome:
    """What became of a statement."""

    statement: Statement
    values: tuple[float, ...]
    """Of its runs, in the order of the seeds."""
    missing: int
    """Runs without the quantity: none of them counts as holding, unless the statement says so."""
    holding: int

    @property
    def runs(self) -> int:
        return len(self.values) + self.missing

    @property
    def holds(self) -> bool:
        return self.runs > 0 and self.holding >= self.statement.share * self.runs


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
        values, missing = [], 0
        for source in plan.sources if statement.source is None else (statement.source,):
            own = _by_seed(rows, statement.line, source, statement.quantity)
            over = None
            if statement.over_line is not None or statement.over_source is not None:
                over = _by_seed(
                    rows, statement.over_line or statement.line, statement.over_source or source, statement.quantity
                )
            seeds = {r.run.seed for r in rows if r.run.line.name == statement.line and r.run.source == source}
            for seed in sorted(seeds):
                value = _ratio(own, over, seed)
                missing += value is None
                values += [value] if value is not None else []
        holding = sum(_within(statement, value) for value in values)
        found.append(Outcome(statement, tuple(values), missing, holding + (missing if statement.or_fails else 0)))
    return found


def value_of(row: Row, quantity: str) -> float | None:
    """None where the run failed or has no such number."""
    value = (row.values or {}).get(quantity)
    return float(value) if value is not None and np.isfinite(value) else None


def _by_seed(rows: Sequence[Row], line: str, source: str, quantity: str) -> dict[int, float]:
    own = [r for r in rows if r.run.line.name == line and r.run.source == source]
    return {r.run.seed: v for r in own if (v := value_of(r, quantity)) is not None}


def _ratio(own: dict[int, float], over: dict[int, float] | None, seed: int) -> float | None:
    if seed not in own or (over is not None and not over.get(seed)):
        return None
    return own[seed] if over is None else own[seed] / over[seed]


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
