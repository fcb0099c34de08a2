"""What a run knows that a prediction needs: of a folder that `ispom run` wrote, or of a run in the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.maps import SceneMap, read_maps
from ispom.io.rig import read_rig
from ispom.io.trajectories import read_tum
from ispom.methods import Config, with_dependencies
from ispom.types import Rig, Trajectory

from ...engine.events import Finished, Opened
from ...engine.history.record import ExposureRecord
from ...engine.model.map_memory import MapCollectors
from ...engine.run_folder.placements import placed
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import LANDMARKS, RIG, TRUTH, trajectory_file


@dataclass(frozen=True, eq=False)
class Ran:
    """A run, or as much of it as is computed."""

    rig: Rig
    methods: tuple[str, ...]
    config: Config
    trajectories: Mapping[str, Trajectory]
    """By method, in its own world and unit, all of one frame or each of its own."""
    scenes: Mapping[str, SceneMap]
    """By method."""
    truth: Trajectory | None
    """world_from_rig."""
    units_m: Mapping[str, float]
    """By method, its unit [m] where that is known."""


def ran_in(folder: Path) -> Ran:
    """Of a run's folder; InputError where it has no poses or points."""
    run, rig = read_run_file(folder), read_rig(folder / RIG)
    methods = tuple(m for m in with_dependencies(run.methods) if exists(folder / trajectory_file(m)))
    if not methods:
        raise InputError(f"{folder} has no trajectory of any method: run it first")
    trajectories = {m: read_tum(folder / trajectory_file(m), run.frame) for m in methods}
    truth = read_tum(folder / TRUTH, run.frame) if exists(folder / TRUTH) else None
    if truth is not None:
        truth = truth.moved(right=rig.rig_from(run.frame).inverse(), frame="rig")
    units = {method: placement.scale for at, method, placement in placed(run.placements) if at > 0}
    return Ran(rig, methods, run.configs(), trajectories, read_maps(folder / LANDMARKS), truth, units)


def ran_here(opened: Opened, finished: Finished, records: Iterable[ExposureRecord]) -> Ran:
    """Of a run in the page: what its records saw, and its trajectories as of now."""
    maps, rig, methods = MapCollectors(), opened.sequence.rig, opened.methods
    for record in records:
        maps.add(record.steps)
    scenes = maps.scenes(finished.trajectories, methods, rig)
    units = {method: placement.scale for method, placement in finished.placements.items()}
    return Ran(rig, methods, opened.config, finished.trajectories, scenes, opened.truth, units)
