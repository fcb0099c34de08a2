"""Closing a run for another one: branches are not lost without a question, and settings stay with their run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from ispom_app.features.branches.commands import Fork
from ispom_app.features.lessons.commands import Learn
from ispom_app.features.lessons.library import Library
from ispom_app.features.lessons.state import Lessons
from ispom_app.features.recording.commands import OpenNamed, Record
from ispom_app.features.recording.state import Recordings
from ispom_app.session import commands as do
from ispom_app.session.branches.branches import Branch
from ispom_app.session.branches.service import BranchService
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.state import State
from ispom_app.session.store import Store

from ispom.methods import Config
from tests import doubles
from tests.app.helpers import started, wait_for

METHODS = ("monocular", "stereo", "integrated")
CHANGED = Config({"stereo": replace(Config().of("stereo"), max_tracks=321)})
LESSON = Library().lessons[0].name


def opener(source: str, options: object = None):
    return doubles.sequence(20)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """At the end of a fork with other methods and settings."""
    found = started(tmp_path, opener=opener)
    found.post(do.Speed(None))
    wait_for(lambda: found.state.ended, "the run")
    found.post(do.Seek(8))
    wait_for(lambda: found.state.index == 8, "frame 8")
    found.post(Fork(("stereo",), CHANGED, "fewer tracks"))
    wait_for(lambda: found.state[Branches].shown == 1 and found.state.ended, "the fork")
    yield found
    found.close(2)


OPENING = {
    "open": do.Open("double:15"),
    "the page's address, or a row of the recordings": OpenNamed("double:20"),
    "a lesson": Learn(LESSON),
}
CLOSING = {
    "restart": do.Restart(METHODS, Config()),
    "restart with fewer methods": do.Restart(("stereo",), Config()),
}


def asked(session: Session, command: do.Command) -> int:
    session.post(command)
    wait_for(lambda: session.state.question, "the question")
    assert session.state.question is not None and "fewer tracks" in session.state.question.text
    return session.state.question.number


@pytest.mark.parametrize("way", CLOSING)
def test_a_branch_is_not_lost_without_a_question(session: Session, way: str) -> None:
    run = session.state.run
    number = asked(session, CLOSING[way])
    session.post(do.Confirm(number, False))
    wait_for(lambda: session.state.question is None, "the answer")
    assert (session.state.run, len(session.state[Branches].all), session.state[Branches].shown) == (run, 2, 1)
    assert session.state[Lessons].now is None and not session.state.notices
    session.post(do.Confirm(number, True))  # of a question that was answered
    number = asked(session, CLOSING[way])
    session.post(do.Confirm(number, True))
    wait_for(lambda: session.state.run > run and len(session.state[Branches].all) == 1, "the other run")
    assert session.state.question is None


@pytest.mark.parametrize("way", OPENING)
def test_another_source_loses_no_branch_and_asks_nothing(session: Session, way: str) -> None:
    run, branches = session.state.run, session.service(BranchService)
    session.post(OPENING[way])
    wait_for(lambda: session.state.run > run or session.state.question, "the other run")
    assert session.state.question is None
    (kept,) = branches.kept
    assert [branch.name for branch in kept.branches][1:] == ["fewer tracks"] and len(kept.runs) == 2


def test_one_question_takes_the_place_of_the_one_before(session: Session) -> None:
    first, run = asked(session, CLOSING["restart with fewer methods"]), session.state.run
    session.post(CLOSING["restart"])
    wait_for(lambda: session.state.question and session.state.question.number != first, "the other question")
    session.post(do.Confirm(first, True))
    session.post(do.Confirm(first + 1, True))
    wait_for(lambda: session.state.run > run and len(session.state[Branches].all) == 1, "the other run")
    assert session.state.methods == METHODS


@pytest.mark.parametrize("command", [do.Open("double:15"), do.Restart(METHODS, Config())])
def test_a_run_without_branches_is_closed_without_a_question(tmp_path: Path, command: do.Command) -> None:
    session = started(tmp_path, opener=opener)
    wait_for(lambda: session.state.run == 1, "the run")
    session.post(command)
    wait_for(lambda: session.state.run == 2 or session.state.question, "the next run")
    assert session.state.question is None
    session.close(2)


def test_a_branch_that_is_recorded_is_kept(session: Session) -> None:
    session.post(Record("mine"))
    wait_for(lambda: session.state[Recordings].current or session.state[Recordings].listed, "the recording")
    session.post(do.Open("double:15"))
    wait_for(lambda: session.state.source == "double:15" or session.state.question, "the source")
    assert session.state.question is None


def lost(*branches: Branch, recorded: set[int] = frozenset()) -> list[str]:  # type: ignore[assignment]
    """What the service of the branches says would be lost."""
    state = State("double:20", phase="ready", computed=5).having(Branches(branches))
    session = SimpleNamespace(store=Store(state), kept_branches=frozenset(recorded))
    return BranchService(session).loss()  # type: ignore[arg-type]


def test_closing_needs_no_confirmation_for_what_can_be_had_again() -> None:
    first, fork = Branch(0, "first run"), Branch(1, "mine", 0, 4)
    assert not lost(first)
    assert "mine" in lost(first, fork)[0]
    assert not lost(first, replace(fork, reproducible=True))
    assert not lost(first, fork, recorded={1})
    assert "mine" in lost(fork)[0], "the first one was deleted"


def test_settings_and_methods_of_a_fork_or_a_restart_stay_with_their_run(session: Session) -> None:
    """They applied silently to whatever was opened next."""
    assert session.state.config == CHANGED and session.state.methods == ("stereo",)
    session.post(do.Confirm(asked(session, do.Restart(("stereo",), CHANGED)), True))
    wait_for(lambda: len(session.state[Branches].all) == 1 and session.state.ended, "the new run")
    assert session.state.config == CHANGED
    session.post(do.Open("double:15"))
    wait_for(lambda: session.state.source == "double:15" and session.state.phase == "ready", "the source")
    assert session.state.config == Config() and set(METHODS) <= set(session.state.methods)


def test_those_that_the_app_was_started_with_are_of_every_source(tmp_path: Path) -> None:
    session = started(tmp_path, opener=opener, config=CHANGED, methods=("stereo",))
    wait_for(lambda: session.state.run == 1, "the run")
    session.post(do.Restart(METHODS, Config()))
    wait_for(lambda: session.state.run == 2, "the restart")
    session.post(do.Open("double:15"))
    wait_for(lambda: session.state.source == "double:15" and session.state.phase == "ready", "the source")
    assert session.state.config == CHANGED and session.state.methods == ("stereo",)
    session.close(2)
