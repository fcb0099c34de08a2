"""`ispom run`: the methods over a source without a window, into a folder that is complete or says that it is not."""

from __future__ import annotations

import json
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.maps import map_bytes
from ispom.io.rig import rig_text
from ispom.io.tum import tum_text
from ispom.methods import default_methods, in_order, names, require_cameras, with_asked
from ispom.methods import method as registered
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from .options import Run
from .run import warmup
from .run.events import Finished
from .run.map_memory import MapCollectors
from .run.playback import Builder, Playback
from .run.results import RunStatistics, in_frame, metrics_text, run_text, summary
from .run.run_folder import RunFolder
from .run.step_log import DECISIONS, STEPS, StepLog

TERMINATED = 143
RECORDING, LANDMARKS = "run.rrd", "landmarks.npz"
OUTPUTS = [
    "run.yaml",
    "rig.yaml",
    "truth.tum",
    *(f"{m}.tum" for m in names()),
    "metrics.json",
    LANDMARKS,
    STEPS,
    DECISIONS,
    RECORDING,
]


def run(options: Run, builder: Builder = build) -> int:
    """Runs and writes, with estimators from `builder`.

    The exit code is 0, or InputError is raised after what was computed has been written.
    """
    sequence = options.open(options.source)
    methods = _asked(options, sequence)
    # An integration is measured between the stereo poses that it asks for; those are computed anyway.
    playback = Playback(sequence, with_asked(methods), options.config, builder)
    warmup.start(methods, options.config)
    folder = RunFolder(options.out or _default_folder(sequence.name))
    folder.remove(OUTPUTS)
    told = {"methods": list(methods), "frame": options.frame, "seed": options.seed}
    told |= {"stereo_every": options.stereo_every, "video_scale": options.video_scale}
    told |= {"max_exposures": options.max_exposures, "recording": options.recording}
    told |= {"camera": None if options.camera is None else str(options.camera)}
    source, statistics = without_secrets(options.source), RunStatistics()
    folder.write("run.yaml", run_text(source, sequence, told, options.config))
    folder.write("rig.yaml", rig_text(sequence.rig))
    try:
        finished = _play(playback, methods, options, folder, statistics)
        _require_poses(source, finished, methods)
    except BaseException as error:
        with suppress(InputError):
            folder.write("run.yaml", run_text(source, playback.sequence, told, options.config))
        folder.failed(_reason(error, playback))
        raise
    finally:
        if sequence.stop is not None:
            sequence.stop()
    seen = statistics.images.hexdigest()
    folder.write("run.yaml", run_text(source, playback.sequence, told, options.config, seen))
    folder.complete()
    _tell(folder, playback.sequence)
    return 0


def _asked(options: Run, sequence: Sequence) -> tuple[str, ...]:
    """The methods to run; InputError where the rig lacks the camera of the asked frame."""
    methods = in_order(options.methods) or default_methods(sequence.rig, options.variant or "modern")
    require_cameras(methods, sequence.rig)
    if options.frame != "rig" and getattr(sequence.rig, options.frame) is None:
        raise InputError(f"--frame is {options.frame}, but {options.source} has no such camera: give another frame")
    return methods


def _default_folder(name: str) -> Path:
    plain = re.sub(r"[^\w]+", "-", name).strip("-")
    return Path("recordings") / f"{plain}-{datetime.now():%Y%m%d-%H%M%S}"


def _play(
    playback: Playback, methods: tuple[str, ...], options: Run, folder: RunFolder, statistics: RunStatistics
) -> Finished:
    """Steps through the sequence. Whatever ends that, what was computed is written."""
    memories = MapCollectors()
    with ExitStack() as stack:
        record = None
        if options.recording:
            from .rerun_log.file_recording import FileRecording  # brings Rerun

            record = stack.enter_context(FileRecording(folder.path / RECORDING, playback.opened))
        log = stack.enter_context(StepLog(folder))
        if playback.sequence.prepare:
            playback.sequence.prepare(0)
        try:
            total = len(playback.sequence) if playback.sequence.grow is None else options.max_exposures
            _compiled()
            with _terminable(), _ended_by_interrupt(playback.sequence), _progress(total) as advance:
                while playback.more():
                    event = playback.step()
                    statistics.add(event)
                    memories.add(event.steps)
                    log.add(event)
                    if record:
                        record.write(event)
                    advance()
        finally:
            finished = playback.finish()
            if record:
                record.write(finished)
            _write(playback, finished, methods, options, folder, statistics)
            maps = memories.scenes(finished.trajectories, methods, playback.sequence.rig)
            folder.write(LANDMARKS, map_bytes(maps))
    if record and record.failure:
        raise InputError(record.failure)
    return finished


def _write(
    playback: Playback,
    finished: Finished,
    methods: tuple[str, ...],
    options: Run,
    folder: RunFolder,
    statistics: RunStatistics,
) -> None:
    rig, frame = playback.sequence.rig, options.frame
    for method in methods:
        unit_m = 1.0
        if registered(method).unit == "own":
            unit_m = finished.placements[method].scale if method in playback.placed_methods else None
        folder.write(f"{method}.tum", tum_text(in_frame(finished.trajectories[method], rig, frame, unit_m)))
    if playback.truth is not None:
        folder.write("truth.tum", tum_text(in_frame(playback.truth, rig, frame)))
    folder.write("metrics.json", metrics_text(playback.opened, finished, methods, statistics))


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


def _tell(folder: RunFolder, sequence: Sequence) -> None:
    lines = [*sequence.notes, summary(json.loads((folder.path / "metrics.json").read_text())), f"in {folder.path}"]
    sys.stdout.write("\n".join(lines) + "\n")


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM ends the loop as Ctrl-C does, so that what was computed is written."""

    def stop(*_: object) -> None:
        raise SystemExit(TERMINATED)

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not in the main thread: whoever started it there handles signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _ended_by_interrupt(sequence: Sequence) -> Iterator[None]:
    """The first Ctrl-C ends the recording of a live source; what came so far is still run. A second one ends that."""
    if sequence.stop is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    stop, before = sequence.stop, signal.getsignal(signal.SIGINT)

    def end(*_: object) -> None:
        signal.signal(signal.SIGINT, before)
        stop()

    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _compiled() -> None:
    """Waits for numba's first compilation, and says so on a terminal."""
    if not warmup.finished():
        with Console(stderr=True).status(warmup.message()) as status:
            while not warmup.finished(0.5):
                status.update(warmup.message())


@contextmanager
def _progress(total: int | None):
    """Gives a function to call after each exposure; shows how far and how fast, on a terminal only."""
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.1f} frames/s,"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, TextColumn("left"), console=console, disable=not console.is_terminal) as bar:
        task, start, count = bar.add_task("", total=total, rate=0.0), time.monotonic(), 0

        def advance() -> None:
            nonlocal count
            count += 1
            bar.update(task, advance=1, rate=count / max(time.monotonic() - start, 1e-9))

        yield advance
