"""A short drive made long, for measurements that need many exposures of a real camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.types import Sequence, Trajectory


def to_and_fro(drive: Sequence, count: int) -> Sequence:
    """The drive forwards, backwards, forwards ..., its images read again each time."""
    stamps, first = np.unique(drive.times_ns, return_index=True)
    together = np.split(np.arange(len(drive)), first[1:])  # a pair and the video frame of the same time
    there = np.arange(len(stamps))
    turns = np.resize(np.concatenate([there, there[-2:0:-1]]), count)
    way = np.concatenate([together[i] for i in turns])[:count]
    new_ns = np.arange(count) * int(np.median(np.diff(stamps)))
    times_ns = np.concatenate([np.full(len(together[i]), t) for i, t in zip(turns, new_ns, strict=True)])[:count]
    truth = drive.truth
    if truth is not None:
        poses = [truth.at(int(stamps[i])) for i in turns]
        truth = Trajectory.of([(int(t), pose) for t, pose in zip(new_ns, poses, strict=True) if pose is not None])
    return replace(
        drive,
        name=f"{drive.name} to and fro",
        times_ns=times_ns,
        kinds=tuple(drive.kinds[i] for i in way),
        load=lambda i: replace(drive[int(way[i])], time_ns=int(times_ns[i])),
        truth=truth,
    )
