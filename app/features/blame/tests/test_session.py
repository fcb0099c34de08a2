"""Asking in the page: the answer is of the frame shown, and the run stays where it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.features.blame.commands import AskBlame
from ispom_app.features.blame.state import Blames
from ispom_app.session import commands as do
from ispom_app.session.session import Session

from ispom.ensemble import build
from ispom.sequences import open_sequence
from tests.app.helpers import started, wait_for

AT = 12
"""The second stereo frame."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder: Path = tmp_path_factory.mktemp("blame")
    found = started(
        folder, "sim:tiny", opener=lambda source, _=None: open_sequence(source), builder=build,
        methods=("stereo",), autoplay=False,
    )  # fmt: skip
    wait_for(lambda: found.state.phase == "ready", "opening")
    yield found
    found.close(5.0)


def test_before_a_frame_is_shown_nothing_is_answered(session: Session) -> None:
    session.post(AskBlame())
    wait_for(lambda: session.state.notices, "the refusal")
    assert not session.state[Blames].found


def test_the_answer_is_of_the_frame_shown(session: Session) -> None:
    session.post(do.Seek(AT + 3))
    wait_for(lambda: session.state.displayed is not None and session.state.displayed.index == AT + 3, "frames", 60.0)
    session.post(do.Seek(AT))
    wait_for(lambda: session.state.displayed is not None and session.state.displayed.index == AT, "the frame")
    computed = session.state.computed
    session.post(AskBlame())
    wait_for(lambda: session.state[Blames].at(session.state).found, "the answer", 60.0)
    (found,) = session.state[Blames].at(session.state).found
    assert found.method == "stereo" and found.index == AT and found.listed()
    assert session.state.computed == computed and session.state.activity is None
    session.post(do.Seek(AT + 1))
    wait_for(lambda: session.state.displayed is not None and session.state.displayed.index == AT + 1, "the next")
    assert not session.state[Blames].at(session.state).found
    session.post(AskBlame())
    wait_for(lambda: session.state[Blames].at(session.state).found, "the answer", 60.0)
    asked = session.state[Blames].at(session.state)
    assert asked.found[0].index == AT and not asked.doing, "between two pairs, of the newest one"


def test_a_method_without_an_answer_has_a_reason(session: Session) -> None:
    session.post(do.Seek(1))
    wait_for(lambda: session.state.index == 1, "the frame")
    asked = session.state[Blames]
    session.post(AskBlame())
    wait_for(lambda: (now := session.state[Blames]) is not asked and not now.doing, "the answer", 60.0)
    now = session.state[Blames].at(session.state)
    assert [method for method, _ in now.silent] == ["stereo"] and not now.found
