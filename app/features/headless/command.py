"""The command: checks the options, runs, writes and prints."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.features.pair_look import MIXED_UP
from ispom.methods import chosen_methods, members, with_dependencies
from ispom.sequences.address import without_secrets
from ispom.types import FRAME_KINDS, Sequence

from ...engine import warmup
from ...engine.conditions.evaluate import Until, require_run, until
from ...engine.playback import Builder, Playback, Stage
from ...engine.run_events.table import event_lines
from ...engine.run_folder.results import summary
from ...engine.run_folder.run_folder import EVENTS, METRICS, RunFolder
from ...engine.signals import Signals, terminable
from .console import Progress, progress
from .job import Job, Origin
from .options import Run
from .output import describe, write_inputs
from .play import Played, play
from .seen import Seen

NO_MOTION = "no method found any motion"
"""In the sentence of a run without two poses: by this an experiment knows it from other failures."""
LEAST_FRAMES = 12
"""A run of fewer is a trial, of which nothing is suspected: they say little."""


def run(options: Run, builder: Builder = build, origin: Origin | None = None) -> int:
    """Runs, writes and prints, with estimators from `builder`; from `origin` on, where there is one.

    The exit code is 0, or InputError is raised after what was computed has been written.
    """
    job = completed(options, builder, origin)
    _print(job)
    if len(job.seen.film) < LEAST_FRAMES:
        return 0
    from .suspicions import suspicions  # imported here: it brings the doctor

    with terminable():
        for line in suspicions(job):
            sys.stdout.write(f"{printable(line)}\n")
    return 0


def completed(
    options: Run, builder: Builder = build, origin: Origin | None = None, progress: Progress = progress
) -> Job:
    """The same without printing; `progress` is called at each frame. The folder of the job that it gives is
    complete."""
    condition = until(options.until)
    if options.methods:
        require_run(condition, with_dependencies(members(options.methods)))
    return played_into(options, options.open(options.source), builder, origin, progress)


def played_into(
    options: Run,
    sequence: Sequence,
    builder: Builder,
    origin: Origin | None = None,
    progress: Progress = progress,
    computes: bool = True,
    seen: Callable[[Playback], Seen] = lambda _: Seen(),
) -> Job:
    """The same over a sequence that is open. `computes`, and what `seen` makes: see Job."""
    condition = until(options.until)
    try:
        methods = _chosen_methods(options, sequence)
        require_run(condition, with_dependencies(methods))
        # An integration is measured between the stereo poses that it asks for; those are computed anyway.
        earlier = origin.stages if origin is not None else ()
        _require_inside(earlier, sequence)
        playback = Playback(sequence, with_dependencies(methods), options.config, builder, earlier)
        warmup.start(methods, options.config)
        with terminable() as signals, _folder(options.out, sequence.name) as folder:
            job = Job(
                options, methods, origin, playback, Until(condition), folder, progress, computes, seen=seen(playback)
            )
            _run(job, signals)
    finally:
        if sequence.stop is not None:
            sequence.stop()
    return job


def _chosen_methods(options: Run, sequence: Sequence) -> tuple[str, ...]:
    """Returns the methods to run. Raises InputError where the rig lacks the camera of `--frame`."""
    methods = chosen_methods(options.methods, sequence.rig, options.variant or "modern")
    if options.frame != "rig" and getattr(sequence.rig, options.frame) is None:
        raise InputError(f"--frame is {options.frame}, but {options.source} has no such camera: give another frame")
    return methods


def _folder(out: Path | None, name: str) -> RunFolder:
    if out is not None:
        return RunFolder(out)
    plain = re.sub(r"[^\w]+", "-", name).strip("-")
    return RunFolder.new(Path("recordings") / f"{plain}-{datetime.now():%Y%m%d-%H%M%S}")


def _run(job: Job, signals: Signals) -> None:
    """Whatever ends it, the folder is complete or says why it is not."""
    folder, playback = job.folder, job.playback
    describe(job)
    write_inputs(job)
    try:
        played = play(job, signals)
        if job.watch.stop is None:
            _require_poses(job, played)
        describe(job, played.statistics.images.hexdigest())
        if problems := "; ".join(filter(None, (played.failure, folder.problem))):
            raise InputError(problems)
    except BaseException as error:
        describe(job)
        problem = "" if isinstance(error, InputError) or folder.problem is None else f" {folder.problem}."
        folder.failed(f"{_reason(error, playback)}{problem}")
        raise
    folder.complete()


def _require_inside(earlier: tuple[Stage, ...], sequence: Sequence) -> None:
    if earlier and sequence.grow is None and earlier[-1].until >= len(sequence):
        at, last = earlier[-1].until, len(sequence) - 1
        raise InputError(f"--at is {at}, but the last frame of the source is {last}: give a value from 0 to {last}")


def _require_poses(job: Job, played: Played) -> None:
    """Raises InputError where no method found a motion: with what is known of the source, or else with the check that
    each method failed."""
    if all(len(played.finished.trajectories[method]) < 2 for method in job.methods):
        source = without_secrets(job.options.source)
        mixed_up = [f"{note[0].lower()}{note[1:-1]}" for note in job.playback.sequence.notes if note in MIXED_UP]
        waits = played.statistics.waits
        why = "; ".join(f"{method}: {waits[method].removesuffix('.')}" for method in job.methods if method in waits)
        # Where a method that they build on was located, the images are good.
        texture = "" if any(played.statistics.located.values()) else "give images with texture in focus, and overlap"
        cure = mixed_up[0] if mixed_up else texture
        said = f"{cure} ({why})" if cure and why else cure or why or "give a longer sequence"
        raise InputError(f"{source}: {NO_MOTION}: {said}")


def _reason(error: BaseException, playback: Playback) -> str:
    after = f"after {playback.position} of {len(playback.sequence)} frames"
    if isinstance(error, InputError):
        return f"Stopped {after}: {error}"
    if isinstance(error, KeyboardInterrupt | SystemExit):
        return f"Stopped by a signal {after}."
    return f"Failed {after}: {error!r}"


def _print(job: Job) -> None:
    ended, path = str(job.watch), job.folder.path
    notes = map(printable, (*job.playback.sequence.notes, *([ended] if ended else [])))
    happened = map(printable, event_lines(job.events.log.events, EVENTS))
    others = Counter(kind for kind in job.playback.sequence.kinds if kind not in FRAME_KINDS)
    sensors = [f"other sensors: {', '.join(f'{n} {kind}' for kind, n in sorted(others.items()))}"] if others else []
    lines = [*notes, *sensors, summary(json.loads((path / METRICS).read_text())), *happened, printable(f"in {path}")]
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()  # what is suspected follows seconds later
