"""What a map is made from: a run's poses, and the images that it ran on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.trajectories import read_tum
from ispom.methods import method as registered
from ispom.types import Sequence, Status, Trajectory

from ...engine.run_folder.results import in_frame
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import trajectory_file
from ...engine.run_folder.step_reader import stored_steps
from ...session.review.stored import stored_source

PREFERRED = ("integrated", "stereo", "integrated.paper", "stereo.paper")


@dataclass(frozen=True, eq=False)
class Ran:
    """A run, opened again."""

    folder: Path
    file: RunFile
    sequence: Sequence
    paths: Mapping[str, Trajectory]
    """world_from_rig of each metric method, at least one; without the poses that it only held while it was lost."""

    def method(self, method_name: str | None) -> str:
        """Returns the method of this name, by default that with the best poses.

        Raises InputError for one that has no metric poses in the run."""
        if method_name is None:
            return next((name for name in PREFERRED if name in self.paths), next(iter(self.paths)))
        if method_name not in self.paths:
            raise InputError(
                f"{self.folder} has no metric poses of {method_name[:40]}: "
                f"give --method as one of {', '.join(self.paths)}"
            )
        return method_name


def _lost(folder: Path, methods: Iterable[str]) -> dict[str, list[int]]:
    """By method: the times [ns] at which it had no pose of its own."""
    found: dict[str, list[int]] = {method: [] for method in methods}
    with stored_steps(folder) as steps:
        for step in steps:
            if step.method in found and step.values.get("status") == Status.LOST:
                found[step.method].append(step.time_ns)
    return found


def read_ran(folder: Path, source: str | None) -> Ran:
    """InputError where the folder holds no run with metric poses, or its source is gone or another one now."""
    run = read_run_file(folder)
    metric = [m for m in run.methods if registered(m).unit == "metric" and exists(folder / trajectory_file(m))]
    if not metric:
        raise InputError(f"{folder} has no metric poses: run stereo or integrated on a recording with a stereo pair")
    sequence = stored_source(folder, run, source).open()
    paths = {m: read_tum(folder / trajectory_file(m), run.frame) for m in metric}
    lost = _lost(folder, metric)
    paths = {m: path.select(~np.isin(path.times_ns, lost[m])) for m, path in paths.items()}
    paths = {m: in_frame(path, sequence.rig, "rig") for m, path in paths.items() if len(path) > 1}
    if not paths:
        raise InputError(f"{folder}: no metric method found two poses: run again on a recording with motion")
    for path in paths.values():
        if not np.isin(path.times_ns, sequence.times_ns).all():
            raise InputError(f"{source or run.source} is not the source that the run had: its frames have other times")
    return Ran(folder, run, sequence, paths)
