"""Moves by kind of frame and the loop, in a session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.session import commands as do
from ispom_app.session.session import Session
from ispom_app.session.state import Loop

from tests.app.helpers import paused_session, wait_for

LAST = 43


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with paused_session(tmp_path, "double:40") as session:
        yield session


def goes(session: Session, command: do.Command, index: int) -> None:
    session.post(command)
    wait_for(lambda: session.state.index == index and session.state.target is None, f"frame {index}")
    assert not session.state.playing


def told(session: Session, command: do.Command) -> str:
    """The kind of the notice that answers the command."""
    count = session.state.notice_count
    session.post(command)
    wait_for(lambda: session.state.notice_count > count, "a notice")
    return session.state.notices[-1].kind


def stereo(session: Session) -> list[int]:
    assert session.run is not None
    return [i for i, kind in enumerate(session.run.playback.sequence.kinds) if kind == "stereo"]


def test_it_steps_from_stereo_exposure_to_stereo_exposure_and_computes_up_to_there(session: Session) -> None:
    pairs = stereo(session)
    for index in pairs:
        goes(session, do.StepTo("stereo"), index)
    assert session.state.computed == pairs[-1] + 1
    assert told(session, do.StepTo("stereo")) == "info"
    for index in pairs[-2::-1]:
        goes(session, do.StepTo("stereo", forwards=False), index)
    assert told(session, do.StepTo("stereo", forwards=False)) == "info"


def test_it_steps_to_the_exposures_at_which_any_method_made_a_key_frame(session: Session) -> None:
    goes(session, do.Seek(30), 30)
    found = [r.index for r in session.history if any(step.key_frame for step in r.steps)]
    assert len(found) > 4 and any(i not in stereo(session) for i in found)
    for index in found[-2::-1] if found[-1] == 30 else found[::-1]:
        goes(session, do.StepTo("key_frame", forwards=False), index)
    assert told(session, do.StepTo("key_frame", forwards=False)) == "info"
    for index in found[1:]:
        goes(session, do.StepTo("key_frame"), index)
    session.post(do.StepTo("key_frame"))
    wait_for(lambda: session.state.index > 30 and session.state.target is None, "one that was not computed yet")
    last = session.history.last
    assert last is not None and session.state.index == last.index and any(step.key_frame for step in last.steps)


def test_start_and_end(session: Session) -> None:
    goes(session, do.Seek(12), 12)
    goes(session, do.Seek(0), 0)
    goes(session, do.GoToEnd(), 12)


def test_playing_goes_round_in_the_loop_until_it_is_taken_away(session: Session) -> None:
    goes(session, do.Seek(12), 12)
    session.post(do.LoopEdge("start"))
    goes(session, do.Seek(16), 16)
    session.post(do.LoopEdge("end"))
    wait_for(lambda: session.state.loop == Loop(12, 16), "the loop")
    shown: list[int] = []
    session.changes.add(lambda: shown.append(session.state.index))
    session.post(do.Speed(None))
    session.post(do.Play(True))
    wait_for(lambda: shown.count(12) > 20, "the second round")
    session.post(do.NoLoop())
    wait_for(lambda: session.state.ended and not session.state.playing, "the end")
    until = shown.index(17)
    assert set(shown[:until]) == set(range(12, 17)) and session.state.index == LAST


def test_a_loop_without_an_end_goes_round_at_the_end_of_the_run(session: Session) -> None:
    goes(session, do.Seek(40), 40)
    session.post(do.LoopEdge("start"))
    shown: list[int] = []
    session.changes.add(lambda: shown.append(session.state.index))
    session.post(do.Speed(None))
    session.post(do.Play(True))
    wait_for(lambda: LAST in shown and 41 in shown[shown.index(LAST) :], "another round")
    assert session.state.ended and session.state.playing and min(shown) == 40


def test_an_edge_beyond_the_other_begins_another_loop_and_one_exposure_is_none(session: Session) -> None:
    for at, edge, loop in ((20, "end", Loop(0, 20)), (25, "start", Loop(25)), (10, "end", Loop(0, 10))):
        goes(session, do.Seek(at), at)
        session.post(do.LoopEdge(edge))  # type: ignore[arg-type]
        wait_for(lambda loop=loop: session.state.loop == loop, "the loop")
    goes(session, do.Seek(0), 0)
    assert told(session, do.LoopEdge("end")) == "error"
    goes(session, do.Seek(LAST), LAST)
    assert told(session, do.LoopEdge("start")) == "error"


def test_a_loop_of_two_given_frames_stays_within_the_run(session: Session) -> None:
    for given, loop in (((12, 16), Loop(12, 16)), ((-3, LAST + 9), Loop(0, LAST)), ((40, None), Loop(40))):
        session.post(do.SetLoop(*given))
        wait_for(lambda loop=loop: session.state.loop == loop, "the loop")
    assert told(session, do.SetLoop(16, 16)) == "error"


def test_another_source_has_no_loop(session: Session) -> None:
    goes(session, do.Seek(5), 5)
    session.post(do.LoopEdge("end"))
    wait_for(lambda: session.state.loop is not None, "the loop")
    session.post(do.Open("double:30"))
    wait_for(lambda: session.state.total == 33, "the other source")
    assert session.state.loop is None
