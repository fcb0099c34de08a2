"""How a notebook's run is written as `ispom run` does, how a run folder is read for a notebook, and how both are
shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ispom.ensemble import Ensemble, Member
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.methods import Config, in_order, method
from ispom.notebook.folders import StoredRun, StoredStep
from ispom.notebook.run import Run
from ispom.notebook.run_folders import RunFolders
from ispom.types import Measurement, Rig, Status, Step, Trajectory

from ...engine.history.quantities import POSE
from ...engine.options import settings_of
from ...engine.run_folder.step_reader import StoredStep as Row
from ...engine.run_folder.step_reader import stored_steps
from ..headless.command import played_into
from ..headless.console import silent
from ..headless.options import Run as Options
from ..report.folder import read_run


@dataclass(frozen=True, eq=False)
class Repeated:
    """An estimator that gives results of before. Its state is the number of the next step."""

    steps: tuple[Step, ...]
    trajectory: Trajectory

    def start(self) -> int:
        """Before the first step."""
        return 0

    def step(self, state: int, measurement: Measurement, *inputs: Any) -> tuple[int, Step]:
        """The step of that number."""
        return state + 1, self.steps[state]

    def finish(self, state: int, *inputs: Any) -> Trajectory:
        """The trajectory of before."""
        return self.trajectory


def save(run: Run, folder: Path) -> Path:
    """Writes all that `ispom run` writes, from the steps of the run. Raises InputError as `Run.save`."""
    results = {**run.dependencies, run.method: (run.steps, run.trajectory)}

    def builder(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        return Ensemble(in_order(methods), {name: Member(method(name), Repeated(*results[name])) for name in methods})

    config = Config({run.method: method(run.method).config(**run.settings)})
    frame = run.trajectory.frame
    options = Options(
        source=run.address or run.source,
        methods=(run.method,),
        out=folder,
        frame=frame if frame in ("rig", "left", "video") else "rig",
        max_exposures=run.frames,
        settings=settings_of(config),
    )
    return played_into(options, run.sequence, builder, progress=silent, computes=False).folder.path


def read(folder: Path, name: str | None) -> StoredRun:
    """Reads the run of a method, or of the only one. Raises InputError as `ispom.read_run`."""
    found = read_run(folder, folder.name)
    methods = tuple(found.trajectories)
    if name is None and len(methods) != 1:
        raise InputError(f"{folder} holds runs of {', '.join(methods)}: choose one, as in read_run(folder, 'stereo')")
    chosen = methods[0] if name is None else name
    if chosen not in methods:
        raise InputError(f"{folder} holds no run of {chosen[:60]!r}: choose from {', '.join(methods)}")
    with stored_steps(folder) as rows:
        every = [(row.time_ns, _step(row) if row.method == chosen else None) for row in rows]
    times_ns = [time_ns for time_ns, _ in every]
    return StoredRun(
        source=str(found.manifest["sequence"]),
        rig=found.rig,
        truth=found.truth,
        span_ns=(min(times_ns), max(times_ns)),
        method=chosen,
        settings=dict(found.manifest["config"].get(chosen, {})),
        steps=tuple(step for _, step in every if step is not None),
        trajectory=found.trajectories[chosen],
        folder=folder,
    )


def _step(row: Row) -> StoredStep:
    pose: Any = [row.values.get(name) for name in POSE]
    return StoredStep(
        row.time_ns,
        row.exposure,
        Status(str(row.values["status"])),
        None if None in pose else Pose.from_xyzw(np.array(pose[3:]), np.array(pose[:3])),
        int(row.values["inliers"] or 0),
        row.values,
    )


def show(run: Any, frame: int | None, max_mb: float) -> Any:
    """A view in a cell. Widgets are imported only here: they take a while."""
    from .cell import show as shown

    return shown(run, frame, max_mb)


RUN_FOLDERS = RunFolders("ispom", save, read, show)
