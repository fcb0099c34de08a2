"""A signal ends a command in good order; what is sent again ends it at once."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from ispom_app.run import signals
from ispom_app.run.signals import terminable

NUMBERS = [signal.SIGINT, signal.SIGTERM]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_that_is_held_is_raised_when_files_are_closed(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "PATIENCE_S", -1.0)
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)), terminable() as got:
            got.hold()
            assert not got.overdue()
            signal.raise_signal(number)
            assert got.overdue()
            got.check()
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_sent_to_the_process_and_its_group_counts_once(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "REPEAT_S", 1e9)
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with terminable() as got:
            got.hold()
            signal.raise_signal(number)
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends no process by a signal")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_second_signal_ends_the_process_at_once(number: int) -> None:
    code = (
        "import signal, time\n"
        "from ispom_app.run import signals\n"
        "signals.REPEAT_S = -1.0\n"
        "signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
        "with signals.terminable() as got:\n"
        "    got.hold()\n"
        f"    signal.raise_signal({int(number)})\n"
        f"    signal.raise_signal({int(number)})\n"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == -number


def test_an_ignored_interrupt_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with terminable() as got:
            signal.raise_signal(signal.SIGINT)
            got.check()
    finally:
        signal.signal(signal.SIGINT, before)
