"""The first compilation goes on in another process, and is waited for."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest
from ispom_app.engine import warmup
from ispom_app.session import commands as do

from ispom import compiled_code
from ispom.methods import Config
from tests.app import helpers

MODERN = (("monocular",), Config())


def python(script: str) -> list[str]:
    return [sys.executable, "-c", script]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "_running", [])
    monkeypatch.setattr(warmup, "_failures", [])
    monkeypatch.setattr(compiled_code, "is_complete", lambda: False)


@pytest.mark.usefixtures("started")
def test_it_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMMAND", python("import sys; sys.stdin.read(1)"))
    warmup.start(*MODERN)
    warmup.start(*MODERN)
    (child,) = warmup._running
    assert not warmup.finished(0.01) and not warmup.finished()
    child.requests.write(b"x")
    child.requests.flush()
    assert warmup.finished(20) and not warmup._running and warmup.failure() is None


@pytest.mark.usefixtures("started")
def test_the_share_that_is_compiled_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMMAND", python("import sys; sys.stdin.read(1)"))
    assert warmup.message() == warmup.MESSAGE
    warmup.start(*MODERN)
    monkeypatch.setattr(warmup, "_share", lambda: 0.346)
    assert warmup.message() == f"{warmup.MESSAGE}: 35 % done"
    warmup._running[0].stop()
    assert warmup.message() == warmup.MESSAGE


@pytest.mark.usefixtures("started")
@pytest.mark.parametrize(
    "command",
    [[sys.executable, "-c", "import sys; sys.exit('no room for LLVM')"], ["no-such-program"]],
    ids=["fails", "does not start"],
)
def test_one_that_fails_is_over_reported_and_not_tried_again(
    monkeypatch: pytest.MonkeyPatch, command: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(warmup, "COMMAND", command)
    warmup.start(*MODERN)
    assert warmup.finished(20)
    assert ("no room for LLVM" if "-c" in command else "no-such-program") in (warmup.failure() or "")
    assert len(caplog.records) == 1
    warmup.start(*MODERN)
    assert not warmup._running


@pytest.mark.usefixtures("started")
def test_what_is_kept_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_code, "is_complete", lambda: True)
    warmup.start(*MODERN)
    assert not warmup._running and warmup.finished()


@pytest.mark.usefixtures("started")
def test_what_is_not_needed_is_not_compiled() -> None:
    warmup.start(("stereo.paper",), Config())
    assert not warmup._running


@pytest.mark.usefixtures("started")
def test_the_page_says_so_and_goes_on_after_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    over = threading.Event()
    monkeypatch.setattr(warmup, "finished", lambda wait_s=0.0: over.wait(wait_s))
    started_methods: list[tuple[str, ...]] = []
    session = helpers.started(tmp_path, compiling=lambda methods, config: started_methods.append(methods))
    try:
        helpers.wait_for(
            lambda: session.state.activity and warmup.MESSAGE in session.state.activity.text, "the message"
        )
        assert len(started_methods) == 1 and not session.history
        session.post(do.Play(False))
        helpers.wait_for(lambda: not session.state.playing, "a pause meanwhile")
        over.set()
        session.post(do.Play(True))
        helpers.wait_for(lambda: session.state.computed == session.state.total, "the end")
    finally:
        session.close(20.0)


@pytest.mark.usefixtures("started")
def test_the_first_start_shows_the_papers_methods_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMMAND", python("pass"))
    assert warmup.at_first(Config()) == "paper" and len(warmup._running) == 1
    assert warmup.finished(20)
    monkeypatch.setattr(compiled_code, "is_complete", lambda: True)
    assert warmup.at_first(Config()) == "modern"


@pytest.mark.parametrize("exposures", [20, 2000])  # the run has ended by then, or goes on
def test_the_page_reports_it_and_does_not_wait_where_nothing_needs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, exposures: int
) -> None:
    over = threading.Event()
    monkeypatch.setattr(warmup, "finished", lambda wait_s=0.0: over.is_set())
    session = helpers.started(tmp_path, f"double:{exposures}", variant="paper")
    try:
        helpers.wait_for(lambda: session.state.computed >= min(exposures, 100), "frames meanwhile")
        assert warmup.MEANWHILE in [n.text for n in session.state.notices]
        over.set()
        helpers.wait_for(lambda: warmup.READY in [n.text for n in session.state.notices], "the news")
    finally:
        session.close(20.0)


@pytest.mark.usefixtures("started")
def test_the_page_reports_one_that_failed_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(warmup, "COMMAND", python("import sys; sys.exit('no room for LLVM')"))
    session = helpers.started(tmp_path, compiling=warmup.start)
    try:
        helpers.wait_for(lambda: session.state.notices, "the failure")
        helpers.wait_for(lambda: session.state.computed == session.state.total, "the end")
        assert [n.text for n in session.state.notices] == [warmup.failure()] and not session.state.compiling
        assert "could not be compiled in advance" in (warmup.failure() or "")
    finally:
        session.close(20.0)
