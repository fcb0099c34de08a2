"""Medians, spreads, paired comparisons and statements, against values worked out by hand."""

from __future__ import annotations

import pytest
from ispom_app.features.experiments.plan import Line, Statement
from ispom_app.features.experiments.statistics import outcomes, paired, spreads

from tests.app.experiment.made import LINES, failed, plan, row

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


NOTHING = "sim:tiny: no method found any motion: give images with texture in focus, and overlap"
NO_EXTRA = "fused needs gtsam, which is not installed: run 'pip install gtsam small_gicp'"


def test_a_statement_may_name_the_failure_that_confirms_it() -> None:
    rows = [row(A, 0, located_percent=20.0), failed(A, 1, NOTHING), row(A, 2, located_percent=None)]
    statements = [said(quantity="located_percent", at_most=50, or_fails=kinds) for kinds in (
        ("no motion", "lost"), ("no motion",), ("lost",), ())]  # fmt: skip
    found = outcomes(plan(statements=tuple(statements)), rows)
    assert [(o.holding, o.untested, o.runs) for o in found] == [(3, 0, 3), (2, 1, 3), (2, 1, 3), (1, 2, 3)]
    assert [o.verdict for o in found] == ["holds", *["could not be tested"] * 3]


@pytest.mark.parametrize("failure", [NO_EXTRA, "RuntimeError: no such disparity", "no/such does not exist: correct it"])
def test_any_other_failure_confirms_and_contradicts_nothing(failure: str) -> None:
    statements = (
        said(quantity="located_percent", at_most=50, or_fails=("no motion", "lost")),
        said(at_most=1.0),
        said(at_least=1.0),
        said(over_line="b", at_least=1.0),
    )
    found = outcomes(plan(statements=statements), [failed(A, 0, failure), row(B, 0, ate_m=1.0)])
    assert [(o.verdict, o.untested) for o in found] == [("could not be tested", 1)] * 4


def test_what_is_clear_without_the_runs_that_say_nothing_is_said() -> None:
    rows = [row(A, 0, ate_m=2.0), failed(A, 1, NO_EXTRA)]
    found = outcomes(plan(statements=(said(at_most=1.0), said(at_most=3.0, share=0.5), said(at_most=3.0))), rows)
    assert [o.verdict for o in found] == ["does not hold", "holds", "could not be tested"]


def test_a_small_error_of_few_frames_is_none() -> None:
    rows = [row(A, 0, ate_m=0.1, located_percent=43.0), row(B, 0, ate_m=1.0)]
    statements = (
        said(at_most=1.0),
        said(at_most=1.0, least_located_percent=40.0),
        said(at_least=0.05),
        said(line="b", over_line="a", at_least=5.0),
        said(quantity="located_percent", at_most=50.0),
    )
    found = outcomes(plan(statements=statements), rows)
    expected = ["does not hold", "holds", "could not be tested", "could not be tested", "holds"]
    assert [o.verdict for o in found] == expected
    assert found[0].located_percent == (43.0,) and "43 %" in found[0].coverage


def test_who_finds_no_motion_has_no_small_error() -> None:
    (found,) = outcomes(plan(statements=(said(at_most=1.0),)), [failed(A, 0, NOTHING)])
    assert found.verdict == "does not hold"


def test_a_statement_without_runs_could_not_be_tested() -> None:
    (found,) = outcomes(plan(statements=(said(at_most=1.0),)), [])
    assert not found.holds and found.verdict == "could not be tested"
