"""What decides: errors, failures, localised frames, and time only where it is asked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from ispom_app.features.experiments.plan import Line, Run
from ispom_app.features.experiments.row import Row
from ispom_app.features.gate.judge import Judgement, Rules, judged, overall, rules_of
from ispom_app.features.gate.pairs import Pair, paired
from ispom_app.features.gate.worst import worst_case, worst_first

from ispom.errors import InputError
from tests.app.experiment.made import LINES, plan, row

A, B = LINES
SEEDS = range(10)
PLAN = plan(lines=(A,), seeds=tuple(SEEDS))
RULES = Rules(("ate_m",), math.log(1.01), 0.01, 1.0, None)
NOWHERE = Path("nowhere")


def pair(before: Row, after: Row) -> Pair:
    return Pair(before, after, (NOWHERE, NOWHERE))


def pairs_of(line: Line = A, factor: float = 1.0, **changes: float) -> list[Pair]:
    """Ten runs whose errors all change by the same factor, with other values after than before."""
    values = {"located_percent": 100.0, "segments": 1.0, "lost": 0.0}
    errors = [0.1 + 0.01 * seed for seed in SEEDS]
    before = [Row(Run(line, "sim:tiny", seed), None, {"ate_m": errors[seed], **values}) for seed in SEEDS]
    after = [Row(r.run, None, {"ate_m": factor * errors[r.run.seed], **values, **changes}) for r in before]
    return [pair(a, b) for a, b in zip(before, after, strict=True)]


def one(pairs: Sequence[Pair], rules: Rules = RULES) -> Judgement:
    (found,) = judged(PLAN, pairs, rules)
    return found


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.0, "same"), (1.03, "worse"), (0.97, "better"), (1.009, "same"), (0.992, "same")]
)
def test_errors_decide_beyond_the_smallest_change_of_interest(factor: float, verdict: str) -> None:
    found = one(pairs_of(factor=factor))
    assert found.verdict == verdict and bool(found.reasons) == (verdict != "same")


def test_a_line_that_localises_fewer_frames_is_worse_whatever_its_error() -> None:
    assert one(pairs_of(factor=0.5, located_percent=98.0)).verdict == "worse"
    assert one(pairs_of(located_percent=99.5)).verdict == "same"
    assert one(pairs_of(segments=3.0, lost=7.0)).verdict == "same"


def test_a_run_that_fails_now_is_worse_unless_another_recovered() -> None:
    pairs = pairs_of()
    failed = [pair(pairs[0].before, Row(pairs[0].run, "no motion")), *pairs[1:]]
    assert (one(failed).verdict, one(failed).newly_failed) == ("worse", 1)
    both = [*failed[:-1], pair(Row(pairs[-1].run, "no motion"), pairs[-1].after)]
    assert (one(both).verdict, one(both).recovered) == ("cannot tell", 1)
    worst = worst_case(failed, [one(failed)], RULES)
    assert worst is not None and worst.pair is failed[0] and worst.comparison is None


def test_one_line_of_two_that_is_worse_makes_all_worse() -> None:
    both = plan(lines=LINES, seeds=tuple(SEEDS))
    pairs = pairs_of(A, 0.9) + pairs_of(B, 1.1)
    judgements = judged(both, pairs, RULES)
    assert [j.verdict for j in judgements] == ["better", "worse"] and overall(judgements) == "worse"
    assert [t.p_worse for j in judgements for t in j.tested] == pytest.approx([1.0, 2 / 2**10])
    assert overall(judgements[:1]) == "better"


def test_nothing_is_the_worst_where_nothing_got_worse() -> None:
    for pairs in (pairs_of(), pairs_of(factor=0.9)):
        assert worst_case(pairs, [one(pairs)], RULES) is None


def test_the_worst_come_first() -> None:
    pairs = pairs_of()
    grown = pair(pairs[3].before, row(A, 3, ate_m=9.0, located_percent=100.0))
    lost = pair(pairs[5].before, row(A, 5, ate_m=0.1, located_percent=40.0))
    failed = pair(pairs[7].before, Row(pairs[7].run, "no motion"))
    assert worst_first([*pairs[:2], grown, lost, failed], RULES)[:3] == [failed, lost, grown]


def test_a_plan_with_too_few_runs_is_refused_before_anything_is_computed() -> None:
    few = plan(lines=(A,), seeds=tuple(range(6)))
    with pytest.raises(InputError, match="fewer than 7"):
        rules_of(few, (), 1, 1, 1, None)
    assert rules_of(few, (), 1, 5, 1, None).quantities == ("ate_m",)


def test_a_quantity_that_is_no_error_is_refused() -> None:
    for quantities, shown in ((("poses",), ()), ((), ("poses",))):
        with pytest.raises(InputError):
            rules_of(plan(lines=(A,), seeds=tuple(SEEDS), quantities=shown), quantities, 1, 1, 1, None)


def test_runs_without_the_error_are_refused() -> None:
    with pytest.raises(InputError, match="had rpe_m"):
        one(pairs_of(), Rules(("rpe_m",), 0.01, 0.01, 1.0, None))


def test_pairs_are_of_the_same_images() -> None:
    before, after = (Row(next(PLAN.runs()), None, {"ate_m": 1.0}, images) for images in "ab")
    with pytest.raises(InputError, match="other images"):
        paired([before], [after], (NOWHERE, NOWHERE))
