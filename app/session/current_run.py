"""The run that the session is at: what computes it, and what is known of it so far."""

from __future__ import annotations

from threading import Thread

from ..run.events import Finished, Opened, Stepped
from ..run.history import History
from ..run.model import RunModel
from ..run.playback import Playback
from ..run.record import ExposureRecord


class CurrentRun:
    """A new one for each start. Stepped by the worker; `history` and `known_at` are for any thread."""

    def __init__(self, playback: Playback, memory_bytes: int) -> None:
        self.playback = playback
        self.opened: Opened = playback.opened
        self.history = History(memory_bytes)
        self._model = RunModel.start(self.opened.methods)

    def step(self) -> tuple[Stepped, ExposureRecord]:
        """Computes the next exposure and keeps what was said of it. InputError as `Playback.step`."""
        event = self.playback.step()
        record = ExposureRecord.of(event, self.history.last)
        self.history.append(record)
        # After the history: who finds an exposure in the model finds its record, too.
        self._model = self._model.after(record.index, record.time_ns, record.steps)
        return event, record

    def known_at(self, index: int) -> RunModel:
        """What was known after exposure `index`."""
        model, history = self._model, self.history
        return model if index + 1 >= len(history) else model.as_known_at(index, lambda i: history[i].steps)

    def finished_within(self, timeout_s: float) -> Finished | None:
        """The trajectories as of the last computed exposure, be the worker busy; None where that takes longer."""
        found: list[Finished] = []
        finishing = Thread(target=lambda: found.append(self.playback.finish()), name="finish", daemon=True)
        finishing.start()
        finishing.join(timeout_s)
        return found[0] if found else None

    def doing(self, source: str) -> str:
        """What takes its time when an exposure does."""
        if not source.startswith("sim:"):
            return "computing" if self.history else "compiling, then computing"
        return "rendering and computing" if self.history else "building the scene, then"

    @property
    def live(self) -> bool:
        """Whether more exposures come than are known now."""
        return self.playback.sequence.grow is not None

    def stop(self) -> None:
        """Of a live source: it records no more, and its camera is free; what came so far stays."""
        if self.playback.sequence.stop is not None:
            self.playback.sequence.stop()
