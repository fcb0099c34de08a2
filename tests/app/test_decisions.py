"""A step's checks, grouped by the question that they answer."""

from __future__ import annotations

import pytest
from ispom_app.presentation.decisions import answers, mark, measured, sentence

from ispom.types import Check, Decision

TRIGGERS = [
    Decision(name, value, 0.5, value >= 0.5, question="New keyframe?", kind="trigger")
    for name, value in (("parallax", 0.2), ("tracks lost", 0.1))
]
INLIERS = Decision("inliers", 8, 12, False, question="New keyframe?")


def test_triggers_that_did_not_fire_are_no_failures():
    (answer,) = answers(TRIGGERS)
    assert (answer.question, answer.text) == ("New keyframe?", "No: 0 of 2 triggers")
    assert [mark(check) for check in answer.checks] == ["○", "○"]


def test_one_trigger_is_enough_and_is_named():
    fired = Decision("turn", 0.9, 0.5, True, question="New keyframe?", kind="trigger")
    (answer,) = answers([*TRIGGERS, fired])
    assert answer.text == "Yes: turn" and [mark(check) for check in answer.checks] == ["○", "○", "●"]


def test_a_requirement_that_failed_is_the_answer_and_the_only_cross():
    (answer,) = answers([*TRIGGERS, INLIERS])
    assert answer.text == "No: inliers" and [mark(check) for check in answer.checks] == ["○", "○", "✕"]


def test_a_finding_is_neither_good_nor_bad():
    finding = Decision("disparity offset", 0.3, 0.1, False, "px", kind="finding")
    (answer,) = answers([finding])
    assert (answer.question, answer.text, mark(finding)) == ("", "", "·")
    assert measured(finding) == "0.3 px (compared with 0.1 px)"
    assert measured(Decision("points", 1386, 12, True)) == "1386 (minimum 12)"


@pytest.mark.parametrize(("passed", "wanted"), [(True, "·"), (False, "!")])
def test_a_warning_is_marked_where_it_is_beyond_its_limit_and_is_no_failure(passed: bool, wanted: str):
    warning = Decision("scale spread", 30, 10, passed, "%", "<=", kind="warning")
    assert mark(warning) == wanted and not warning.failed


def test_questions_keep_their_order():
    other = Decision("points", 20, 12, True, question="Pose?")
    assert [(a.question, a.text) for a in answers([other, *TRIGGERS])] == [
        ("Pose?", "Yes"),
        ("New keyframe?", "No: 0 of 2 triggers"),
    ]


PARALLAX = Check(
    "parallax", "parallax", "trigger", "New keyframe?", unit="deg",
    passes="Keyframe: moved {value} degrees, {margin} more than needed.",
    fails="Moved {value} of {threshold} degrees.",
)  # fmt: skip


def test_a_check_says_its_outcome_in_its_own_words():
    assert sentence(PARALLAX.of(1.2, 2.5), PARALLAX) == "Moved 1.2 of 2.5 degrees."
    assert sentence(PARALLAX.of(3, 2.5), PARALLAX) == "Keyframe: moved 3 degrees, 0.5 more than needed."
    assert sentence(PARALLAX.of(1.2, 2.5, "place held"), PARALLAX) == "Moved 1.2 of 2.5 degrees; place held."
    share = Check("share", "share", "finding", relation="<", passes="{value:.0%} left.")
    assert sentence(share.of(0.85, 0.3), share) == "85 % left.", "a finding has one sentence for both outcomes"


def test_a_check_of_another_package_is_a_sentence_as_well():
    decision = Decision("tracks that agree", 8, 15, False, "px", consequence="no pose")
    assert sentence(decision, None) == "Tracks that agree: 8 px (minimum 15 px); no pose."
