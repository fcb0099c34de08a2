"""A child process never outlives its parent, and its last words are kept."""

from __future__ import annotations

import subprocess
import sys

import psutil
import pytest

from ispom.child import KEPT_BYTES, Child

PARENT = """
import os, signal, sys
from ispom.child import Child
child = Child([sys.executable, *sys.argv[1:]])
child.answers.readline()
print(child.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
OWN = (
    "from ispom.child import end_with_parent; import time; end_with_parent(); print('up', flush=True); time.sleep(600)"
)


CTRL_C = """
import os, signal, sys, time
from ispom.child import Child
signal.signal(signal.SIGINT, lambda *_: None)
child = Child([sys.executable, "-c", "print('up', flush=True); input()"])
child.answers.readline()
os.killpg(0, signal.SIGINT)
print(child.wait(0.5), child.last_words(), flush=True)
child.stop()
"""


def python(script: str) -> Child:
    return Child([sys.executable, "-c", script])


def test_a_child_ends_when_its_parent_is_killed() -> None:
    command = [sys.executable, "-c", PARENT, "-c", OWN]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert_gone(int(done.stdout))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups")
def test_ctrl_c_in_a_terminal_does_not_come_to_a_child() -> None:
    command = [sys.executable, "-c", CTRL_C]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, process_group=0)
    assert (done.stdout.strip(), done.stderr) == ("False", "")


def test_the_end_of_what_it_says_is_kept() -> None:
    child = python(f"import sys; sys.stderr.write('x' * {3 * KEPT_BYTES} + '\\nlast'); sys.exit(3)")
    assert "exit code 3 (last)" in child.ending()
    assert len(child.last_words()) == KEPT_BYTES and not child.succeeded


def test_a_signal_is_named() -> None:
    child = python("import time; time.sleep(600)")
    psutil.Process(child.pid).kill()
    assert "SIGKILL" in child.ending() or sys.platform == "win32"
    child.stop()


def test_one_that_cannot_be_started_is_an_error() -> None:
    with pytest.raises(OSError, match="no-such-program"):
        Child(["no-such-program"])


def assert_gone(pid: int) -> None:
    try:
        psutil.Process(pid).wait(20)
    except psutil.NoSuchProcess:
        return
