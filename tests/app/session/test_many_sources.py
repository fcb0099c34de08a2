"""Sources that are opened one after the other leave nothing behind but the runs that are kept: no thread, no file."""

from __future__ import annotations

import gc
import sys
import weakref
from pathlib import Path

import psutil
import pytest
from ispom_app.features.recording.commands import Record, StopRecording
from ispom_app.session import commands as do
from ispom_app.session.branches import kept
from ispom_app.views.rerun.live import LiveStream

from ispom.types import Sequence
from tests.app.helpers import open_source, started, wait_for
from tests.sequences.kitti_folder import make_drive

KEPT, WARM, COUNT = 2, 5, 12
"""How many runs stay; after how many sources all that one needs was there once; and how many are opened in all."""
LATE = (COUNT - WARM) // 2
"""Threads and files that libraries may still add after the first ones, less than one for each source."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows counts handles")
def test_sources_that_were_opened_before_leave_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST_KEPT", KEPT)
    drives = [str(make_drive(tmp_path / f"drive{n}", frames=4)) for n in range(2)]
    process = psutil.Process()
    session = started(tmp_path / "recordings", drives[0], opener=open_source, live=LiveStream(), autoplay=False)
    sequences: list[weakref.ref[Sequence]] = []

    def counts() -> tuple[int, int]:
        return process.num_threads(), process.num_fds()

    def record() -> None:
        session.post(do.Seek(3))
        wait_for(lambda: session.state.computed >= 3, "some frames")
        session.post(Record(""))
        session.post(StopRecording())
        wait_for(lambda: len(list((tmp_path / "recordings").glob("*.rrd"))) == len(sequences), "a recording")

    most = (0, 0)
    for n in range(COUNT):
        if n:
            session.post(do.Open(drives[n % 2]))
            wait_for(lambda n=n: session.state.run > n, "another source")
        wait_for(lambda: session.state.phase == "ready" and session.run is not None, "a source")
        assert session.run is not None
        sequences.append(weakref.ref(session.run.playback.sequence))
        record()
        if n < WARM:
            most = tuple(map(max, most, counts()))
    wait_for(
        lambda: all(now <= before + LATE for now, before in zip(counts(), most, strict=True)),
        f"about as many threads and files as before, {most}",
    )

    def alive() -> list[int]:
        gc.collect()
        return [n for n, ref in enumerate(sequences) if ref() is not None]

    wait_for(lambda: alive() == [*range(COUNT - 1 - KEPT, COUNT)], "the runs before to be freed")
    assert session.close(5.0)
