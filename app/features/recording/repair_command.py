"""`ispom repair`: what a killed run left is finished: recordings, trajectories and metrics, as far as they go."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom.errors import InputError, printable
from ispom.io.rig import read_rig
from ispom.io.trajectories import read_tum, tum_text
from ispom.stop import check_stop
from ispom.types import Rig, Trajectory

from ...engine.run_folder.journal import Journal, read_journal
from ...engine.run_folder.results import Results, in_frame, metrics_text
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import (
    DECISIONS,
    JOURNAL,
    METRICS,
    RIG,
    RUN,
    STEPS,
    TRUTH,
    RunFolder,
    is_incomplete,
    trajectory_file,
)
from ...engine.run_folder.step_log import counted
from ...engine.run_folder.table import cut_to_rows, read_table
from ...engine.signals import terminable
from .options import Repair

Found = tuple[list[str], list[str]]
"""What was done, and what could not be: a line each."""


def repair(options: Repair) -> int:
    """Repairs a run's folder, or a folder of recordings and runs; InputError where something cannot be repaired.

    A signal ends it between two files.
    """
    with terminable():
        return _repair(options.folder)


def _repair(folder: Path) -> int:
    try:
        if not folder.is_dir():
            raise InputError(f"{folder} is no folder: give that of a run, or of recordings")
        if (folder / RUN).exists() and not is_incomplete(folder):
            lines, problems = [f"{folder} holds a complete run: nothing to repair"], []
        else:
            lines, problems = repair_run(folder) if is_incomplete(folder) else _repair_recordings(folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be repaired ({error.strerror}): see to its permissions") from None
    sys.stdout.write("".join(f"{printable(line)}\n" for line in lines or [f"{folder}: nothing to repair"]))
    if problems:
        raise InputError("; ".join(problems))
    return 0


def _finish_recordings(folder: Path) -> Found:
    from ...views.rerun.repair import finish, unfinished  # brings Rerun

    lines, problems = [], []
    for path in unfinished(folder):
        check_stop()
        try:
            done = finish(path)
            message = f"{done}: recording finished, up to where its writer came" if done else f"{path}: empty, removed"
            lines.append(message)
        except InputError as problem:
            problems.append(str(problem))
    return lines, problems


def _repair_recordings(folder: Path) -> Found:
    """The recordings in a folder, and the runs in its folders."""
    lines, problems = _finish_recordings(folder)
    for inner in sorted(path for path in folder.iterdir() if path.is_dir() and is_incomplete(path)):
        check_stop()
        try:
            done, failed = repair_run(inner)
        except InputError as problem:
            done, failed = [], [str(problem)]
        lines, problems = lines + done, problems + failed
    return lines, problems


def repair_run(path: Path) -> Found:
    """Finishes the files of one run, as far as it came. Raises InputError where another process writes to it."""
    with RunFolder.reopened(path) as folder:
        lines, problems = _finish_recordings(path)
        for name in (STEPS, DECISIONS):
            if folder.part(name).exists():
                cut_to_rows(folder.part(name))
                folder.keep(name)
                lines.append(f"{path / name}: complete rows kept")
        if (path / RUN).exists() and (path / RIG).exists():
            lines += _write_results(folder)
        return lines, [*problems, *([folder.problem] if folder.problem else [])]


def _write_results(folder: RunFolder) -> list[str]:
    """Trajectories and metrics of the poses that were known when the run ended, where they were not written."""
    path, run, rig, lines = folder.path, read_run_file(folder.path), read_rig(folder.path / RIG), []
    kept = next((place for place in (path / JOURNAL, folder.part(JOURNAL)) if place.exists()), None)
    if kept is None:
        return []
    journal = read_journal(kept)
    for method in run.methods:
        found = journal.trajectories.get(method, Trajectory.empty())
        if not (path / trajectory_file(method)).exists():
            folder.write(
                trajectory_file(method), tum_text(in_frame(found, rig, run.frame, journal.units_m.get(method)))
            )
            lines.append(f"{path / trajectory_file(method)}: {len(found)} poses, as known when the run ended")
    if not (path / METRICS).exists():
        statistics = counted(read_table(path / STEPS))
        folder.write(METRICS, metrics_text(_results(path, run, rig, journal), run.methods, statistics))
        lines.append(f"{path / METRICS}: of these poses")
    if folder.problem is None:
        total = sum(count for count in run.exposures.values() if isinstance(count, int))
        folder.failed(f"Repaired: {journal.exposures} of {total} frames. {folder.reason}")
        kept.unlink()
    return lines


def _results(path: Path, run: RunFile, rig: Rig, journal: Journal) -> Results:
    truth = read_tum(path / TRUTH, run.frame) if (path / TRUTH).exists() else None
    end_ns = max((int(t.times_ns[-1]) for t in journal.trajectories.values()), default=0)
    empty = {method: Trajectory.empty() for method in run.methods}
    trajectories = empty | dict(journal.trajectories)
    return Results(run.sequence, run.notes, rig, truth and in_frame(truth, rig, "rig"), end_ns, trajectories)
