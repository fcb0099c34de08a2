"""The files of a run that are written as a whole: what it was, its trajectories, metrics and landmarks."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from typing import Any

from ispom.io.maps import map_bytes
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.io.whole import replace_whole
from ispom.sequences.address import without_secrets

from ...engine.events import Finished
from ...engine.model.corrections import CorrectionMemory, corrected_text
from ...engine.model.map_memory import MapCollectors
from ...engine.run_events.table import events_text
from ...engine.run_folder.results import Results, in_frame, metrics_text, trajectory_files
from ...engine.run_folder.run_file import run_file
from ...engine.run_folder.run_folder import CORRECTED_RIG, EVENTS, LANDMARKS, METRICS, RIG, RUN, THUMBNAIL, TRUTH
from ...engine.run_folder.statistics import RunStatistics
from ...engine.run_folder.thumbnail import thumbnail
from .job import Job

_OPTIONS = ("frame", "seed", "stereo_every", "video_scale", "scale_calibration", "max_exposures", "until", "recording")


def write_inputs(job: Job) -> None:
    """The rig and the ground truth."""
    sequence, truth = job.playback.sequence, job.playback.truth
    job.folder.write(RIG, rig_text(sequence.rig))
    if truth is not None:
        job.folder.write(TRUTH, tum_text(in_frame(truth, sequence.rig, job.options.frame)))


def describe(job: Job, images_sha256: str | None = None) -> None:
    """run.yaml, as far as the run came; `images_sha256` is that of all images, once the run came to its end."""
    options, stop = job.options, job.watch.stop if images_sha256 else None
    used: dict[str, Any] = {"methods": list(job.methods)} | {name: getattr(options, name) for name in _OPTIONS}
    used |= {"camera": str(options.camera) if options.camera else None, "sensors": str(options.sensors)}
    used |= {"topics": list(options.topics)} if options.topics else {}
    config = {name: asdict(options.config.of(name)) for name in job.playback.methods}
    stopped = None if stop is None else {n: getattr(stop, n) for n in ("exposure", "time_ns", "values")}
    forked = job.origin.entries if job.origin is not None else []
    source = without_secrets(options.source)
    found = run_file(
        source, job.playback.sequence, used, config, images_sha256, forked, stopped, job.placements.entries
    )
    job.folder.write(RUN, found.text)


def write_results(
    job: Job, finished: Finished, statistics: RunStatistics, maps: MapCollectors, corrections: CorrectionMemory
) -> None:
    """Trajectories, metrics, landmarks, and the rig as the methods corrected it."""
    playback, sequence = job.playback, job.playback.sequence
    for method in job.methods:
        found = in_frame(finished.trajectories[method], sequence.rig, job.options.frame, playback.unit_m(method))
        for name, text in trajectory_files(method, found, statistics.segments(method)):
            job.folder.write(name, text)
    end_ns = int(sequence.times_ns[-1])
    results = Results(sequence.name, sequence.notes, sequence.rig, playback.truth, end_ns, finished.trajectories)
    job.folder.write(EVENTS, events_text(job.events.log.events))
    job.folder.write(METRICS, metrics_text(results, job.methods, statistics))
    job.folder.write(LANDMARKS, map_bytes(maps.scenes(finished.trajectories, job.methods, sequence.rig)))
    if (rig := corrections.of(sequence.rig)) is not None:
        job.folder.write(CORRECTED_RIG, corrected_text(rig))
    if picture := thumbnail(sequence, playback.position):
        with suppress(OSError):  # the run is whole without
            replace_whole(job.folder.path / THUMBNAIL, picture)
