"""The app of `soak`, as a process of its own: it holds what a user's does, and nothing that only tests need.

`python -m tests.app.page.served_soak FOLDER SOURCE COUNT [BRANCH_AT]` forks there, with nothing changed, when the run
is over.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from ispom_app.engine.options import SourceOptions
from ispom_app.features.branches.commands import Fork
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.views.web.server import Serving, serve

from ispom.sequences import open_sequence
from ispom.types import Sequence, Trajectory


def serve_soak(folder: Path, source: str, count: int, branch_at: int | None = None) -> int:
    """The app, as a process of its own."""

    def opener(source: str, options: SourceOptions | None = None) -> Sequence:
        return to_and_fro(open_sequence(source), count)

    def session(live) -> Session:
        found = Session(SessionSetup(opener, source, folder), live)
        found.post(do.Speed(None))

        def fork() -> None:
            state = found.state
            if branch_at is not None and state.ended and state[Branches].shown == 0 and len(state[Branches].all) == 1:
                found.changes.remove(fork)
                found.post(do.Seek(branch_at - 1))
                found.post(Fork(state.methods, state.config))

        found.changes.add(fork)
        return found

    return serve(session, Serving(port=0, open_browser=False))


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


if __name__ == "__main__":
    sys.exit(serve_soak(Path(sys.argv[1]), sys.argv[2], *map(int, sys.argv[3:])))
