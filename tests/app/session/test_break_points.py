"""Break points in the session: run until a condition, and find it in what is computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.features.bookmarks.commands import ToggleBookmark
from ispom_app.features.branches.commands import Fork
from ispom_app.features.breakpoints.commands import FindMatch, RunUntil
from ispom_app.features.events.commands import StepToEvent
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session

from ispom.methods import Config
from tests.alone import METHODS
from tests.app.helpers import build_full, paused_session, wait_for

LOST = 'monocular.status == "lost"'


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with paused_session(tmp_path, "double:40", builder=build_full) as session:
        yield session


def asked(session: Session, command: do.Command) -> str:
    """The notice that it ends with."""
    count = session.state.notice_count
    session.post(command)
    wait_for(lambda: session.state.notice_count > count and session.state.target is None, "a notice")
    return session.state.notices[-1].text


def lost(session: Session) -> list[int]:
    return [r.index for r in session.history for s in r.steps if s.method == "monocular" and s.status == "lost"]


def test_it_runs_on_to_each_exposure_at_which_the_condition_holds(session: Session) -> None:
    text = asked(session, RunUntil(LOST))
    first = session.state.index
    assert lost(session) == [first] and session.state.computed == first + 1 and not session.state.playing
    assert text == f"stopped at frame {first}: monocular.status lost"
    asked(session, RunUntil(LOST))
    assert lost(session) == [first, session.state.index] and session.state.index > first


def test_what_is_computed_already_is_not_computed_again(session: Session) -> None:
    asked(session, RunUntil(LOST))
    first, computed = session.state.index, session.state.computed
    session.post(do.Seek(0))
    wait_for(lambda: session.state.index == 0, "the start")
    asked(session, RunUntil(LOST))
    assert (session.state.index, session.state.computed) == (first, computed)


def test_next_and_previous_match(session: Session) -> None:
    session.post(do.Seek(40))
    wait_for(lambda: session.state.computed == 41, "exposure 40")
    found = lost(session)
    assert len(found) >= 2
    session.post(FindMatch(LOST, forwards=False))
    wait_for(lambda: session.state.index == found[-1], "the last one")
    session.post(FindMatch(LOST, forwards=False))
    wait_for(lambda: session.state.index == found[-2], "the one before")
    session.post(FindMatch(LOST))
    wait_for(lambda: session.state.index == found[-1], "the last one again")
    assert "no computed frame" in asked(session, FindMatch(LOST))


def test_a_condition_that_never_holds_is_reported_at_the_end(session: Session) -> None:
    assert "held at no frame" in asked(session, RunUntil("stereo.error_m > 1e6"))
    assert session.state.ended
    assert "no frame after" in asked(session, RunUntil("stereo.error_m > 1e6"))


@pytest.mark.parametrize(
    ("condition", "sentence"),
    [("", "there is no condition"), ("stereo.sattus == 3", "column 1"), ("__import__('os')", "column 1")],
)
def test_a_mistake_is_a_sentence(session: Session, condition: str, sentence: str) -> None:
    assert sentence in asked(session, RunUntil(condition)) and session.state.computed == 0


def test_another_move_ends_the_search(session: Session) -> None:
    session.post(RunUntil("stereo.error_m > 1e6"))
    session.post(do.Seek(3))
    session.post(do.Seek(30))
    wait_for(lambda: session.state.index >= 30 and session.state.target is None, "exposure 30")
    assert session.state.until is None and not session.state.notices


def test_it_runs_on_to_the_next_event_and_says_in_words_what_happened(session: Session) -> None:
    text = asked(session, StepToEvent(alarming=True))
    first = session.state.index
    found = [e for e in (session.run.events.events if session.run else ()) if e.severity.alarming]
    assert [e.frame for e in found] == [first] and session.state.computed == first + 1 and not session.state.playing
    assert text.startswith(f"Frame {first} · ") and found[0].sentence in text and "==" not in text
    asked(session, StepToEvent(alarming=True))
    second = session.state.index
    assert second > first
    asked(session, StepToEvent(forwards=False, alarming=True))
    assert session.state.index == first and session.state.computed == second + 1


def test_the_end_of_the_events_is_reported_with_their_number(session: Session) -> None:
    session.post(do.Seek(43))
    wait_for(lambda: session.state.computed == 44, "the end")
    text = asked(session, StepToEvent())
    assert text.startswith("No event after frame 43.") and "earlier" in text
    assert session.state.index == 43
    session.post(ToggleBookmark())
    session.post(do.Seek(42))
    session.post(StepToEvent())
    wait_for(lambda: session.state.index == 43, "the bookmark")


def test_a_run_that_ends_without_another_event_says_so(session: Session) -> None:
    session.post(do.Seek(40))
    wait_for(lambda: session.state.computed == 41, "exposure 40")
    while not (text := asked(session, StepToEvent(alarming=True))).startswith("No problem after"):
        assert text.startswith("Frame ")
    assert session.state.ended and session.state.until is None


def test_a_fork_and_its_parent_have_the_same_events_before_it(session: Session) -> None:
    session.post(do.Seek(43))
    wait_for(lambda: session.state.computed == 44 and session.state.index == 43, "the end")
    parent = session.run
    session.post(do.Seek(20))
    wait_for(lambda: session.state.index == 20, "exposure 20")
    session.post(Fork(METHODS, Config()))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.computed == 44, "the fork")
    fork = session.run
    assert parent is not None and fork is not None and fork.events is not parent.events
    assert fork.events.events == parent.events.events and len(fork.events) > 2


def test_a_fork_has_the_quantities_of_its_past(session: Session) -> None:
    session.post(do.Seek(30))
    wait_for(lambda: session.state.index == 30, "exposure 30")
    first = session.run
    assert first is not None
    session.post(do.Seek(20))
    wait_for(lambda: session.state.index == 20, "exposure 20")
    session.post(Fork(METHODS, Config()))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.computed == 44, "the fork")
    fork = session.run
    assert fork is not None and fork is not first
    for name in first.series.quantities:
        if not name.endswith(".seconds"):
            a, b = (run.series.values(name)[:31] for run in (first, fork))
            assert a.tobytes() == b.tobytes(), name
