"""`ispom blame`: what moved the pose of one frame of a run."""

from __future__ import annotations

import csv
import sys
from io import StringIO

import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.whole import write_whole
from ispom.methods import with_dependencies
from ispom.solvers.influence.blame import Influence
from ispom.solvers.influence.problem import Shift

from ...engine.outputs import claim_folder
from ...engine.playback import Builder, Playback
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.signals import terminable
from ...session.review.stored import stored_source
from ..headless.console import compile_first, progress
from .found import PoseBlame, pose_blames, units_m
from .options import Blame
from .words import answer, digits, size, unit_of

WIDTH = 120
COLUMNS = ("kind", "name", "tracks", "frame", "x", "y", "z", "moved_m", "turned_deg")
"""Columns of blame.csv: x, y, z in the method's world and unit; `moved_m` is empty where that unit is unknown."""


def blame(options: Blame, builder: Builder = build) -> int:
    """Runs up to the frame, and prints. InputError where the run has no such frame, or no method a pose there."""
    run = read_run_file(options.run.expanduser())
    methods = _methods(run, options)
    sequence = stored_source(options.run.expanduser(), run, options.source).open()
    if not 0 <= options.at < len(sequence):
        raise InputError(
            f"--at is {options.at}, and the run has the frames 0 to {len(sequence) - 1}: give one of those"
        )
    with terminable():
        playback = Playback(sequence, with_dependencies(methods), run.configs(), builder, run.earlier)
        compile_first(methods, run.configs())
        with progress(options.at) as advance:
            while playback.position < options.at:
                playback.step()
                advance()
        of, *_ = pose_blames(playback, methods, units_m(run.placements))
        checked = [_checked(playback, of, each) if options.check else None for each in of.listed()]
    sys.stdout.write("".join(f"{sentence}\n" for sentence in answer(of)))
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH).print(_table(of, checked, options.check))
    if options.out is not None:
        claim_folder(options.out, "blame")
        write_whole(options.out / "blame.csv", _text(of))
    return 0


def _methods(run: RunFile, options: Blame) -> tuple[str, ...]:
    if not options.method:
        return run.methods
    if options.method not in with_dependencies(run.methods):
        raise InputError(f"the run has no method {options.method}: give one of {', '.join(run.methods)}")
    return (options.method,)


def _checked(playback: Playback, of: PoseBlame, each: Influence) -> Shift | None:
    if not each.part.tracks:
        return None
    step = playback.without_tracks(of.method, np.array(each.part.tracks, np.int64))
    return None if step is None else of.between(step)


def _table(of: PoseBlame, checked: list[Shift | None], check: bool) -> Table:
    unit, solved = unit_of(of), "the points of the map" if of.by_known_points else "its window"
    table = Table(title=f"What moved the pose of {of.method} at frame {of.index}, found from {solved}")
    for name in ("left out", "kind", "moved by", "turned by", *["run again: moved by"] * check):
        table.add_column(name, justify="left" if name in ("left out", "kind") else "right")
    for each, again in zip(of.listed(), checked, strict=True):
        cells = [of.called(each), each.part.kind, size(of, each.shift.size, unit)]
        cells.append(f"{digits(float(np.degrees(np.linalg.norm(each.shift.rotation))))}°")
        if check:
            cells.append("" if again is None else size(of, again.size, unit))
        table.add_row(*cells)
    return table


def _text(of: PoseBlame) -> str:
    text = StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for each in of.found.influences:
        part, shift = each.part, each.shift
        frame = "" if part.time_ns is None else of.index_of(part.time_ns)
        moved_m = "" if of.unit_m is None else shift.size * of.unit_m
        turned = float(np.degrees(np.linalg.norm(shift.rotation)))
        ids = " ".join(map(str, part.tracks))
        writer.writerow([part.kind, part.name, ids, frame, *shift.position.tolist(), moved_m, turned])
    return text.getvalue()
