"""Medians, spreads, paired comparisons and statements, against values worked out by hand."""

from __future__ import annotations

import pytest
from ispom_app.features.experiments.plan import Line, Statement
from ispom_app.features.experiments.statistics import outcomes, paired, spreads

from tests.app.experiment.made import LINES, plan, row

A, B = LINES


def test_spreads_count_what_is_missing() -> None:
    rows = [row(A, seed, ate_m=value) for seed, value in enumerate((1.0, 2.0, 3.0, None, float("inf")))]
    found = spreads(plan(quantities=("ate_m",)), rows)[0]
    assert (found.runs, found.failed, found.median) == (5, 2, 2.0)
    assert found.quartiles == (1.5, 2.5) and found.extremes == (1.0, 3.0)


def test_pairs_are_of_the_same_seed() -> None:
    rows = [row(A, seed, ate_m=float(seed + 1)) for seed in range(6)]
    rows += [row(B, seed, ate_m=0.5 * (seed + 1)) for seed in (5, 4, 3, 2, 1, 9)]
    (found,) = paired(plan(quantities=("ate_m",)), rows)
    assert (found.pairs, found.median_ratio, found.smaller) == (5, 0.5, 5)
    assert found.median_difference == -2.0
    assert found.p == pytest.approx(2 / 2**5) and found.p_holm == found.p


def test_too_few_pairs_have_no_significance() -> None:
    rows = [row(line, seed, ate_m=float(seed + k)) for k, line in enumerate(LINES) for seed in range(4)]
    assert paired(plan(quantities=("ate_m",)), rows)[0].p is None


def test_three_lines_are_adjusted_by_holm() -> None:
    lines = (*LINES, Line("c", "integrated"))
    rows = [row(line, seed, ate_m=float(seed * seed + k)) for k, line in enumerate(lines) for seed in range(6)]
    found = paired(plan(lines=lines, quantities=("ate_m",)), rows)
    assert [item.p for item in found] == pytest.approx([2 / 2**6] * 3)
    assert [item.p_holm for item in found] == pytest.approx([3 * 2 / 2**6] * 3)


def said(**changes) -> Statement:
    return Statement(**({"text": "t", "quantity": "ate_m", "line": "a"} | changes))


def test_statements_hold_in_a_share_of_the_runs() -> None:
    rows = [row(A, seed, ate_m=value) for seed, value in enumerate((0.1, 0.2, 0.9, None))]
    rows += [row(B, seed, ate_m=1.0) for seed in range(2)]
    statements = (
        said(at_most=0.5),
        said(at_most=0.5, share=0.5),
        said(at_least=0.2, share=0.5),
        said(over_line="b", at_most=0.2, share=0.5),
    )
    found = outcomes(plan(statements=statements), rows)
    assert [(o.holding, o.runs, o.holds) for o in found] == [(2, 4, False), (2, 4, True), (2, 4, True), (2, 4, True)]


def test_a_statement_can_compare_two_sources() -> None:
    rows = [row(A, 0, "sim:one", ate_m=3.0), row(A, 0, "sim:two", ate_m=1.0)]
    statement = said(source="sim:one", over_source="sim:two", at_least=2.5)
    (found,) = outcomes(plan(sources=("sim:one", "sim:two"), statements=(statement,)), rows)
    assert found.values == (3.0,) and found.holds


def test_a_statement_may_say_that_a_run_fails() -> None:
    rows = [row(A, 0, located_percent=80.0), row(A, 1, located_percent=20.0), row(A, 2)]
    statements = [said(quantity="located_percent", at_most=50, or_fails=fails) for fails in (True, False)]
    found = outcomes(plan(statements=tuple(statements)), rows)
    assert [(o.holding, o.runs) for o in found] == [(2, 3), (1, 3)]


def test_a_statement_without_runs_does_not_hold() -> None:
    (found,) = outcomes(plan(statements=(said(at_most=1.0),)), [])
    assert not found.holds
