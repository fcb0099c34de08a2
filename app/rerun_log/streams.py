"""Batches of a run -> a Rerun stream, wherever that leads."""

from __future__ import annotations

import numpy as np
import rerun as rr

from .batch import Batch, Columns

APPLICATION = "ispom"


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
