"""The first compilation goes on in another process, and is waited for."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from ispom_app.run import warmup
from ispom_app.session import commands as do

from ispom.estimators import Config, warm_up
from tests.app import helpers

MODERN = Config(variant="modern")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "_running", [])
    monkeypatch.setattr(warm_up, "compiled_before", lambda: False)


@pytest.mark.usefixtures("started")
def test_it_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMPILE", "import sys; sys.stdin.read(1)")
    monkeypatch.setattr(warmup.subprocess, "DEVNULL", warmup.subprocess.PIPE)
    warmup.start(MODERN)
    warmup.start(MODERN)
    (process,) = warmup._running
    assert not warmup.finished(0.01) and not warmup.finished()
    process.communicate(b"x", timeout=20)
    assert warmup.finished(20) and not warmup._running


@pytest.mark.usefixtures("started")
def test_one_that_fails_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMPILE", "raise SystemExit(3)")
    warmup.start(MODERN)
    assert warmup.finished(20)


@pytest.mark.usefixtures("started")
def test_what_is_kept_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "compiled_before", lambda: True)
    warmup.start(MODERN)
    assert not warmup._running and warmup.finished()


@pytest.mark.usefixtures("started")
def test_what_is_not_needed_is_not_compiled() -> None:
    warmup.start(Config(variant="paper"))
    assert not warmup._running


@pytest.mark.usefixtures("started")
def test_the_page_says_so_and_goes_on_after_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    over = threading.Event()
    monkeypatch.setattr(warmup, "finished", lambda wait_s=0.0: over.wait(wait_s))
    asked: list[Config] = []
    session = helpers.started(tmp_path, compiling=asked.append)
    try:
        helpers.wait_for(
            lambda: session.state.activity and session.state.activity.text == warmup.MESSAGE, "the message"
        )
        assert len(asked) == 1 and not session.history
        session.post(do.Play(False))
        helpers.wait_for(lambda: not session.state.playing, "a pause meanwhile")
        over.set()
        session.post(do.Play(True))
        helpers.wait_for(lambda: session.state.computed == session.state.total, "the end")
    finally:
        session.close(20.0)


@pytest.mark.usefixtures("started")
def test_the_first_start_shows_the_papers_methods_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMPILE", "pass")
    assert warmup.at_first(MODERN).variant == "paper" and len(warmup._running) == 1
    assert warmup.finished(20)
    monkeypatch.setattr(warm_up, "compiled_before", lambda: True)
    assert warmup.at_first(MODERN).variant == "modern"


@pytest.mark.parametrize("exposures", [20, 2000])  # the run has ended by then, or goes on
def test_the_page_tells_of_it_and_does_not_wait_where_nothing_needs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, exposures: int
) -> None:
    over = threading.Event()
    monkeypatch.setattr(warmup, "finished", lambda wait_s=0.0: over.is_set())
    session = helpers.started(tmp_path, f"double:{exposures}", config=Config(variant="paper"))
    try:
        helpers.wait_for(lambda: session.state.computed >= min(exposures, 100), "exposures meanwhile")
        assert warmup.MEANWHILE in [n.text for n in session.state.notices]
        over.set()
        helpers.wait_for(lambda: warmup.READY in [n.text for n in session.state.notices], "the news")
    finally:
        session.close(20.0)
