"""Expressions are read as a closed grammar, and every mistake is one sentence with its place."""

from __future__ import annotations

from dataclasses import replace

import pytest
from ispom_app.engine.conditions.parser import DEEPEST, parse
from ispom_app.engine.conditions.syntax import All, Any, Call, Chain, Comparison, Name, Not, Number, Text
from ispom_app.engine.conditions.words import LONGEST
from ispom_app.engine.history.quantities import quantities

from ispom.errors import InputError
from ispom.methods import names

KNOWN = quantities(names())
INLIERS, STATUS = Name(KNOWN["stereo.inliers"]), Name(KNOWN["stereo.status"])
FEW = Comparison(INLIERS, "<", Number(30.0))
KEY = Name(KNOWN["monocular.key_frame"])


@pytest.mark.parametrize(
    ("text", "node"),
    [
        ("stereo.inliers < 30", FEW),
        ("stereo.inliers<30", FEW),
        ("((stereo.inliers) < (30))", FEW),
        ("stereo.status == 'lost'", Comparison(STATUS, "==", Text("lost"))),
        ("monocular.key_frame", KEY),
        ("monocular.paper.inliers < 30", replace(FEW, left=Name(KNOWN["monocular.paper.inliers"]))),
        ("changed(stereo.status)", Call("changed", STATUS)),
        ("not stereo.inliers < 30", Not(FEW)),
        ("monocular.key_frame or stereo.inliers < 30 and not monocular.key_frame", Any((KEY, All((FEW, Not(KEY)))))),
        (
            "stereo.inliers - 1 - 2 * 3 > 0",
            Comparison(
                Chain(INLIERS, (("-", Number(1.0)), ("-", Chain(Number(2.0), (("*", Number(3.0)),))))), ">", Number(0.0)
            ),
        ),
        ("stereo.parallel.x", None),
    ],
)
def test_what_is_read(text: str, node: object) -> None:
    if node is None:
        with pytest.raises(InputError):
            parse(text, KNOWN)
    else:
        assert parse(text, KNOWN).node == node


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("", 1, "the end stands where a number"),
        ("stero.inliers < 3", 1, "did you mean stereo.inliers?"),
        ("true or monocular.paper.inlirs < 3", 1, "true is unknown"),
        ("monocular.paper.inlirs < 3", 1, "did you mean monocular.paper.inliers?"),
        ("stereo.qqqq > 1", 1, "stereo has status, key_frame"),
        ("qqqq > 1", 1, "names are METHOD.KEY"),
        ("stereo.status == 'lst'", 18, "stereo.status is never 'lst': give initialising or tracking or lost"),
        ("stereo.status", 1, "this is a text, where a condition is needed"),
        ("1 < 2", 1, "it names nothing that changes"),
        ("1 < stereo.inliers < 3", 20, "a comparison has two sides"),
        ("stereo.inliers = 3", 16, "write =="),
        ("stereo.inliers < 30px", 18, "numbers have no unit"),
        ("stereo.inliers < 1e999", 18, "is too large"),
        ("(stereo.inliers < 3", 20, "stands where ) is needed: see column 1"),
        ("changed(increased(stereo.inliers))", 9, "cannot stand inside each other"),
        ("increased(stereo.status)", 11, "this is a text, where a number is needed"),
        ("changed stereo.status", 9, "stereo.status stands where ( is needed"),
        ("stereo.status == monocular.inliers", 15, "== compares a text with a number"),
        ("stereo.status < 'lost'", 1, "this is a text, where a number is needed"),
        ("stereo.inliers and monocular.key_frame", 1, "this is a number, where a condition is needed"),
        ("monocular.key_frame and stereo.inliers", 25, "this is a number, where a condition is needed"),
        ("monocular.key_frame stereo.inliers", 21, "join conditions with and, or"),
        ("stereo.status == 'lost", 18, "close its quotation mark"),
        ("monocular.key_frame && stereo.key_frame", 21, "write and"),
        ("__import__('os')", 1, "__import__ is unknown"),
        ("__import__('os').system('true')", 17, "'.' cannot stand here"),
        ("stereo.inliers.__class__", 1, "stereo has status"),
        ("stereo.inliers[0]", 15, "'[' cannot stand here"),
        ("(" * (DEEPEST + 1), DEEPEST + 2, f"nested more than {DEEPEST} deep"),
        ("not " * (DEEPEST + 1) + "monocular.key_frame", 4 * DEEPEST + 5, f"nested more than {DEEPEST} deep"),
        ("x" * (LONGEST + 1), LONGEST + 1, f"give at most {LONGEST}"),
        ("stereo.inliers < 3\n\x00", 20, "cannot stand here"),
    ],
)
def test_a_mistake_is_one_sentence_with_its_column(text: str, column: int, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(text, KNOWN)
    assert str(caught.value).startswith(f"column {column} of the expression: ") and said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_longest_chain_is_read() -> None:
    text = "stereo.scale < 1" + "+1" * ((LONGEST - 16) // 2)
    assert len(text) in (LONGEST - 1, LONGEST) and parse(text, KNOWN)


def test_the_longest_method_name_wins() -> None:
    """A method `a.b` beside a method `a` with a check `b`: `a.b.passed` is of the method."""
    assert parse("monocular.paper.key_frame", KNOWN).methods == {"monocular.paper"}


def test_a_method_with_a_hyphen_can_be_named() -> None:
    known = {"orb-slam.inliers": replace(KNOWN["stereo.inliers"], method="orb-slam")}
    found = parse("orb-slam.inliers - 1 < 2", known)
    assert found.quantities == tuple(known.values())


def test_what_it_speaks_of_is_listed_once_from_left_to_right() -> None:
    found = parse("abs(stereo.scale) < 1 or not (exposure == 3 and stereo.scale > 2)", KNOWN)
    assert [q.name for q in found.quantities] == ["stereo.scale", "exposure"] and found.methods == {"stereo", ""}
