"""Lessons in a session: a step sets the page, keeps its answer out of reach, and reveals it by running."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from ispom_app.features.branches.commands import Fork
from ispom_app.features.breakpoints.commands import RunUntil
from ispom_app.features.layers.commands import Hide
from ispom_app.features.layers.state import Layers
from ispom_app.features.lessons.commands import EndLesson, Learn, Reveal, TurnTo
from ispom_app.features.lessons.library import Library
from ispom_app.features.lessons.state import Learning, Lessons
from ispom_app.features.plots.commands import Plot
from ispom_app.session import commands as do
from ispom_app.session.branches.service import BranchService
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.state import covered
from ispom_app.views.web.messages import message_of

from tests.app.helpers import started, wait_for
from tests.app.session.learning.lessons import LESSON


@pytest.fixture
def session(tmp_path) -> Iterator[Session]:
    found = started(tmp_path, "double:30", extras=(Library(LESSON, tmp_path / "lessons.json"),), autoplay=False)
    yield found
    found.close(5.0)


def at(session: Session, place: int, phase: str) -> Learning:
    def there() -> bool:
        lesson = session.state[Lessons].now
        return lesson is not None and (lesson.place, lesson.phase) == (place, phase)

    wait_for(there, f"step {place} {phase}")
    assert session.state[Lessons].now is not None
    return session.state[Lessons].now


def refused(session: Session, command: do.Command) -> str:
    before = session.state.notice_count
    session.post(command)
    wait_for(lambda: session.state.notice_count > before, f"a notice of {command}")
    return session.state.notices[-1].text


def test_a_step_shows_its_exposure_and_computes_no_further(session: Session):
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    state = session.state
    assert (state.index, state.computed, state[Layers].hidden, state.playing) == (5, 6, frozenset({"truth"}), False)
    assert state.source == "double:40" and set(state.methods) == {"stereo.paper", "monocular.paper"}


def test_what_would_answer_an_open_question_is_refused(session: Session):
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    config = session.state.config
    for command in (
        do.Play(True),
        do.Seek(6),
        do.StepBy(1),
        Hide(frozenset()),
        Plot("stereo.paper.inliers"),
        Fork(("stereo.paper",), config),
        do.Open("double:4"),
        RunUntil("exposure > 9"),
    ):
        assert "question" in refused(session, command)
    session.post(do.Seek(2))
    wait_for(lambda: session.state.index == 2, "a look back")
    assert session.state.computed == 6 and session.state[Layers].hidden == frozenset({"truth"})


def test_messages_to_pages_about_an_open_question_have_no_numbers_or_names_of_the_source(session: Session):
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    seen, message = covered(session.state), message_of(session.state)
    assert seen.displayed is not None and not seen.displayed.steps and not seen.displayed.errors_m
    assert message["methods"] == [] and message["name"] == "Stand-ins" and "double" not in str(message)
    assert any("plots" in path for path in message["hidden"]) and any("decisions" in path for path in message["hidden"])


def test_it_reveals_by_running_and_what_was_shown_is_shown_again(session: Session):
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    session.post(Reveal())
    found = at(session, 0, "revealed").revealed
    assert found is not None and found.values["error"] < 1e-6 and found.right == {0} and not found.broken
    assert found.values["poses"] == pytest.approx(3.0)
    state = session.state
    assert state[Branches].shown == 0 and [branch.name for branch in state[Branches].all] == ["first run", "other"]
    assert state.computed == state.total and not state[Layers].hidden and state[Lessons].progress == {"stand-ins": 1}
    assert message_of(state)["methods"] and covered(state) is state


def test_the_next_step_goes_on_with_the_same_run_and_the_lesson_where_it_was_left(session: Session):
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    session.post(Reveal())
    at(session, 0, "revealed")
    run = session.run
    session.post(TurnTo(1))
    at(session, 1, "asking")
    assert session.run is run and session.state.index == 8
    session.post(EndLesson())
    wait_for(lambda: session.state[Lessons].now is None, "the end of the lesson")
    session.post(Learn("stand-ins"))
    at(session, 1, "asking")


def test_a_text_that_says_otherwise_than_the_run_is_noticed(session: Session):
    session.post(Learn("stand-ins", 1))
    at(session, 1, "asking")
    session.post(Reveal())
    found = at(session, 1, "revealed").revealed
    assert found is not None and found.values["count"] == 30 and found.broken == ("count > 1000",)


def test_the_right_tracks_are_those_of_the_picture_for_which_the_condition_holds(session: Session):
    session.post(Learn("stand-ins", 2))
    learning = at(session, 2, "asking")
    assert learning.pictured is not None and learning.pictured[0] == 8
    session.post(Reveal())
    found = at(session, 2, "revealed").revealed
    tracks = learning.pictured[1]
    assert found is not None and found.right == set(tracks.ids[tracks.status >= 2].tolist())


def test_what_cannot_be_computed_is_reported_and_the_question_stays_open(session: Session):
    session.post(Learn("stand-ins", 4))
    at(session, 4, "asking")
    assert "stereo.paper" in refused(session, Reveal())
    assert at(session, 4, "asking").revealed is None


def test_the_run_before_a_lesson_stays_in_the_table_and_those_of_its_steps_do_not(session: Session):
    wait_for(lambda: session.state.phase == "ready", "the first run")
    before = session.run
    session.post(Learn("stand-ins"))
    at(session, 0, "asking")
    kept = session.service(BranchService).kept
    assert [each.source for each in kept] == ["double:30"] and kept[0].runs[0] is before
    session.post(TurnTo(1))
    at(session, 1, "asking")
    assert session.service(BranchService).kept == kept and session.state.question is None


def test_an_unknown_lesson_or_step_is_reported(session: Session):
    assert "no lesson 'none'" in refused(session, Learn("none"))
    assert "no step 9" in refused(session, Learn("stand-ins", 8))
    assert session.state[Lessons].now is None
