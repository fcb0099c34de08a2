"""The door by which runs are written to a folder, read and shown: the program that writes run folders stands behind
it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ispom.registry import Registry


@dataclass(frozen=True)
class RunFolders:
    """How runs are kept in folders, and shown in a cell of a notebook."""

    name: str
    save: Callable[[Any, Path], Path]
    """Writes a Run into a new or empty folder. Raises InputError."""
    read: Callable[[Path, str | None], Any]
    """Reads the StoredRun of a method; of the only one where None is given. Raises InputError."""
    show: Callable[[Any, int | None, float], Any]
    """Shows a Run, a StoredRun or a Stepper in a cell. The arguments after it are the first frame and the most MB.
    Raises InputError."""


REGISTRY = Registry("ispom.run_folders", RunFolders, "kind of run folder", ())


def run_folders() -> RunFolders:
    """Returns how `ispom run` keeps runs. Raises InputError where only the library is installed."""
    return REGISTRY.get("ispom")
