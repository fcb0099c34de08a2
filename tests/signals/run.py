"""One case: a command, a signal at a random moment, and what is wrong with how it ended."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from ispom_app.features.experiments.cluster import SCRATCH

from .commands import COMMANDS, Command, Inputs

MARK = "ISPOM_SIGNAL_CASE"
"""A variable in the environment of a case's processes: by it they are found again."""
AS_SHELLS_SAY = {signal.SIGINT: 130, signal.SIGTERM: 143}
"""Exit codes of a command that was ended by a signal. One that has not begun to handle signals dies of them."""
END_S = 60.0
"""A command that does not end within this time after its signal hangs."""
CHILDREN_END_S = 30.0
LOUD = ("Traceback", "Fatal Python error", "Segmentation", "SystemError", "Exception ignored", "resource_tracker")
TOLD_S = 0.7
"""Between two signals, of which the second one is another than the first one."""


@dataclass(frozen=True)
class Case:
    """What happens to a command."""

    name: str
    share: float
    """Of the time that it takes without a signal: when the signal comes."""
    number: signal.Signals
    to_group: bool
    """As a terminal's Ctrl-C, to all processes of the group; else to the command alone."""
    again_s: float | None
    """A second signal comes so much later; None for no second one."""

    def __str__(self) -> str:
        to = "its group" if self.to_group else "it"
        again = "" if self.again_s is None else f", again after {self.again_s:g} s"
        return f"{self.name}, {self.number.name} to {to} after {100 * self.share:.0f} %{again}"


def cases(count: int, seed: int, names: Sequence[str] = tuple(COMMANDS)) -> list[Case]:
    """Over all commands in turn."""
    chance = random.Random(seed)
    return [
        Case(
            names[i % len(names)],
            chance.random(),
            chance.choice([signal.SIGINT, signal.SIGTERM]),
            chance.random() < 0.5,
            chance.choice([None, None, None, 0.05, TOLD_S]),
        )
        for i in range(count)
    ]


def ispom(words: list[str], folder: Path, mark: str = "") -> subprocess.Popen[bytes]:
    """The program, begun in a process group of its own; what it prints goes to files of the folder."""
    scratch = folder / "scratch"
    scratch.mkdir(exist_ok=True)
    env = {**os.environ, MARK: mark, "TMPDIR": str(scratch)}
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as errors:
        command = [sys.executable, "-m", "ispom_app", *words]
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=errors, env=env, cwd=folder, start_new_session=True
        )


def duration_s(name: str, inputs: Inputs, folder: Path) -> float:
    """How long a command takes when nothing ends it. RuntimeError where it fails."""
    command = COMMANDS[name]
    command.prepare(inputs, folder)
    begun_s = time.monotonic()
    process = ispom(command.words(inputs, folder), folder)
    if process.wait() not in (0, 1):  # 1: `calibrate` asks for more images
        raise RuntimeError(f"{name} failed without a signal: {(folder / 'stderr').read_text()}")
    return time.monotonic() - begun_s


def fault(case: Case, inputs: Inputs, takes_s: float) -> str:
    """What is wrong with how the command ended; empty where nothing is."""
    with tempfile.TemporaryDirectory(prefix="signals-", ignore_cleanup_errors=True) as name:
        return "; ".join(_faults(case, COMMANDS[case.name], inputs, takes_s, Path(name)))


def _faults(case: Case, command: Command, inputs: Inputs, takes_s: float, folder: Path) -> Iterator[str]:
    command.prepare(inputs, folder)
    mark = folder.name
    begun_s = time.monotonic()
    process = ispom(command.words(inputs, folder), folder, mark)
    try:
        _wait_for_python(process)
        _wait_until(process, begun_s + case.share * takes_s)
        _send(process, case)
        if case.again_s is not None:
            _wait_until(process, time.monotonic() + case.again_s)
            _send(process, case)
        code = process.wait(END_S)
    except subprocess.TimeoutExpired:
        yield f"it still runs {END_S:g} s after the signal"
        code = None
    finally:
        survivors = _survivors(mark)
        process.kill()
        process.wait()
        for left in survivors:
            with suppress(psutil.NoSuchProcess):
                left.kill()
    if code not in (None, 0, 1, AS_SHELLS_SAY[case.number], -case.number):
        yield f"it ended with code {code}"
    errors = (folder / "stderr").read_text(errors="replace")
    if any(word in errors for word in LOUD) or (code in (1, 2) and errors.strip()):
        yield f"it printed {errors[-2000:]!r}"
    if survivors:
        yield f"still running {CHILDREN_END_S:g} s later: {survivors}"
    # A second signal ends the process at once; the next experiment removes its workers' folder then.
    forgiven = SCRATCH if case.again_s == TOLD_S else "nothing"
    if left := [path.name for path in (folder / "scratch").iterdir() if not path.name.startswith(forgiven)]:
        yield f"temporary files left: {left}"
    try:
        if wrong := command.fault(folder):
            yield wrong
    except Exception as error:
        yield f"its files cannot be read: {type(error).__name__}: {error}"


def _wait_for_python(process: subprocess.Popen[bytes]) -> None:
    """Until the program's first line: before it, Python itself prints a traceback for Ctrl-C, which nobody can change.

    Python's own handler of Ctrl-C makes way for the program's, which handles SIGTERM as well.
    """
    bit = 1 << (signal.SIGTERM - 1)
    while process.poll() is None:
        try:
            status = Path(f"/proc/{process.pid}/status").read_text()
        except OSError:
            return
        caught = next(int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigCgt"))
        if caught & bit:
            return
        time.sleep(0.001)


def _wait_until(process: subprocess.Popen[bytes], until_s: float) -> None:
    while process.poll() is None and (left_s := until_s - time.monotonic()) > 0:
        time.sleep(min(left_s, 0.01))


def _send(process: subprocess.Popen[bytes], case: Case) -> None:
    if process.poll() is not None:
        return
    if case.to_group:
        os.killpg(process.pid, case.number)
    else:
        process.send_signal(case.number)


def _survivors(mark: str) -> list[psutil.Process]:
    """Of the case's processes those that still run, after they had time to end."""
    until_s = time.monotonic() + CHILDREN_END_S
    while (found := _marked(mark)) and time.monotonic() < until_s:
        time.sleep(0.05)
    return found


def _marked(mark: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(MARK) == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            continue
    return found
