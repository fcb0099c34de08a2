"""run.rrd beside a run."""

from __future__ import annotations

from typing import Self

from ispom.errors import InputError

from ...engine.events import Event
from ...engine.run_folder.run_folder import RECORDING
from ...engine.signals import Signals
from .job import Job


class NoRecording:
    """Where none is asked for."""

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
