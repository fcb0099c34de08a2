"""Where a command reads a run that was killed: the run is finished first, if a person says so."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from ispom.errors import InputError, printable

from ...engine.run_folder.run_folder import locked
from ...engine.signals import terminable
from .repair_command import repair_run

YES = ("y", "yes")


def finish_first(folders: Iterable[Path], allowed: bool) -> None:
    """Finishes these unfinished runs, and says on standard error what was done: all of them where that is `allowed`,
    or else those for which a person on the terminal says yes. The others stay as they are.

    Raises InputError where there is nobody to ask, where another process writes to a run, and where one cannot be
    finished. A signal ends it between two files.
    """
    for folder in folders:
        if allowed or _wanted(folder):
            _finish(folder)


def _finish(folder: Path) -> None:
    try:
        with terminable():
            lines, problems = repair_run(folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be repaired ({error.strerror}): see to its permissions") from None
    sys.stderr.write("".join(f"{printable(line)}\n" for line in lines))
    if problems:
        raise InputError("; ".join(problems))


def _wanted(folder: Path) -> bool:
    """What a person says. False, without a question, where this user cannot write to the folder."""
    try:
        with locked(folder):
            pass
    except OSError:
        return False
    if not all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr)):
        raise InputError(
            f"{folder} holds a run that was killed: add --repair, which finishes its files first, as far as it came"
        )
    sys.stderr.write(printable(f"{folder} holds a run that was killed. Repair it now? [y/N]") + " ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in YES
