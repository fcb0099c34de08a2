"""`ispom run`: the methods over a source without a window, into a folder that is complete or says that it is not."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Self

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.maps import map_bytes
from ispom.io.rig import rig_text
from ispom.io.tum import tum_text
from ispom.methods import default_methods, in_order, require_cameras, with_asked
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from .expressions.until import Stop, Until, require_run, until
from .options import Run
from .run import warmup
from .run.console import ended_by_interrupt, progress, terminable, wait_for_compiler
from .run.events import Event, Finished
from .run.journal import PoseJournal
from .run.map_memory import MapCollectors
from .run.playback import Builder, Playback, Stage
from .run.results import Results, in_frame, metrics_text, summary
from .run.run_file import RunFile, fork_entry, run_file
from .run.run_folder import LANDMARKS, METRICS, RECORDING, RIG, RUN, TRUTH, RunFolder, trajectory_file
from .run.statistics import RunStatistics
from .run.step_log import StepLog


@dataclass(frozen=True)
class Origin:
    """What a run was forked from."""

    run: RunFile
    folder: Path
    stages: tuple[Stage, ...]
    """Of its own origins, and the run itself."""

    @property
    def entries(self) -> list[dict[str, Any]]:
        """As the fork's run.yaml has them."""
        runs = [str(entry.get("run", "")) for entry in self.run.forked][: len(self.stages) - 1]
        return [fork_entry(name, stage) for name, stage in zip([*runs, str(self.folder)], self.stages, strict=True)]


def run(options: Run, builder: Builder = build, origin: Origin | None = None) -> int:
    """Runs and writes, with estimators from `builder`; from `origin` on, where there is one.

    The exit code is 0, or InputError is raised after what was computed has been written.
    """
    condition = until(options.until)
    if options.methods:
        require_run(condition, with_asked(in_order(options.methods)))
    sequence = options.open(options.source)
    try:
        methods = _asked(options, sequence)
        require_run(condition, with_asked(methods))
        # An integration is measured between the stereo poses that it asks for; those are computed anyway.
        earlier = origin.stages if origin is not None else ()
        _require_inside(earlier, sequence)
        playback = Playback(sequence, with_asked(methods), options.config, builder, earlier)
        warmup.start(methods, options.config)
        with terminable() as check_signals, _folder(options.out, sequence.name) as folder:
            watch = Until(condition)
            _run(playback, methods, options, folder, origin, watch, check_signals)
            _print(folder, playback.sequence, str(watch))
    finally:
        if sequence.stop is not None:
            sequence.stop()
    return 0


def _asked(options: Run, sequence: Sequence) -> tuple[str, ...]:
    """The methods to run; InputError where the rig lacks the camera of the asked frame."""
    methods = in_order(options.methods) or default_methods(sequence.rig, options.variant or "modern")
    require_cameras(methods, sequence.rig)
    if options.frame != "rig" and getattr(sequence.rig, options.frame) is None:
        raise InputError(f"--frame is {options.frame}, but {options.source} has no such camera: give another frame")
    return methods


def _folder(out: Path | None, name: str) -> RunFolder:
    if out is not None:
        return RunFolder(out)
    plain = re.sub(r"[^\w]+", "-", name).strip("-")
    return RunFolder.new(Path("recordings") / f"{plain}-{datetime.now():%Y%m%d-%H%M%S}")


def _run(
    playback: Playback,
    methods: tuple[str, ...],
    options: Run,
    folder: RunFolder,
    origin: Origin | None,
    watch: Until,
    check_signals: Callable[[], None],
) -> None:
    """Whatever ends it, the folder is complete or says why it is not."""
    statistics, forked = RunStatistics(), origin.entries if origin is not None else []
    _describe(folder, playback, methods, options, forked)
    folder.write(RIG, rig_text(playback.sequence.rig))
    if playback.truth is not None:
        folder.write(TRUTH, tum_text(in_frame(playback.truth, playback.sequence.rig, options.frame)))
    try:
        finished, failure = _play(playback, methods, options, folder, statistics, watch, check_signals)
        if watch.stop is None:
            _require_poses(without_secrets(options.source), finished, methods)
        _describe(folder, playback, methods, options, forked, statistics.images.hexdigest(), watch.stop)
        if problems := "; ".join(filter(None, (failure, folder.problem))):
            raise InputError(problems)
    except BaseException as error:
        _describe(folder, playback, methods, options, forked)
        problem = "" if isinstance(error, InputError) or folder.problem is None else f" {folder.problem}."
        folder.failed(f"{_reason(error, playback)}{problem}")
        raise
    folder.complete()


