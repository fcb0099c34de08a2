"""`ispom doctor`: opens a run, examines its bad stretch, and prints the answer."""

from __future__ import annotations

import sys
from dataclasses import replace

from rich.console import Console

from ispom.ensemble import build
from ispom.io.files import exists
from ispom.io.rig import read_rig
from ispom.io.whole import write_whole
from ispom.stop import check_stop
from ispom.types import Sequence

from ...engine.outputs import claim_folder, json_of
from ...engine.playback import Builder
from ...engine.run_events.stretch import events_in, stretch_of
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import RIG
from ...engine.signals import terminable
from ...session.review.stored import stored_source
from ..headless.console import compile_first
from .job import Progress, examine
from .options import Doctor
from .origin import Origin
from .text import lines
from .written import written


def doctor(options: Doctor, builder: Builder = build) -> int:
    """Prints the diagnosis. Raises InputError where the folder holds no run, or its source is gone."""
    run = read_run_file(options.run)
    sequence = opened(options, run)
    stretch = stretch_of(sequence, options.at, options.frames, events_in(options.run))
    compile_first(run.methods, run.configs())  # before its time begins to count
    console = Console(stderr=True)
    with terminable(), console.status("reading images") as status:

        def report(progress: Progress) -> None:
            check_stop()
            if console.is_terminal:
                status.update(f"{progress.done} of {progress.total}: {progress.doing}")

        origin = Origin.of_folder(options.run, run, sequence, builder)
        found = examine(sequence, stretch, options.seconds, report, origin=origin)
    sys.stdout.write("\n".join(lines(found, stretch, sequence.notes)) + "\n")
    if options.out is not None:
        claim_folder(options.out, "doctor")
        write_whole(options.out / "doctor.json", json_of(written(found, stretch)))
    return 0


def opened(options: Doctor, run: RunFile) -> Sequence:
    """Returns the run's source. Where it has no calibration, the run's own is examined: its estimate took a while."""
    source, rig = stored_source(options.run, run, options.source), options.run / RIG
    if not exists(rig):
        return source.open()
    sequence = source.opened()
    return sequence if sequence.guess is None else replace(sequence, rig=read_rig(rig))
