"""A run from its first frame to its files: whatever ends it, what was computed is written."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Self

from ispom.errors import InputError
from ispom.stop import LOOK_S

from ...engine.events import Event, Finished
from ...engine.memory import peak_mb, reset_peak
from ...engine.model.corrections import CorrectionMemory
from ...engine.model.map_memory import MapCollectors
from ...engine.run_folder.journal import PoseJournal
from ...engine.run_folder.run_folder import RECORDING, trajectory_file
from ...engine.run_folder.statistics import RunStatistics
from ...engine.run_folder.step_log import StepLog
from ...engine.signals import Signals
from .console import wait_for_compiler
from .job import Job
from .output import write_results


class NoRecording:
    """The default."""

    failure: str | None = None
    """Why the recording ended early, one sentence; None where it did not."""

    def add(self, event: Event) -> None: ...
    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...


class Recording(NoRecording):
    """run.rrd, as far as the disk takes it; the run goes on without."""

    def __init__(self, job: Job, signals: Signals) -> None:
        from ...views.rerun.file_recording import FileRecording  # brings Rerun

        self._file: FileRecording | None = None
        self._signals = signals
        try:
            self._file = FileRecording(job.folder.path / RECORDING, job.playback.opened)
        except InputError as error:
            self.failure = str(error)

    def add(self, event: Event) -> None:
        if self._file is not None:
            self._file.write(event)

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close(self._signals.overdue)
            self.failure = self._file.failure


@dataclass(frozen=True, eq=False)
class Played:
    """A run that came to its end, or to the frame that --until stopped it at."""

    finished: Finished
    statistics: RunStatistics
    failure: str | None
    """Why the recording ended early, one sentence; None where it did not."""


class Steps:
    """The frames of a run, one at a time, and what is kept of each."""

    def __init__(self, job: Job, signals: Signals, until_end: ExitStack) -> None:
        """Files stay open until `until_end` is closed."""
        self._playback, self.maps, self.statistics = job.playback, MapCollectors(), RunStatistics()
        self.events, self._computes = job.events, job.computes
        self.corrections = CorrectionMemory()
        recording = Recording(job, signals) if job.options.recording else NoRecording()
        self.record, log = until_end.enter_context(recording), until_end.enter_context(StepLog(job.folder))
        self.journal = PoseJournal(job.folder, job.playback.unit_m)
        self._consumers = (self.statistics, self.events, log, self.journal, self.record)
        self._consumers += (job.placements, job.watch, job.seen)

    def step(self) -> None:
        event = self._playback.step()
        if event.steps and self._computes:
            self.statistics.cpu_ms.append(1000 * self._playback.cpu_s)
        self.maps.add(event.steps)
        self.corrections.add(event.steps)
        for consumer in self._consumers:
            consumer.add(event)


def play(job: Job, signals: Signals) -> Played:
    """Steps through the sequence. Raises what ends that early, after what was computed has been written."""
    playback, folder = job.playback, job.folder
    reset_peak()
    with ExitStack() as stack:
        steps = Steps(job, signals, stack)
        if playback.sequence.prepare:
            playback.sequence.prepare(0)
        total = len(playback.sequence) if playback.sequence.grow is None else job.options.max_exposures
        try:
            wait_for_compiler()
            with signals.first_ends(playback.sequence.stop), job.progress(total) as advance:
                while not playback.done:
                    signals.check()
                    if not playback.more(LOOK_S):
                        continue
                    steps.step()
                    advance()
                    if job.watch.stop is not None:
                        playback.end()
                signals.check()
        finally:
            signals.hold()
            finished = job.seen.finished = playback.finish()
            steps.record.add(finished)
            steps.statistics.peak_mb = peak_mb() if job.computes else None
            write_results(job, finished, steps.statistics, steps.maps, steps.corrections)
            steps.journal.close(keep=not all((folder.path / trajectory_file(m)).exists() for m in job.methods))
    signals.check()
    return Played(finished, steps.statistics, steps.record.failure)
