"""The worker that owns one run: commands in, states out. It computes, keeps the history and feeds the recorders."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.methods import Config, Variant, default_methods, in_order, possible_methods
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from ..options import SourceOptions
from ..run import warmup
from ..run.events import Finished, Opened
from ..run.history import MEMORY_BYTES, History
from ..run.model import RunModel
from ..run.playback import Builder, Playback
from ..subscribers import Subscribers
from . import commands as do
from .current_run import CurrentRun
from .folders import Folders
from .recent import RecentSources
from .recording_desk import RecordingDesk
from .recordings import list_recordings
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
from .viewers import EventSink, Viewers

log = logging.getLogger(__name__)
IDLE_S = 0.5
WATCH_S = 0.05
"""How often a recording is looked at while nothing else happens."""
CLOSE_S = 1.0
"""For a recording to be closed at the end."""


class Session:
    """One thread; `post` and `state` are for all others, and neither ever waits."""

    def __init__(
        self,
        opener: Callable[..., Sequence],
        source: str,
        recordings_dir: Path,
        *,
        methods: tuple[str, ...] | None = None,
        variant: Variant = "modern",
        config: Config | None = None,
        live: EventSink | None = None,
        autoplay: bool = True,
        compiling: Callable[[tuple[str, ...], Config], None] = lambda *_: None,
        builder: Builder = build,
        history_bytes: int = MEMORY_BYTES,
        source_options: SourceOptions | None = None,
        folders: Folders | None = None,
        recent: RecentSources | None = None,
    ) -> None:
        """`opener(source)` opens the source as the command line said, `opener(source, options)` as the page says.

        `methods` None means all that the source has the cameras for; `compiling` begins to compile what settings
        need, when they are about to run; `builder` makes the estimators; `history_bytes` is what the exposures of a run
        may take of memory; `folders` is where the page may look for sources, and `recent` keeps those that were opened.
        """
        self._recent = recent or RecentSources(None)
        self.folders = folders or Folders()
        shaped = source_options or SourceOptions()
        self.state = State(
            without_secrets(source), config=config or Config(), source_options=shaped, recent=self._recent.names
        )
        self.changes = Subscribers()
        """Called, in the worker's thread, at each new state."""
        self.run: CurrentRun | None = None
        """The run that is on the screen. Another object for each start: readers take it once, and stay with it."""
        self._first = source
        self._opener, self._wanted, self._autoplay = opener, methods, autoplay
        self.recordings_dir = recordings_dir
        self._compiling, self._unready = compiling, False
        self._builder, self._history_bytes = builder, history_bytes
        self._variant: Variant = variant
        self._viewers = Viewers(live, lambda text: self._emit(NoticeAdded(text)))
        self._recordings = RecordingDesk(recordings_dir)
        self._inbox: SimpleQueue[do.Command] = SimpleQueue()
        self._due_s = 0.0
        self._closing = False
        self._thread = Thread(target=self._run, name="session", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def post(self, command: do.Command) -> None:
        """Asks for something; what became of it shows in `state`."""
        self._inbox.put(command)

    @property
    def history(self) -> History:
        """Of the run that is on the screen; empty before the first."""
        return self.run.history if self.run is not None else History()

    @property
    def opened(self) -> Opened | None:
        return self.run.opened if self.run is not None else None

    def known_at(self, index: int) -> RunModel:
        """What was known after exposure `index` of the run that is on the screen."""
        return self.run.known_at(index) if self.run is not None else RunModel.start(())

    def close(self, timeout_s: float) -> bool:
        """Closes the recordings, the final trajectories included, and ends the worker.

        False where that is too busy: what was computed by then is recorded even so, within about CLOSE_S more.
        """
        self.post(do.Shutdown())
        self._thread.join(timeout_s)
        if not self._thread.is_alive():
            return True
        if self._recordings.busy:
            self._recordings.stop(self.run.finished_within(0.4 * CLOSE_S) if self.run is not None else None)
            self._recordings.close(0.6 * CLOSE_S)
        return False

    def _run(self) -> None:
        self._guarded(self._list_recordings)
        self._guarded(lambda: self._open(self._first))
        if self._autoplay and self.run is not None:
            self._emit(changed(playing=True))
        while not self._closing:
            self._guarded(self._turn)
        self._guarded(self._end)

    def _turn(self) -> None:
        for command in self._commands():
            self._guarded(lambda command=command: self._obey(command))
        self._guarded(self._advance)
        self._viewers.check()
        self._watch_compiling()
        self._watch_recordings()

    def _end(self) -> None:
        if self.run is not None:
            self.run.stop()
        self._stop_recording()
        self._recordings.close(CLOSE_S)

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
        idle = WATCH_S if self._recordings.busy else IDLE_S
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
        self.changes.notify()

    def _obey(self, command: do.Command) -> None:
        match command:
            case do.Play(on):
                self._play(not self.state.playing if on is None else on)
            case do.StepBy(count):
                target = self.state.target
                self._seek((self.state.index if target is None else target) + count)
            case do.Seek(index):
                self._seek(index)
            case do.Speed(factor):
                self._emit(changed(speed=factor))
                self._due_s = 0.0
            case do.Restart(methods, config):
                self._restart(methods, config)
            case do.Open(source, options):
                before = self.state.run
                self._open(source, options)
                if self.state.run != before:
                    self._emit(changed(playing=True))
            case do.Record(name):
                self._record(name)
            case do.StopRecording():
                self._stop_recording()
            case do.Hide(names):
                self._emit(changed(hidden=names))
            case do.Notify(text):
                self._emit(NoticeAdded(text))
            case do.Shutdown():
                self._closing = True

    # Opening and starting

    def _open(self, source: str, options: SourceOptions | None = None) -> None:
        """Opens another source; where that fails, the one before stays as it was."""
        before = self.state
        shown = without_secrets(source)
        if self.run is not None and self.run.live and shown == before.source:
            self.run.stop()  # a camera has to be let go before it can be opened again
        self._emit(Opening(shown))
        self._busy(f"opening {shown}")
        try:
            sequence = self._opener(source) if options is None else self._opener(source, options)
            methods = self._methods_for(source, sequence)
            playback = Playback(sequence, methods, before.config, self._builder)
        except InputError as mistake:
            self._opening_failed(before, str(mistake))
        except Exception as fault:
            log.exception("opening %s failed", shown)
            self._opening_failed(before, f"internal fault while opening {shown}: {type(fault).__name__}: {fault}")
        else:
            if self.run is not None:
                self.run.stop()
            self._begin(playback)
            shaped = options or self.state.source_options
            self._emit(changed(source_options=shaped, recent=self._recent.add(source)))

    def _methods_for(self, source: str, sequence: Sequence) -> tuple[str, ...]:
        """Those asked for; of a later source those of them that it has the cameras for, or else the usual ones."""
        possible, usual = possible_methods(sequence.rig), default_methods(sequence.rig, self._variant)
        if not possible:
            raise InputError(
                f"{without_secrets(source)} has neither a video camera nor a stereo pair: open another source"
            )
        wanted = self._wanted or usual
        return wanted if self.run is None else tuple(m for m in wanted if m in possible) or usual

    def _opening_failed(self, before: State, reason: str) -> None:
        if before.phase == "ready":
            self.state = before
            self._stop(reason)
        else:
            self._emit(OpeningFailed(reason))

    def _restart(self, methods: tuple[str, ...], config: Config) -> None:
        if self.run is None:
            raise InputError("there is nothing to run yet: open a source first")
        if not methods:
            raise InputError("no method is chosen: switch on at least one")
        sequence = self.run.playback.sequence
        playback = Playback(sequence, in_order(methods), config, self._builder)
        self._wanted = playback.methods
        self._emit(Opening(self.state.source))
        self._begin(playback)
        self._emit(changed(playing=True))

    def _begin(self, playback: Playback) -> None:
        self._stop_recording()
        self._compiling(playback.methods, playback.config)
        self._unready = not warmup.needed(playback.methods, playback.config) and not warmup.finished()
        run = self.run = CurrentRun(playback, self._history_bytes)
        self._due_s = 0.0
        if playback.sequence.prepare is not None:
            playback.sequence.prepare(0)
        self._viewers.open(run.opened, run.history)
        self._emit(run.opened)
        if self._unready:
            self._emit(NoticeAdded(warmup.MEANWHILE, "info"))

    # Moving

    def _play(self, on: bool) -> None:
        run = self.run
        if on and run is not None and run.playback.done and self.state.index >= self.state.total - 1 and run.history:
            self._emit(Displayed(run.history[0]))
        self._due_s = 0.0
        self._emit(changed(playing=on and run is not None, target=None))

    def _seek(self, index: int) -> None:
        if self.run is None:
            return
        index = min(max(index, 0), len(self.run.playback.sequence) - 1)
        if index < len(self.run.history):
            self._emit(Displayed(self.run.history[index]))
            self._emit(changed(playing=False, target=None))
        else:
            self._emit(changed(playing=False, target=index))

    def _advance(self) -> None:
        """One exposure on, where it is time for that."""
        run = self.run
        if run is None:
            self._emit(changed(playing=False, target=None))
        elif self.state.target is not None:
            self._compute(run)
            if self.state.target is not None and self.state.computed > self.state.target:
                self._emit(changed(target=None))
        elif self.state.playing and time.monotonic() >= self._due_s:
            if self.state.index + 1 < len(run.history):
                self._emit(Displayed(run.history[self.state.index + 1]))
            elif self._more(run):
                self._compute(run)
            elif run.playback.done:
                self._emit(changed(playing=False))
            self._schedule(run)

    def _more(self, run: CurrentRun) -> bool:
        """Whether there is an exposure to compute; a live source is waited for a while."""
        live = run.live
        found = run.playback.more(WATCH_S)
        if live:
            sequence = run.playback.sequence
            self._emit(changed(total=len(sequence), notes=sequence.notes))
            if run.playback.done:
                self._finish(run.playback.finish())
        return found

    def _schedule(self, run: CurrentRun) -> None:
        """When the next exposure is due at the chosen speed; time that was lost is not caught up."""
        times, i = run.playback.sequence.times_ns, self.state.index
        if self.state.speed is None or not 0 <= i < len(times) - 1:
            # As fast as possible: as fast as new exposures are computed, and the past no faster than eyes follow.
            self._due_s = time.monotonic() + (1 / 120 if i + 1 < len(run.history) else 0.0)
        else:
            gap_s = float(times[i + 1] - times[i]) * 1e-9 / self.state.speed
            self._due_s = max(time.monotonic(), self._due_s + gap_s)

    def _compute(self, run: CurrentRun) -> None:
        if warmup.needed(run.playback.methods, run.playback.config) and not warmup.finished(WATCH_S):
            before, text = self.state.activity, warmup.message()
            if before is None or not before.text.startswith(warmup.MESSAGE):
                self._busy(text)
            elif before.text != text:
                self._emit(changed(activity=Activity(text, before.since_s)))
            return
        self._busy(f"{run.doing(self.state.source)} exposure {run.playback.position}")
        event, record = run.step()
        self._emit(Computed(record))
        if event.skipped:
            self._emit(NoticeAdded(f"exposure {event.index} is skipped: {event.skipped}"))
        self._viewers.write(event)
        self._recordings.offer(event)
        if run.playback.done:
            self._finish(run.playback.finish())
        self._emit(changed(activity=None))

    def _finish(self, finished: Finished) -> None:
        self._viewers.write(finished)
        self._emit(finished)

    def _busy(self, text: str) -> None:
        self._emit(changed(activity=Activity(text, time.monotonic())))

    # Recording

    def _record(self, name: str) -> None:
        if self.run is None:
            raise InputError("there is nothing to record yet: open a source first")
        self._recordings.start(name, self.run)
        self._emit(changed(recording=self._recordings.info()))

    def _stop_recording(self) -> None:
        """The file is closed when all of the run so far is written, which may take a while."""
        if self._recordings.recording and self.run is not None:
            self._recordings.stop(self.run.playback.finish() if self.run.history else None)

    def _watch_compiling(self) -> None:
        """Tells that what this run did not wait for is ready, be the run still going on or not."""
        compiling = "" if warmup.finished() else warmup.message()
        if compiling != self.state.compiling:
            self._emit(changed(compiling=compiling))
        if self._unready and not compiling:
            self._unready = False
            self._emit(NoticeAdded(warmup.READY, "info"))

    def _watch_recordings(self) -> None:
        """Shows how a recording goes, and what became of it."""
        ended = self._recordings.ended()
        if (info := self._recordings.info()) != self.state.recording:
            self._emit(changed(recording=info))
        for writer in ended:
            if writer.failure:
                self._emit(NoticeAdded(f"recording {writer.path.name} stopped: {writer.failure}"))
        if ended:
            self._list_recordings()

    def _list_recordings(self) -> None:
        self._emit(changed(recordings=list_recordings(self.recordings_dir)))
