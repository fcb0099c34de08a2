"""What a run folder gives of a run, as a notebook has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ispom.geometry import Pose
from ispom.notebook.result import Result
from ispom.notebook.run_folders import run_folders
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


def read_run(folder: str | Path, name: str | None = None) -> StoredRun:
    """Reads a run that `ispom run` or `Run.save` wrote. `name` is the method, where the run has several.

    Raises InputError where the folder holds no complete run, or not of that method.
    """
    return run_folders().read(Path(folder), name)
