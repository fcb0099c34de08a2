"""Sends the batches of a run to a Rerun stream."""

from __future__ import annotations

from threading import Lock

import numpy as np
import rerun as rr
import rerun_bindings as bindings

from .batch import Batch, Columns

APPLICATION = "ispom"


_gate = Lock()
_pipes: list[None] = []
"""One entry for each stream that writes into a pipe which a thread of this program empties; guarded by the lock."""


def pipe_begins() -> None:
    """Must be called before a stream writes into a pipe of this program."""
    with _gate:
        _pipes.append(None)


def pipe_ends() -> None:
    """Must be called when no stream writes into that pipe any more."""
    with _gate:
        _pipes.pop()


def release_streams() -> None:
    """Ends the threads of streams without references, two for each. Rerun itself does so only when it is
    initialised again.

    It does nothing while a stream writes into a pipe, which could be a deadlock: Rerun flushes all streams for this,
    and locks its list of them. A thread that makes a stream waits for that list and keeps Python's lock, without which
    no thread can empty the pipe.
    """
    with _gate:
        if not _pipes:
            bindings.flush_and_cleanup_orphaned_recordings()


def send(stream: rr.RecordingStream, batch: Batch) -> None:
    """Logs a batch at its instant, from this thread."""
    stream.set_time("exposure", sequence=batch.index)
    stream.set_time("time", duration=np.timedelta64(batch.since_start_ns, "ns"))
    for entry in batch.entries:
        if isinstance(entry, Columns):
            _send_columns(stream, entry)
        else:
            stream.log(entry.path, entry.value, static=entry.static)


def _send_columns(stream: rr.RecordingStream, columns: Columns) -> None:
    trajectory = columns.trajectory
    times = [
        rr.TimeColumn("exposure", sequence=columns.indices),
        rr.TimeColumn("time", duration=(trajectory.times_ns - columns.first_ns).astype("timedelta64[ns]")),
    ]
    if columns.values is not None:
        stream.send_columns(columns.path, times, rr.Scalars.columns(scalars=columns.values))
        return
    poses = rr.Transform3D.columns(translation=trajectory.translations, quaternion=trajectory.xyzw)
    stream.send_columns(columns.path, times, poses)
