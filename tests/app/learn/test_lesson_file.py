"""Lessons as files: what they say, and one sentence with its place for each mistake."""

from __future__ import annotations

import re

import pytest
from ispom_app.features.lessons.lesson import Choose, Fact, Number
from ispom_app.features.lessons.lesson_file import read_lesson
from ispom_app.features.lessons.library import ORDER, Library, built_in, own_lesson
from ispom_app.features.lessons.page_message import html

from ispom.errors import InputError

LESSON = """---
title: A title
minutes: 5
source: sim:tiny
methods: [stereo.paper]
---
About it.

## First

Which?

```step
at: 10
hidden: [truth]
choose:
  Small: error < 1
  Large: error >= 1
runs:
  other: {settings: {stereo.paper: {max_points: 100}}}
values:
  error: ate_m(this, stereo.paper, se3)
  worse: ate_m(other, stereo.paper, se3)
  ratio: worse / error
claims: [ratio > 1]
```

It is {error:.2f} m.

## Second

How large?

```step
number: {value: twice, unit: m, within: 0.1}
values:
  error: ate_m(this, stereo.paper, se3)
  twice: 2 * error
```

{twice:.1f}.
"""


def test_a_lesson_is_what_its_file_says():
    lesson = read_lesson("mine", LESSON)
    first, second = lesson.steps
    assert (lesson.name, lesson.title, lesson.minutes, lesson.about) == ("mine", "A title", 5, "About it.")
    assert (first.title, first.before, first.after) == ("First", "Which?", "It is {error:.2f} m.")
    assert isinstance(first.ask, Choose) and [option.text for option in first.ask.options] == ["Small", "Large"]
    assert first.values["worse"] == Fact("ate_m", "other", ("stereo.paper", "se3"))
    assert first.runs["other"].config.of("stereo.paper").max_points == 100
    assert first.own.config.of("stereo.paper").max_points == 3000 and first.runs["other"].source == "sim:tiny"
    assert isinstance(second.ask, Number) and (second.ask.unit, second.at, second.to) == ("m", 0, None)


@pytest.mark.parametrize(
    ("wrong", "right", "words"),
    [
        ("---\ntitle", "title", "has no front matter: begin it with"),
        ("title: A title\n", "", "front matter: Object missing required field `title`"),
        ("minutes: 5", "minutes: five", "front matter: Expected `int`, got `str` - at `$.minutes`"),
        ("minutes: 5", "minutes: [", "front matter: its YAML line 4 is not valid YAML"),
        ("minutes: 5", "minutes: 5\nlevel: 3", "front matter: Object contains unknown field `level`"),
        ("[stereo.paper]", "[stero]", "'stero' is no method"),
        ("```step\nat", "```\nat", "step 1 has 0 blocks ```step"),
        ("at: 10", "at: ten", "step 1: Expected `int`"),
        ("max_points: 100", "max_points: 1", "--stereo.paper.max-points is 1, give a value from 50"),
        ("max_points: 100", "most: 1", "step 1, run other: settings.stereo.paper has 'most', which is no setting"),
        ("ate_m(this, s", "ate(this, s", "step 1: there is no function ate: choose from"),
        ("ate_m(other, stereo.paper, se3)", "ate_m(other)", "ate_m takes (RUN, METHOD, ALIGNMENT)"),
        ("ate_m(other,", "ate_m(third,", "ate_m is asked of the run 'third': choose from this, other"),
        ("worse / error", "worse / eror", "step 1: 'worse / eror': column 9 of the expression: eror is unknown"),
        ("worse / error", "worse > error", "where a number is needed"),
        ("Small: error < 1", "Small: error", "this is a number, where a condition is needed"),
        ("{error:.2f}", "{eror:.2f}", "step 1: {eror:.2f} is no value with a format"),
        ("{error:.2f}", "{error.real}", "is no value with a format"),
        ("{error:.2f}", "{error:.2f", "a brace too many or too few"),
        ("value: twice", "value: thrice", "'thrice', which is asked for, is none of the step's values"),
        ("number: {value: twice, unit: m, within: 0.1}\n", "", "step 2 asks 0 questions: give one of"),
    ],
)
def test_a_mistake_in_a_file_is_one_sentence_with_its_place(wrong: str, right: str, words: str):
    text = LESSON.replace(wrong, right, 1)
    assert text != LESSON
    with pytest.raises(InputError, match=re.escape(words)) as error:
        read_lesson("mine", text)
    assert "\n" not in str(error.value)


def test_html_in_a_lesson_is_text():
    assert html("<script>alert(1)</script> **bold**") == (
        "<p>&lt;script&gt;alert(1)&lt;/script&gt; <strong>bold</strong></p>\n"
    )


def test_all_lessons_that_come_with_it_can_be_read_and_last_five_to_ten_minutes():
    assert tuple(lesson.name for lesson in built_in()) == ORDER and len(ORDER) >= 10
    assert all(5 <= lesson.minutes <= 10 and len(lesson.steps) >= 3 for lesson in built_in())


def test_a_file_of_ones_own_comes_first(tmp_path):
    path = tmp_path / "mine.md"
    path.write_text(LESSON)
    own = own_lesson(str(path))
    assert own is not None and Library(own).lessons[0].name == "mine" and Library(own).lesson("mine") is own
    with pytest.raises(InputError, match="'none': choose from mine, scale"):
        Library(own).lesson("none")


def test_progress_is_kept_and_never_goes_back(tmp_path):
    path = tmp_path / "ispom" / "lessons.json"
    Library(progress=path).progress.reached("scale", 2)
    again = Library(progress=path).progress
    assert again.steps == {"scale": 2}
    assert again.reached("scale", 1) == {"scale": 2} and again.reached("clock", 1) == {"scale": 2, "clock": 1}
    path.write_text("{damaged")
    assert Library(progress=path).progress.steps == {}


NEST = "l0: &l0 [x]\n" + "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 12))
HOSTILE = {
    "aliases": NEST,
    "deep": "values: " + "[" * 5000,
    "a wrong tag": "at: !!int ''",
    "a timestamp": "at: !!timestamp x",
    "digits": "at: " + "9" * 5000,
    "itself": "values: &a [*a]",
    "a name twice": "at: 1\nat: 2",
    "not text": "? [1, 2]\n: 3",
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("where", ["front", "step"])
@pytest.mark.parametrize("what", HOSTILE)
def test_yaml_that_stands_for_too_much_is_one_sentence(where: str, what: str) -> None:
    line = "minutes: 5\n" if where == "front" else "at: 10\n"
    with pytest.raises(InputError, match="lesson mine") as caught:
        read_lesson("mine", LESSON.replace(line, f"{HOSTILE[what]}\n"))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


@pytest.mark.timeout(60)
def test_blocks_without_an_end_are_counted_once() -> None:
    with pytest.raises(InputError, match="blocks ```step"):
        read_lesson("mine", LESSON + "```step\n" * 30_000)
