"""A signal ends a command in good order; what is sent again ends it at once."""

from __future__ import annotations

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from ispom_app.engine import signals
from ispom_app.engine.signals import terminable

from ispom.stop import check_stop

NUMBERS = [signal.SIGINT, signal.SIGTERM]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_deferred_signal_is_raised_when_files_are_closed(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
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
        with pytest.raises((KeyboardInterrupt, SystemExit)), terminable() as got:
            got.hold()
            signal.raise_signal(number)
            signal.raise_signal(number)  # does not end the process
    finally:
        signal.signal(number, before)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends no process by a signal")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_second_signal_ends_the_process_at_once(number: int) -> None:
    code = (
        "import signal, time\n"
        "from ispom_app.engine import signals\n"
        "signals.REPEAT_S = -1.0\n"
        "signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
        "with signals.terminable() as got:\n"
        "    got.hold()\n"
        f"    signal.raise_signal({int(number)})\n"
        f"    signal.raise_signal({int(number)})\n"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 128 + number


@pytest.mark.parametrize("number", NUMBERS)
def test_a_handler_raises_nothing_and_the_next_look_does(number: int) -> None:
    """An exception of a handler may come in the middle of compiled code, and crashes the process there."""
    before = signal.signal(number, signal.SIG_DFL)
    passed = []
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)), terminable():
            signal.raise_signal(number)
            passed.append("the handler")
            check_stop()
            passed.append("the look")
    finally:
        signal.signal(number, before)
    assert passed == ["the handler"]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_that_nobody_looked_for_is_raised_at_the_end(number: int) -> None:
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)), terminable():
            signal.raise_signal(number)
        with terminable():
            check_stop()  # the next command begins without it
    finally:
        signal.signal(number, before)


def test_a_command_inside_another_one_sees_the_signal_of_that_one() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    begun = []
    try:
        with pytest.raises(KeyboardInterrupt), terminable():
            signal.raise_signal(signal.SIGINT)
            with terminable():
                begun.append("the inner command")
    finally:
        signal.signal(signal.SIGINT, before)
    assert not begun


def test_nothing_is_raised_while_files_are_closed_and_in_other_threads() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        with pytest.raises(KeyboardInterrupt), terminable() as got:
            signal.raise_signal(signal.SIGINT)
            with ThreadPoolExecutor(1) as pool:
                pool.submit(check_stop).result()
            got.hold()
            check_stop()
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_first_interrupt_ends_a_live_source_and_the_second_one_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "REPEAT_S", -1.0)
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    ended: list[str] = []
    try:
        with pytest.raises(KeyboardInterrupt), terminable() as got, got.first_ends(lambda: ended.append("recording")):
            for _ in range(2):
                signal.raise_signal(signal.SIGINT)
                check_stop()
                ended.append("a frame")
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == ["recording", "a frame"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends no process by a signal")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_during_imports_ends_the_command_without_a_word(number: int) -> None:
    code = (
        "import signal, sys\n"
        f"signal.signal({int(signal.SIGINT)}, signal.default_int_handler)\n"
        "class Sending:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'ispom_app.cli.main':\n"
        f"            signal.raise_signal({int(number)})\n"
        "sys.meta_path.insert(0, Sending())\n"
        "from ispom_app.__main__ import main\n"
        "sys.exit(main())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, b"", b"")


def test_an_ignored_interrupt_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with terminable() as got:
            signal.raise_signal(signal.SIGINT)
            got.check()
    finally:
        signal.signal(signal.SIGINT, before)
