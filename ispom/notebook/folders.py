"""The door by which runs are written to a folder, and read: the program that writes run folders stands behind it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ispom.geometry import Pose
from ispom.notebook.result import Result
from ispom.registry import Registry
from ispom.types import Status


@dataclass(frozen=True, eq=False, repr=False)
class StoredStep:
    """What a folder has of one step."""

    time_ns: int
    frame: int
    """Of the sequence, from 0."""
    status: Status
    world_from_frame: Pose | None
    """As it was given then, in the method's own world and unit."""
    inliers: int
    values: Mapping[str, float | str | bool | None]
    """All columns of steps.csv, by name."""

    def __repr__(self) -> str:
        pose = "no pose" if self.world_from_frame is None else "pose"
        when = f"frame {self.frame} at {self.time_ns * 1e-9:.3f} s"
        return f"StoredStep({when}: {self.status}, {pose}, {self.inliers} inliers)"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StoredRun(Result):
    """A run of one method, as a folder has it. `settings` are all of the method."""

    folder: Path
    steps: tuple[StoredStep, ...]


@dataclass(frozen=True)
class RunFolders:
    """How runs are kept in folders."""

    name: str
    save: Callable[[Any, Path], Path]
    """Writes a Run into a new or empty folder. Raises InputError."""
    read: Callable[[Path, str | None], StoredRun]
    """Reads the run of a method; of the only one where None is given. Raises InputError."""


REGISTRY = Registry("ispom.run_folders", RunFolders, "kind of run folder", ())


def run_folders() -> RunFolders:
    """Returns how `ispom run` keeps runs. Raises InputError where only the library is installed."""
    return REGISTRY.get("ispom")


def read_run(folder: str | Path, name: str | None = None) -> StoredRun:
    """Reads a run that `ispom run` or `Run.save` wrote. `name` is the method, where the run has several.

    Raises InputError where the folder holds no complete run, or not of that method.
    """
    return run_folders().read(Path(folder), name)
