"""Every mistake in an expression is one sentence with its place."""

from __future__ import annotations

from dataclasses import replace

import pytest
from ispom_app.engine.conditions.parser import DEEPEST, LONGEST, parse
from ispom_app.engine.history.quantities import quantities

from ispom.errors import InputError
from ispom.methods import names

KNOWN = quantities(names())


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("stero.inliers < 3", 1, "did you mean stereo.inliers?"),
        ("  stero.inliers < 3", 3, "did you mean stereo.inliers?"),
        ("true or monocular.paper.inlirs < 3", 1, "true is unknown"),
        ("monocular.paper.inlirs < 3", 1, "did you mean monocular.paper.inliers?"),
        ("stereo.qqqq > 1", 1, "stereo has status, key_frame"),
        ("qqqq > 1", 1, "names are METHOD.KEY"),
        ("stereo.status == 'lst'", 18, "stereo.status is never 'lst': give initialising or tracking or lost"),
        ("stereo.status", 1, "this is a text, where a condition is needed"),
        ("1 < 2", 1, "it names nothing that changes"),
        ("stereo.inliers < 1e999", 18, "is too large"),
        ("changed(increased(stereo.inliers))", 9, "cannot stand inside each other"),
        ("increased(stereo.status)", 11, "this is a text, where a number is needed"),
        ("stereo.status == monocular.inliers", 1, "a text with a number"),
        ("stereo.status < 'lost'", 1, "this is a text, where a number is needed"),
        ("stereo.inliers and monocular.key_frame", 1, "this is a number, where a condition is needed"),
        ("monocular.key_frame and stereo.inliers", 25, "this is a number, where a condition is needed"),
        ("monocular.key_frame & stereo.key_frame", 1, "use names such as"),
        ("stereo.inliers.__class__", 1, "stereo has status"),
        ("stereo.inliers ** 2 > 1", 1, "stereo.inliers ** 2 cannot stand here"),
        ("stereo.key_frame is True", 21, "cannot stand here"),
        ("stereo.inliers = 3", 16, "write =="),
        ("True", 1, "True cannot stand here"),
        ("stereo.status == u'lost'", 18, "cannot stand here"),
        ("stereo.status == 'lo' 'st'", 18, "cannot stand here"),
        ("stereo.status == 'lo\\163t'", 21, "cannot stand here"),
        ("-" * DEEPEST + "stereo.inliers > 1", DEEPEST, f"nested more than {DEEPEST} deep"),
        ("x" * (LONGEST + 1), LONGEST + 1, f"give at most {LONGEST}"),
        ("stereo.inliers < 3\n\x00", 20, "cannot stand here"),
        ("stereo.status == 'é'", 19, "cannot stand here"),
    ],
)
def test_a_mistake_is_one_sentence_with_its_column(text: str, column: int, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(text, KNOWN)
    assert str(caught.value).startswith(f"column {column} of the expression: ") and said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "__import__('os').system('true')",
        "().__class__.__bases__[0].__subclasses__()",
        "stereo.inliers[0]",
        "(lambda: stereo.key_frame)()",
        "[x for x in 'lost']",
        "(y := stereo.key_frame)",
        "f'{stereo.inliers}' == 'lost'",
        "changed(stereo.status, stereo.status)",
        "changed(*stereo.status)",
        "changed(of=stereo.status)",
        "changed stereo.status",
        "stereo.key_frame if stereo.key_frame else stereo.key_frame",
        "await stereo.key_frame",
        "stereo.key_frame; stereo.key_frame",
        "stereo.inliers = 3",
        "stereo.inliers < 30px",
        "(stereo.inliers < 3",
        "monocular.key_frame stereo.inliers",
        "stereo.status == 'lost",
        "monocular.key_frame && stereo.key_frame",
        "",
        "(" * LONGEST,
        "not " * (LONGEST // 4),
        "-" * LONGEST,
    ],
)
def test_nothing_else_is_accepted(text: str) -> None:
    with pytest.raises(InputError, match=r"column [1-9][0-9]* of the expression: "):
        parse(text, KNOWN)


def test_a_sum_of_many_terms_is_read() -> None:
    assert parse("stereo.scale < 1" + "+1" * (DEEPEST - 3), KNOWN)
    assert parse(" or ".join(["stereo.key_frame"] * 50), KNOWN)


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
