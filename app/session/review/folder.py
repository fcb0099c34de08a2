"""A run's folder, opened for review. If its source still exists, the run can be forked at any frame."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from ispom.calibration.opening import with_estimated_camera
from ispom.errors import InputError, UnreadableImage
from ispom.io.files import confined, exists
from ispom.io.rig import read_rig
from ispom.io.trajectories import read_tum
from ispom.methods import Config, kinds_of, method, with_dependencies
from ispom.types import FrameName, Kind, Rig, Sequence, Trajectory

from ...engine.options import SourceOptions
from ...engine.playback import Builder, Playback
from ...engine.run_folder.placements import Placed, placed
from ...engine.run_folder.results import in_frame
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import RECORDING, RIG, TRUTH, ended_early, trajectory_file
from .recording import identity
from .records import Exposures, exposures, records
from .stored import Stored, compared, nobody, stored_source

Opener = Callable[[str, SourceOptions], Sequence]


NAME_IT = "open that source first, or name it where the program is started"


def read_stored(
    folder: Path, opener: Opener, builder: Builder, named: Collection[str] = (), compare: bool = False
) -> Stored:
    """Returns the run of a folder. `opener` opens its source if `stored_source` allows it; `named` are sources that a
    person named before.

    `compare`: all images are compared with those of the run before the first one is given. InputError where the folder
    has no run, or a damaged one.
    """
    run, rig = read_run_file(folder), read_rig(folder / RIG)
    config, methods = run.configs(), with_dependencies(run.methods)
    if not methods:
        raise InputError(f"{folder}: the methods of the run are not installed here: install them, or run again")
    found = exposures(folder, rig)
    if not len(found.kinds):
        raise InputError(f"{folder} holds no exposure: run again")
    recording, identity = _recording(folder)
    first = run.earlier[0].methods if run.earlier else methods
    sequence, unavailable = _sequence(folder, run, rig, found, opener, named, compare, kinds_of(first))
    playback = _playback(sequence, methods, config, run, builder, unavailable)
    if not unavailable:
        found = replace(found, times_ns=sequence.times_ns, kinds=sequence.kinds[: len(found.kinds)])
    where = placed(run.placements)
    start = playback.snapshot.placements
    return Stored(
        folder,
        playback,
        lambda: records(folder, found, methods, where, start),
        _final(folder, run, rig, found, where),
        methods,
        recording,
        identity,
        unavailable,
    )


def _recording(folder: Path) -> tuple[Path | None, str]:
    """Returns the recording of the run and its id, if it can be shown. A run can be reviewed without it."""
    path = folder / RECORDING
    try:
        return (path, identity(path)) if exists(path) else (None, "")
    except InputError:
        return None, ""


def _sequence(
    folder: Path,
    run: RunFile,
    rig: Rig,
    found: Exposures,
    opener: Opener,
    named: Collection[str],
    compare: bool,
    kinds: frozenset[Kind],
) -> tuple[Sequence, str]:
    """Returns the sequence of the source with measurements of these kinds, or else one without images, and why."""
    of_end = filter(None, [ended_early(folder)])
    try:
        allowed = stored_source(folder, run, None, named, NAME_IT)
        with confined(allowed.places):
            sequence = opener(allowed.source, allowed.options)
        if compare and run.images_sha256 is not None and not run.source.startswith("sim:"):
            sequence = compared(sequence, run.images_sha256, run.source)
        sequence = with_estimated_camera(sequence).used_by(kinds)
        if _same(found, sequence):
            return replace(sequence, notes=(*sequence.notes, *of_end, f"stored run {folder.name}")), ""
        unavailable = f"{run.source} is not the source that the run had: its frames have other times"
    except InputError as mistake:
        unavailable = str(mistake)
    unavailable = f"{unavailable.removesuffix('.')}; nothing can be computed anew"

    def load(i: int) -> NoReturn:
        raise UnreadableImage(unavailable)

    notes = (*map(str, run.notes), *of_end, f"stored run {folder.name}: {unavailable}")
    return Sequence(run.sequence, rig, found.times_ns, found.kinds, load, _truth(folder, rig, run.frame), notes), (
        unavailable
    )


def _same(found: Exposures, sequence: Sequence) -> bool:
    """Returns whether the frames of the sequence can be those of the run."""
    count = len(found.kinds)
    return len(sequence) >= count and np.array_equal(sequence.times_ns[:count][found.used], found.times_ns[found.used])


def _playback(
    sequence: Sequence, methods: tuple[str, ...], config: Config, run: RunFile, builder: Builder, unavailable: str
) -> Playback:
    if unavailable:
        return Playback(sequence, methods, config, nobody)
    return Playback(sequence, methods, config, builder, run.earlier)


def _truth(folder: Path, rig: Rig, frame: FrameName) -> Trajectory | None:
    """world_from_rig."""
    if not exists(folder / TRUTH):
        return None
    found = read_tum(folder / TRUTH, frame)
    return in_frame(found, rig, "rig") if len(found) else None


def _final(folder: Path, run: RunFile, rig: Rig, of: Exposures, where: list[Placed]) -> dict[str, Trajectory]:
    """Returns the final trajectories by method, each of the frame of its steps."""
    found = {}
    units = {method: placement.scale for at, method, placement in where if at > 0}
    for name in run.methods:
        if exists(folder / trajectory_file(name)) and name in of.frames:
            unit_m = units.get(name, None if method(name).unit == "own" else 1.0)
            written = read_tum(folder / trajectory_file(name), run.frame)
            found[name] = in_frame(written, rig, of.frames[name], unit_m)
    return found
