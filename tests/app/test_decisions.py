"""A step's checks, grouped by the question that they answer."""

from __future__ import annotations

from ispom_app.decisions import answers, mark, measured

from ispom.types import Decision

TRIGGERS = [
    Decision(name, value, 0.5, value >= 0.5, question="New key frame?", kind="trigger")
    for name, value in (("parallax", 0.2), ("tracks lost", 0.1))
]
INLIERS = Decision("inliers", 8, 12, False, question="New key frame?")


def test_triggers_that_did_not_fire_are_no_failures():
    (answer,) = answers(TRIGGERS)
    assert (answer.question, answer.text) == ("New key frame?", "No: 0 of 2 triggers")
    assert [mark(check) for check in answer.checks] == ["○", "○"]


def test_one_trigger_is_enough_and_is_named():
    fired = Decision("turn", 0.9, 0.5, True, question="New key frame?", kind="trigger")
    (answer,) = answers([*TRIGGERS, fired])
    assert answer.text == "Yes: turn" and [mark(check) for check in answer.checks] == ["○", "○", "●"]


def test_a_requirement_that_failed_is_the_answer_and_the_only_cross():
    (answer,) = answers([*TRIGGERS, INLIERS])
    assert answer.text == "No: inliers" and [mark(check) for check in answer.checks] == ["○", "○", "✕"]


def test_a_finding_is_neither_good_nor_bad():
    finding = Decision("disparity offset", 0.3, 0.1, False, "px", kind="finding")
    (answer,) = answers([finding])
    assert (answer.question, answer.text, mark(finding)) == ("", "", "·")
    assert measured(finding) == "0.3 px (≥ 0.1)"
    assert measured(Decision("points", 1386, 12, True)) == "1386 (≥ 12)"


def test_questions_keep_their_order():
    other = Decision("points", 20, 12, True, question="Pose?")
    assert [(a.question, a.text) for a in answers([other, *TRIGGERS])] == [
        ("Pose?", "Yes"),
        ("New key frame?", "No: 0 of 2 triggers"),
    ]
