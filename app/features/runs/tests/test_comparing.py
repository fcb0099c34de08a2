"""Comparing two runs of the table, as the session does it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.features.branches.commands import Fork
from ispom_app.features.branches.state import Branches
from ispom_app.features.runs.commands import CompareRuns, OpenSource
from ispom_app.session import commands as do
from ispom_app.session.session import Session

from ispom.methods import Config
from tests.alone import METHODS
from tests.app.helpers import started, wait_for


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    found = started(tmp_path, "", autoplay=False)
    yield found
    assert found.close(5.0)


def opened(session: Session) -> None:
    session.post(OpenSource(" double:20 "))
    wait_for(lambda: session.state.phase == "ready", "the source")


def test_a_session_without_a_source_waits_and_says_what_cannot_be_opened(session: Session) -> None:
    assert session.state.phase == "empty" and session.run is None
    session.post(OpenSource("  "))
    wait_for(lambda: session.state.notice_count == 1, "the sentence")
    session.post(OpenSource("double:none"))
    wait_for(lambda: session.state.notice_count == 2, "the next sentence")
    assert session.state.phase == "empty" and session.run is None
    opened(session)
    wait_for(lambda: session.state.playing or session.state.ended, "playing")


def test_a_run_that_stopped_at_the_fork_is_computed_as_far_as_the_fork_and_compared(session: Session) -> None:
    opened(session)
    session.post(do.Seek(5))
    wait_for(lambda: session.state.index == 5 and session.state.target is None, "the frame to fork at")
    session.post(Fork(METHODS, Config()))
    session.post(do.Seek(12))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.computed == 13, "the fork")
    session.post(CompareRuns("live:0", "live:1"))
    wait_for(lambda: (c := session.state[Branches].comparison) is not None and c.finished, "the comparison")
    comparison = session.state[Branches].comparison
    assert comparison is not None
    assert (comparison.shown, comparison.other, comparison.start, comparison.stop) == (0, 1, 6, 13)
    assert session.state[Branches].shown == 0 and session.state.computed >= 13


def test_a_run_that_is_gone_cannot_be_compared(session: Session) -> None:
    opened(session)
    session.post(CompareRuns("live:0", "live:7"))
    wait_for(lambda: session.state.notices, "the sentence")
    assert session.state[Branches].comparison is None
