"""Lessons that are published: what the page is told at each step, and which of it only when the answer is revealed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.errors import InputError

from .read import data


def steps(site: Path) -> list[dict]:
    return data(site, "lesson-own")["steps"]


def test_a_lesson_that_cannot_be_made_is_refused_before_anything_is_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    built = []

    def without_a_package(config, methods, rig):
        built.append(methods)
        raise InputError("the package is missing")

    assert main(["publish", "scale", "--lessons", "--out", str(tmp_path / "site")], without_a_package) == 2
    assert len(built) == 1 and capsys.readouterr().err.startswith("ispom: lesson scale: the package is missing")


def test_each_step_is_asked_about_a_run_and_has_its_answer(lessons: Path) -> None:
    listed = data(lessons, "site")["listed"]
    assert [(each["name"], each["steps"]) for each in listed] == [("own", 4)]
    choose, number, point, draw = steps(lessons)
    assert [step["run"] for step in (choose, number, point, draw)] == ["own-1", "own-1", "own-2", "own-2"]
    assert choose["revealed"]["truth"] == [0] and choose["revealed"]["doubt"] == ""
    assert number["revealed"]["doubt"], "its claim does not hold"
    assert number["within"] == 1.0 and number["to"] == 8
    assert point["revealed"]["truth"] and point["asking"]["ask"]["image"].startswith("data:image")
    assert len(draw["revealed"]["truth"]) == len(draw["asking"]["ask"]["at"]) and draw["within"] == 0.6


def test_an_open_question_tells_nothing_of_its_answer(lessons: Path) -> None:
    for step in steps(lessons):
        asking, covered = step["asking"], step["covered"]
        assert asking["after"] is None and asking["truth"] is None and asking["phase"] == "asking"
        assert asking["covers"] == (covered is not None)
        if covered is not None:
            assert covered["message"]["methods"] == [] and covered["message"]["source"] == ""
            assert not covered["views"]["explain"]["cards"]
    assert steps(lessons)[3]["covered"] is None, "its tools stay open"


def test_numbers_up_to_a_frame_are_those_of_a_run_that_ends_there(lessons: Path) -> None:
    number = steps(lessons)[1]
    frames = data(lessons, "own-1/run")["plots"]["values"]["stereo.key_frame"]
    made = sum(value for frame, value in zip(*frames, strict=True) if frame <= 8 and value)
    assert number["revealed"]["truth"] == made < sum(filter(None, frames[1]))


def test_further_runs_are_branches_that_can_be_hidden(lessons: Path) -> None:
    choose, number = steps(lessons)[:2]
    assert choose["branches"] == ["branch:1"] and number["branches"] == []
    assert len(data(lessons, "own-1/run")["paths"]["branch:1"]) == 1
    assert "branch:1" not in data(lessons, "own-2/run")["paths"]


def test_a_run_is_named_without_its_place(lessons: Path) -> None:
    assert [data(lessons, f"own-{i}/run")["message"]["source"] for i in (1, 2)] == ["07", "07"]


def test_the_viewer_is_there_once(lessons: Path) -> None:
    assert len(list(lessons.rglob("viewer.js"))) == 1 and len(list(lessons.rglob("stage.bin"))) == 2


def test_the_same_lesson_gives_the_same_answers(lessons: Path, publish_lesson: Callable[[Path], Path]) -> None:
    again = publish_lesson(lessons.parent / "again")
    assert (again / "data" / "lesson-own.bin").read_bytes() == (lessons / "data" / "lesson-own.bin").read_bytes()


@pytest.mark.parametrize("words", [["nothing"], ["missing.md"]])
def test_an_unknown_lesson_is_refused_before_anything_is_written(
    words: list[str], publish: Callable[..., int], tmp_path: Path
) -> None:
    assert publish(*words, "--lessons", "--out", tmp_path / "site") == 2
    assert not (tmp_path / "site").exists()