def _describe(
    folder: RunFolder,
    playback: Playback,
    methods: tuple[str, ...],
    options: Run,
    forked: list[dict[str, Any]],
    images: str | None = None,
    stop: Stop | None = None,
) -> None:
    """Writes run.yaml; `images` is the hash of all that were seen, where the run came to its end."""
    used: dict[str, Any] = {"methods": list(methods), "frame": options.frame}
    used |= {name: getattr(options, name) for name in ("seed", "stereo_every", "video_scale", "max_exposures", "until")}
    used |= {"recording": options.recording, "camera": None if options.camera is None else str(options.camera)}
    config = {name: asdict(options.config.of(name)) for name in playback.methods}
    stopped = None if stop is None else {n: getattr(stop, n) for n in ("exposure", "time_ns", "values")}
    source = without_secrets(options.source)
    folder.write(RUN, run_file(source, playback.sequence, used, config, images, forked, stopped).text)


def _require_inside(earlier: tuple[Stage, ...], sequence: Sequence) -> None:
    if earlier and sequence.grow is None and earlier[-1].until >= len(sequence):
        at, last = earlier[-1].until, len(sequence) - 1
        raise InputError(f"--at is {at}, but the last exposure of the source is {last}: give a value from 0 to {last}")


def _play(
    playback: Playback,
    methods: tuple[str, ...],
    options: Run,
    folder: RunFolder,
    statistics: RunStatistics,
    watch: Until,
    check_signals: Callable[[], None],
) -> tuple[Finished, str | None]:
    """Steps through the sequence, until `watch` stops it. Whatever ends that, what was computed is written.

    Gives also why the recording ended early, None where it did not.
    """
    collectors = MapCollectors()
    with ExitStack() as stack:
        record = stack.enter_context(_Recording(playback, folder) if options.recording else _NoRecording())
        log, journal = stack.enter_context(StepLog(folder)), PoseJournal(folder, playback.unit_m)
        if playback.sequence.prepare:
            playback.sequence.prepare(0)
        total = len(playback.sequence) if playback.sequence.grow is None else options.max_exposures
        try:
            wait_for_compiler()
            with ended_by_interrupt(playback.sequence), progress(total) as advance:
                while playback.more():
                    event = playback.step()
                    collectors.add(event.steps)
                    for consumer in (statistics, log, journal, record, watch):
                        consumer.add(event)
                    advance()
                    check_signals()
                    if watch.stop is not None:
                        playback.end()
        finally:
            finished = playback.finish()
            record.add(finished)
            _write(playback, finished, methods, options, folder, statistics)
            maps = collectors.scenes(finished.trajectories, methods, playback.sequence.rig)
            folder.write(LANDMARKS, map_bytes(maps))
            journal.close(keep=not all((folder.path / trajectory_file(m)).exists() for m in methods))
    return finished, record.failure


class _NoRecording:
    """Where none is asked for."""

    failure: str | None = None

    def add(self, event: Event) -> None: ...
    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...


class _Recording(_NoRecording):
    """run.rrd, as far as the disk takes it; the run goes on without."""

    def __init__(self, playback: Playback, folder: RunFolder) -> None:
        from .rerun_log.file_recording import FileRecording  # brings Rerun

        self._file: FileRecording | None = None
        try:
            self._file = FileRecording(folder.path / RECORDING, playback.opened)
        except InputError as error:
            self.failure = str(error)

    def add(self, event: Event) -> None:
        if self._file is not None:
            self._file.write(event)

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
            self.failure = self._file.failure


def _write(
    playback: Playback,
    finished: Finished,
    methods: tuple[str, ...],
    options: Run,
    folder: RunFolder,
    statistics: RunStatistics,
) -> None:
    sequence = playback.sequence
    for method in methods:
        found = in_frame(finished.trajectories[method], sequence.rig, options.frame, playback.unit_m(method))
        folder.write(trajectory_file(method), tum_text(found))
    end_ns = int(sequence.times_ns[-1])
    results = Results(sequence.name, sequence.notes, sequence.rig, playback.truth, end_ns, finished.trajectories)
    folder.write(METRICS, metrics_text(results, methods, statistics))


def _require_poses(source: str, finished: Finished, methods: tuple[str, ...]) -> None:
    if all(len(finished.trajectories[method]) < 2 for method in methods):
        raise InputError(f"{source}: no method found any motion: give images with texture in focus, and overlap")


def _reason(error: BaseException, playback: Playback) -> str:
    after = f"after {playback.position} of {len(playback.sequence)} exposures"
    if isinstance(error, InputError):
        return f"Stopped {after}: {error}"
    if isinstance(error, KeyboardInterrupt | SystemExit):
        return f"Stopped by a signal {after}."
    return f"Failed {after}: {error!r}"


def _print(folder: RunFolder, sequence: Sequence, ended: str) -> None:
    """`ended` is how a condition ended the run, or that it did not; empty where there was none."""
    notes = map(printable, (*sequence.notes, *([ended] if ended else [])))
    lines = [*notes, summary(json.loads((folder.path / METRICS).read_text())), printable(f"in {folder.path}")]
    sys.stdout.write("\n".join(lines) + "\n")
