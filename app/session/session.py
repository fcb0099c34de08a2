"""The worker that owns one run: commands in, states out. It computes, keeps the history and feeds the recorders."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Protocol

from ispom.errors import InputError
from ispom.estimators import ALL_METHODS, Config, Method, Variant, build, default_methods, possible_methods
from ispom.types import Sequence

from ..run import warmup
from ..run.events import Finished, Opened, Stepped
from ..run.playback import Builder, Playback
from ..run.record import ExposureRecord
from . import commands as do
from .recordings import RecordingWriter, list_recordings, recording_path
from .state import (
    Activity,
    Computed,
    Displayed,
    Event,
    NoticeAdded,
    Opening,
    OpeningFailed,
    State,
    changed,
    reduce,
)

log = logging.getLogger(__name__)
IDLE_S = 0.5
WATCH_S = 0.05
"""How often a recording is looked at while nothing else happens."""
CLOSE_S = 1.0
"""For a recording to be closed at the end."""


class EventSink(Protocol):
    """Where viewers in the browser get the run from. Never blocks."""

    def open(self, opened: Opened) -> None: ...
    def write(self, event: Stepped | Finished) -> None: ...


class Session:
    """One thread; `post` and `state` are for all others, and neither ever waits."""

    def __init__(
        self,
        opener: Callable[[str], Sequence],
        source: str,
        recordings_dir: Path,
        *,
        methods: tuple[Method, ...] | None = None,
        config: Config | None = None,
        live: EventSink | None = None,
        autoplay: bool = True,
        compiling: Callable[[Config], None] = lambda _: None,
        builder: Builder = build,
    ) -> None:
        """`methods` None means all that the source has the cameras for; `compiling` begins to compile what settings
        need, when they are about to run; `builder` makes the estimators."""
        self.state = State(source, config=config or Config())
        self.history: list[ExposureRecord] = []
        """Only ever appended to, and replaced by a new list when a run starts: safe to read from any thread."""
        self.truth: Any = None
        self.opened: Opened | None = None
        self._opener, self._wanted, self._live, self._autoplay = opener, methods, live, autoplay
        self._folder, self._compiling, self._unready = recordings_dir, compiling, False
        self._builder = builder
        self._inbox: SimpleQueue[do.Command] = SimpleQueue()
        self._playback: Playback | None = None
        self._writer: RecordingWriter | None = None
        self._due_s = 0.0
        self._closing = False
        self._thread = Thread(target=self._run, name="session", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def post(self, command: do.Command) -> None:
        """Asks for something; what became of it shows in `state`."""
        self._inbox.put(command)

    def close(self, timeout_s: float) -> bool:
        """Closes the recording and ends the worker; False where that is too busy: the recording is closed even so."""
        self.post(do.Shutdown())
        self._thread.join(timeout_s)
        if not self._thread.is_alive():
            return True
        if self._writer is not None:
            self._writer.close(CLOSE_S)
        return False

    def _run(self) -> None:
        self._list_recordings()
        self._open(self.state.source)
        if self._autoplay and self._playback is not None:
            self._emit(changed(playing=True))
        while not self._closing:
            for command in self._commands():
                self._guarded(lambda command=command: self._obey(command))
            self._guarded(self._advance)
            self._watch_compiling()
            self._watch_recording()
        self._end_live()
        if self._writer is not None:
            self._writer.close(CLOSE_S)

    def _commands(self) -> list[do.Command]:
        """All that were posted, of seeks the newest only; waits for the first where there is nothing else to do."""
        found: list[do.Command] = []
        try:
            found.append(
                self._inbox.get(timeout=self._patience()) if self._patience() > 0 else self._inbox.get_nowait()
            )
            while True:
                found.append(self._inbox.get_nowait())
        except Empty:
            pass
        seeks = [i for i, command in enumerate(found) if isinstance(command, do.Seek)]
        return [command for i, command in enumerate(found) if i not in seeks[:-1]]

    def _patience(self) -> float:
        if self.state.target is not None:
            return 0.0
        idle = IDLE_S if self._writer is None else WATCH_S
        return min(idle, max(0.0, self._due_s - time.monotonic())) if self.state.playing else idle

    def _guarded(self, work: Callable[[], None]) -> None:
        """A user's mistake is told; anything else is a fault of the program: told, logged, and the worker lives on."""
        try:
            work()
        except InputError as mistake:
            self._stop(str(mistake))
        except Exception as fault:
            log.exception("the session worker failed")
            self._stop(f"internal fault, please report it: {type(fault).__name__}: {fault}")

    def _stop(self, reason: str) -> None:
        self._emit(changed(playing=False, target=None, activity=None))
        self._emit(NoticeAdded(reason))

    def _emit(self, event: Event) -> None:
        self.state = reduce(self.state, event)

    def _obey(self, command: do.Command) -> None:
        match command:
            case do.Play(on):
                self._play(not self.state.playing if on is None else on)
            case do.StepBy(count):
                self._seek(self.state.index + count)
            case do.Seek(index):
                self._seek(index)
            case do.Speed(factor):
                self._emit(changed(speed=factor))
                self._due_s = 0.0
            case do.Restart(methods, config):
                self._restart(methods, config)
            case do.Open(source):
                self._open(source)
            case do.Record(name):
                self._record(name)
            case do.StopRecording():
                self._stop_recording()
            case do.Hide(names):
                self._emit(changed(hidden=names))
            case do.Shutdown():
                self._closing = True

    # Opening and starting

    def _open(self, source: str) -> None:
        """Opens another source; where that fails, the one before stays as it was."""
        before = self.state
        self._end_live()
        self._emit(Opening(source))
        self._busy(f"opening {source}")
        try:
            sequence = self._opener(source)
            playback = Playback(
                sequence, self._methods_for(source, sequence, before.config.variant), before.config, self._builder
            )
        except InputError as mistake:
            self._opening_failed(before, str(mistake))
        except Exception as fault:
            log.exception("opening %s failed", source)
            self._opening_failed(before, f"internal fault while opening {source}: {type(fault).__name__}: {fault}")
        else:
            self._begin(playback)

    def _methods_for(self, source: str, sequence: Sequence, variant: Variant) -> tuple[Method, ...]:
        """Those asked for; of a later source those of them that it has the cameras for, or else the usual ones."""
        possible, usual = possible_methods(sequence.rig, variant), default_methods(sequence.rig, variant)
        if not possible:
            raise InputError(f"{source} has neither a video camera nor a stereo pair: open another source")
        wanted = self._wanted or usual
        return wanted if self._playback is None else tuple(m for m in wanted if m in possible) or usual

    def _opening_failed(self, before: State, reason: str) -> None:
        if before.phase == "ready":
            self.state = before
            self._stop(reason)
        else:
            self._emit(OpeningFailed(reason))

    def _restart(self, methods: tuple[Method, ...], config: Config) -> None:
        if self._playback is None:
            raise InputError("there is nothing to run yet: open a source first")
        if not methods:
            raise InputError("no method is chosen: switch on at least one")
        playback = Playback(
            self._playback.sequence, tuple(m for m in ALL_METHODS if m in methods), config, self._builder
        )
        self._wanted = playback.methods
        self._emit(Opening(self.state.source))
        self._begin(playback)
        self._emit(changed(playing=True))

    def _begin(self, playback: Playback) -> None:
        self._stop_recording()
        self._compiling(playback.config)
        self._unready = not warmup.needed(playback.config) and not warmup.finished()
        self._playback, self.history, self._due_s = playback, [], 0.0
        opened = self.opened = playback.opened
        if playback.sequence.prepare is not None:
            playback.sequence.prepare(0)
        self._to_viewers(lambda live: live.open(opened))
        self._emit(opened)
        if self._unready:
            self._emit(NoticeAdded(warmup.MEANWHILE, "info"))

    # Moving

    def _play(self, on: bool) -> None:
        at_end = self._playback is not None and self._playback.done and self.state.index >= self.state.total - 1
        if on and at_end and self.history:
            self._emit(Displayed(self.history[0]))
        self._due_s = 0.0
        self._emit(changed(playing=on and self._playback is not None, target=None))

    def _seek(self, index: int) -> None:
        if self._playback is None:
            return
        index = min(max(index, 0), len(self._playback.sequence) - 1)
        if index < len(self.history):
            self._emit(Displayed(self.history[index]))
            self._emit(changed(playing=False, target=None))
        else:
            self._emit(changed(playing=False, target=index))

    def _advance(self) -> None:
        """One exposure on, where it is time for that."""
        if self.state.target is not None:
            self._compute()
            if self.state.target is not None and self.state.computed > self.state.target:
                self._emit(changed(target=None))
        elif self.state.playing and time.monotonic() >= self._due_s:
            if self.state.index + 1 < len(self.history):
                self._emit(Displayed(self.history[self.state.index + 1]))
            elif self._playback is not None and self._more(self._playback):
                self._compute()
            elif self._playback is None or self._playback.done:
                self._emit(changed(playing=False))
            self._schedule()

    def _more(self, playback: Playback) -> bool:
        """Whether there is an exposure to compute; a live source is waited for a while."""
        live = not playback.done and playback.sequence.grow is not None
        found = playback.more(WATCH_S)
        if live:
            self._emit(changed(total=len(playback.sequence), notes=playback.sequence.notes))
            if playback.done:
                self._finish(playback.finish())
        return found

    def _end_live(self) -> None:
        """A live source records no more, and its camera is free; what came so far stays."""
        if self._playback is not None and self._playback.sequence.stop is not None:
            self._playback.sequence.stop()

    def _schedule(self) -> None:
        """When the next exposure is due at the chosen speed; time that was lost is not caught up."""
        times, i = self._playback.sequence.times_ns if self._playback else (), self.state.index
        if self.state.speed is None or not 0 <= i < len(times) - 1:
            # As fast as possible: as fast as new exposures are computed, and the past no faster than eyes follow.
            self._due_s = time.monotonic() + (1 / 120 if i + 1 < len(self.history) else 0.0)
        else:
            gap_s = float(times[i + 1] - times[i]) * 1e-9 / self.state.speed
            self._due_s = max(time.monotonic(), self._due_s + gap_s)

    def _compute(self) -> None:
        assert self._playback is not None
        if warmup.needed(self._playback.config) and not warmup.finished(WATCH_S):
            if self.state.activity is None or self.state.activity.text != warmup.MESSAGE:
                self._busy(warmup.MESSAGE)
            return
        self._busy(f"{self._work} exposure {self._playback.position + 1}")
        event = self._playback.step()
        record = ExposureRecord.of(event, self.history[-1] if self.history else None)
        self.history.append(record)
        self._emit(Computed(record))
        if event.skipped:
            self._emit(NoticeAdded(f"exposure {event.index + 1} is left out: {event.skipped}"))
        self._to_viewers(lambda live: live.write(event))
        if self._writer is not None:
            self._writer.offer(event)
        if self._playback.done:
            self._finish(self._playback.finish())
        self._emit(changed(activity=None))

    @property
    def _work(self) -> str:
        """What takes its time when an exposure does."""
        if not self.state.source.startswith("sim:"):
            return "compiling, then computing" if not self.history else "computing"
        return "building the scene, then" if not self.history else "rendering and computing"

    def _finish(self, finished: Finished) -> None:
        self._to_viewers(lambda live: live.write(finished))
        self._emit(finished)

    def _to_viewers(self, action: Callable[[EventSink], None]) -> None:
        """A fault in what draws never stops what computes; the person is told once a run."""
        if self._live is None:
            return
        try:
            action(self._live)
        except Exception as fault:
            log.exception("the live stream failed")
            self._live = None
            self._emit(
                NoticeAdded(f"the Rerun viewer is no longer fed, the run goes on ({type(fault).__name__}: {fault})")
            )

    def _busy(self, text: str) -> None:
        self._emit(changed(activity=Activity(text, time.monotonic())))

    # Recording

    def _record(self, name: str) -> None:
        if self.opened is None:
            raise InputError("there is nothing to record yet: open a source first")
        if self._writer is not None:
            raise InputError(f"{self._writer.path.name} is being recorded: stop it before the next one")
        try:
            self._writer = RecordingWriter(
                recording_path(self._folder, name, self.opened.sequence.name), self.opened, self.history
            )
        except OSError as fault:
            raise InputError(
                f"{self._folder} cannot be written ({fault.strerror}): free it or choose another"
            ) from fault
        self._emit(changed(recording=self._writer.info))

    def _stop_recording(self) -> None:
        """The file is closed when all of the history so far is written, which may take a while."""
        if self._writer is not None and self._playback is not None:
            self._writer.stop(self._playback.finish() if self.history else None)

    def _watch_compiling(self) -> None:
        """Tells that what this run did not wait for is ready, be the run still going on or not."""
        if self._unready and warmup.finished():
            self._unready = False
            self._emit(NoticeAdded(warmup.READY, "info"))

    def _watch_recording(self) -> None:
        """Shows how the recording goes, and what became of it."""
        writer = self._writer
        if writer is None:
            return
        if not writer.done:
            if (info := writer.info) != self.state.recording:
                self._emit(changed(recording=info))
            return
        self._writer = None
        self._emit(changed(recording=None))
        if writer.failure:
            self._emit(NoticeAdded(f"recording {writer.path.name} stopped: {writer.failure}"))
        self._list_recordings()

    def _list_recordings(self) -> None:
        self._emit(changed(recordings=list_recordings(self._folder)))
