"""A run from its first exposure to its files: whatever ends it, what was computed is written."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

from ..run.console import progress, wait_for_compiler
from ..run.events import Finished
from ..run.folder.journal import PoseJournal
from ..run.folder.run_folder import trajectory_file
from ..run.folder.statistics import RunStatistics
from ..run.folder.step_log import StepLog
from ..run.model.corrections import CorrectionMemory
from ..run.model.map_memory import MapCollectors
from ..run.signals import Signals, ended_by_interrupt
from .job import Job
from .output import write_results
from .recording import NoRecording, Recording


@dataclass(frozen=True, eq=False)
class Played:
    """A run that came to its end, or to the exposure that --until stopped it at."""

    finished: Finished
    images_sha256: str
    """Of all images that the estimators saw."""
    failure: str | None
    """Why the recording ended early, one sentence; None where it did not."""


def play(job: Job, signals: Signals) -> Played:
    """Steps through the sequence. Raises what ends that early, after what was computed has been written."""
    playback, folder, maps, statistics = job.playback, job.folder, MapCollectors(), RunStatistics()
    corrections = CorrectionMemory()
    with ExitStack() as stack:
        record = stack.enter_context(Recording(job, signals) if job.options.recording else NoRecording())
        log, journal = stack.enter_context(StepLog(folder)), PoseJournal(folder, playback.unit_m)
        if playback.sequence.prepare:
            playback.sequence.prepare(0)
        total = len(playback.sequence) if playback.sequence.grow is None else job.options.max_exposures
        try:
            wait_for_compiler()
            with ended_by_interrupt(playback.sequence), progress(total, job.quiet) as advance:
                while playback.more():
                    event = playback.step()
                    maps.add(event.steps)
                    corrections.add(event.steps)
                    for consumer in (statistics, log, journal, record, job.placements, job.watch):
                        consumer.add(event)
                    advance()
                    signals.check()
                    if job.watch.stop is not None:
                        playback.end()
        finally:
            signals.hold()
            finished = playback.finish()
            record.add(finished)
            write_results(job, finished, statistics, maps, corrections)
            journal.close(keep=not all((folder.path / trajectory_file(m)).exists() for m in job.methods))
    signals.check()
    return Played(finished, statistics.images.hexdigest(), record.failure)
