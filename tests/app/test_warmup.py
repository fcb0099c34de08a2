"""The first compilation goes on in another process, and is waited for."""

from __future__ import annotations

import pytest
from ispom_app import warmup

from ispom.estimators import warm_up


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "_running", [])
    monkeypatch.setattr(warm_up, "compiled_before", lambda: False)


@pytest.mark.usefixtures("started")
def test_it_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMPILE", "import sys; sys.stdin.read(1)")
    monkeypatch.setattr(warmup.subprocess, "DEVNULL", warmup.subprocess.PIPE)
    warmup.start()
    warmup.start()
    (process,) = warmup._running
    assert not warmup.finished(0.01) and not warmup.finished()
    process.communicate(b"x", timeout=20)
    assert warmup.finished(20) and not warmup._running


@pytest.mark.usefixtures("started")
def test_one_that_fails_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "COMPILE", "raise SystemExit(3)")
    warmup.start()
    assert warmup.finished(20)


@pytest.mark.usefixtures("started")
def test_what_is_kept_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "compiled_before", lambda: True)
    warmup.start()
    assert not warmup._running and warmup.finished()
