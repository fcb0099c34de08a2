"""A run of the session: its playback, its results so far, and states from which it can be forked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import replace
from threading import Thread

from ispom.errors import InputError
from ispom.methods import Config
from ispom.types import Trajectory

from ..engine.differences.compare import divergences, record_rows
from ..engine.events import Finished, Opened, Stepped
from ..engine.history.checkpoints import Checkpoint, Checkpoints
from ..engine.history.history import History, HistoryUsage, Past
from ..engine.history.record import ExposureRecord
from ..engine.history.series import Series
from ..engine.model.run_model import RunModel, Tally
from ..engine.playback import Playback
from ..engine.run_events.log import EventLog
from ..engine.run_folder.made_map import made_map
from .review.recorded_tracks import RecordedViews
from .review.stored import Stored

EXPOSURES_SHARE, STATES_SHARE = 0.1, 0.1
"""Shares of a run's memory for the newest frames, which are on disk as well and take a millisecond from there, and for
states to fork from. The rest is for what no count of arrays shows: all poses and points so far, the objects around
them, and what the allocator keeps for itself."""
REST_SHARE = 16
"""Factor by which the memory of a run is reduced while it is not on the screen."""


class CurrentRun:
    """One run; each start and each fork makes a new one. The worker steps it; any thread may use `history` and
    `known_at`."""

    def __init__(
        self,
        playback: Playback,
        memory_bytes: int,
        past: Past | None = None,
        checkpoints: Checkpoints | None = None,
        series: Series | None = None,
        events: EventLog | None = None,
        ahead: CurrentRun | None = None,
    ) -> None:
        """`past`, `series`, `events` and `checkpoints` are for a fork: the frames that it did not compute itself, their
        quantities and events, and saved states, at the last of which its playback begins. `ahead` is the recorded
        beginning of this run, which is used until its own frames are computed; its `series` and `events` are those of
        this run, too.
        """
        self.playback = playback
        self.opened: Opened = playback.opened
        self._memory_bytes, self._ahead = memory_bytes, ahead
        records = () if ahead is None else ahead.history
        self.history = History(memory_bytes, past=past, ahead=records)
        self.checkpoints = checkpoints or Checkpoints(memory_bytes)
        self.wake()
        self.series = series or Series(self.opened.methods)
        self.events = EventLog() if events is None else events
        origin = self.checkpoints.nearest(playback.position)
        self._model = RunModel.start(self.opened.methods) if origin is None else origin.model.of(self.opened.methods)
        self._tally = Tally() if origin is None else origin.tally
        if past is not None:
            for index in range(playback.position, len(past)):
                self._learn(past[index])
        self.stored: Stored | None = None
        """The stored run that it was read from; None for a run that is computed here."""
        self.recorded: RecordedViews | None = None
        """Images and tracks of the stored run that this run is, or from which it was forked; else None."""
        self._own_events = EventLog()
        """Events of the recorded frames that are computed by now."""
        self._coming: Future[Stepped] | None = None
        """The next frame, while it is computed in another thread."""

    @staticmethod
    def of_stored(stored: Stored, memory_bytes: int) -> CurrentRun:
        """Returns a run that is over: its frames are read, not computed. InputError where they cannot be read."""
        history, series, events = History(0), Series(stored.methods), EventLog()
        for record in stored.records():
            history.append(record)
            events.append(record, *series.append(record))
        past = Past(history, len(history), stored.playback.methods)
        run = CurrentRun(stored.playback, memory_bytes, past, None, series, events)
        run.stored = stored
        run.recorded = RecordedViews(stored.recording) if stored.recording is not None else None
        recording_id = stored.recording_id or run.opened.recording_id
        run.opened = replace(
            run.opened, recording_id=recording_id, map=made_map(stored.path), image_sizes=stored.image_sizes
        )
        run._model = run._model.with_final({m: t for m, t in stored.final.items() if m in past.methods})
        return run

    @staticmethod
    def begun_by(stored: Stored, memory_bytes: int) -> CurrentRun:
        """Returns a run that begins with the frames of a stored run. It is computed from its first frame on, and each
        frame is shown as recorded until it is computed. InputError where the recorded frames cannot be read."""
        before = CurrentRun.of_stored(stored, memory_bytes)
        run = CurrentRun(stored.playback, memory_bytes, None, None, before.series, before.events, before)
        run.recorded = before.recorded
        return run

    def forked(self, at: int, methods: tuple[str, ...], config: Config) -> CurrentRun:
        """Returns a run that is the same as this one up to the computed frame `at`, and has these methods and settings
        after. InputError as `Playback.forked`."""
        self.require_source()
        checkpoints = self.checkpoints.until(at)
        nearest = checkpoints.nearest(at)
        playback = self.playback.forked(at, methods, config, nearest.snapshot if nearest is not None else None)
        past, series = Past(self.history, at, playback.methods), self.series.until(at, playback.methods)
        events = self.events.until(at, playback.methods)
        fork = CurrentRun(playback, self._memory_bytes, past, checkpoints, series, events)
        fork.recorded = self.recorded
        return fork

    def require_source(self) -> None:
        """Raises InputError where nothing can be computed again."""
        if self.stored is not None and self.stored.unavailable:
            raise InputError(self.stored.unavailable)

    @property
    def done(self) -> bool:
        """Returns whether no frame is left to compute. A run that was read is always done; only its forks go on."""
        ended = self.playback.sequence.grow is None and self.history.computed >= len(self.playback.sequence)
        return ended or self.stored is not None

    @property
    def last(self) -> int:
        """Returns the last frame that can be shown, computed or not."""
        return (len(self.history) if self.stored is not None else len(self.playback.sequence)) - 1

    @property
    def catching_up(self) -> bool:
        """Returns whether known frames must be replayed to reach the state with which a fork begins."""
        return not self.done and self.playback.position < self.history.computed

    @property
    def recorded_frames(self) -> range | None:
        """Returns the frames that are known only from a recording; they become fewer as frames are computed. None for a
        run that did not begin with a recording."""
        return None if self._ahead is None else range(self.history.computed, len(self._ahead.history))

    def is_recorded(self, index: int) -> bool:
        """Returns whether a frame is known only from a recording, and is computed soon."""
        return index in (self.recorded_frames or ())

    @property
    def _recording(self) -> CurrentRun | None:
        """Returns the recorded beginning while it has more frames than are computed; else None."""
        return self._ahead if self.recorded_frames else None

    def catch_up(self) -> str:
        """Replays one known frame. InputError as `Playback.step`.

        Returns a sentence if the result differs from that of the stored run, else an empty text.
        """
        before = self.history[self.playback.position]
        event = self.playback.step()
        if before.stored is None:
            return ""
        methods = frozenset(step.method for step in before.steps)
        stored, made = record_rows(before, methods), record_rows(ExposureRecord.of(event, None), methods)
        found = next(divergences(stored, made, tuple(methods)), None)
        if found is None:
            return ""
        return (
            f"the replay is not the stored run: {min(found.names)} differs at frame {event.index}, by other images, "
            "another version or another machine; what is computed from here on follows the replay"
        )

    def begin_step(self) -> bool:
        """Begins to compute the next frame in another thread, if that has not begun. Returns whether it is finished, so
        that `step` does not wait."""
        if self._coming is None:
            sequence, position = self.playback.sequence, self.playback.position
            if position == 0 and sequence.prepare is not None:
                sequence.prepare(0)
            self.checkpoints.offer(position, self._checkpoint)
            self._coming = Future()
            Thread(target=_fulfil, args=(self._coming, self.playback.step), name="behind", daemon=True).start()
        return self._coming.done()

    def step(self) -> tuple[Stepped, ExposureRecord]:
        """Computes the next frame and stores its results. Raises InputError as `Playback.step`."""
        if self._coming is not None:
            coming, self._coming = self._coming, None
            event = coming.result()
        else:
            self.checkpoints.offer(self.playback.position, self._checkpoint)
            event = self.playback.step()
        record = ExposureRecord.of(event, self.history.last)
        self.history.append(record)
        if self._ahead is not None and record.index < len(self._ahead.history):
            self._own_events.append(record, *self.series.replace(record))
            if not self.recorded_frames:
                self.events = self._own_events
        else:
            self.events.append(record, *self.series.append(record))
        # After the history: a frame that is in the model must have its record.
        self._learn(record)
        return event, record

    @property
    def history_usage(self) -> HistoryUsage:
        """Memory and states of the run."""
        history, states = self.history, self.checkpoints
        return HistoryUsage(
            in_memory=history.in_memory,
            exposures_bytes=history.used_bytes,
            points_from=history.kept_points,
            states=len(states),
            states_bytes=states.used_bytes,
            interval=states.interval,
        )

    def _learn(self, record: ExposureRecord) -> None:
        self._model = self._model.after(record.index, record.time_ns, record.steps)
        self._tally = self._tally.after(record.steps)

    def _checkpoint(self) -> Checkpoint:
        return Checkpoint(self.playback.snapshot, self._model, self._tally)

    @property
    def model(self) -> RunModel:
        """What is known now."""
        return self._recording.model if self._recording is not None else self._model

    @property
    def tally(self) -> Tally:
        """Counts of all frames that are known."""
        return self._recording.tally if self._recording is not None else self._tally

    def known_at(self, index: int) -> RunModel:
        """What was known after frame `index`."""
        if self._ahead is not None and self.is_recorded(index):
            return self._ahead.known_at(index)
        model, history = self._model, self.history
        return model if index + 1 >= history.computed else model.as_known_at(index, lambda i: history[i].steps)

    def trajectories(self) -> Mapping[str, Trajectory]:
        """Each method's trajectory as known now, in its own world: what `ispom run` would write if the run ended here.

        For a fork that replays known frames first, they end at the replayed frame. While frames are only recorded, they
        are the final ones of the recorded run.
        """
        if self._recording is not None:
            return self._recording.trajectories()
        return self.stored.final if self.stored is not None else self.playback.finish().trajectories

    def rest(self) -> None:
        """Frees most of its memory. Older frames are read from disk then, and forks replay more frames."""
        self._limit(self._memory_bytes // REST_SHARE)

    def wake(self) -> None:
        """Gets its full memory again."""
        self._limit(self._memory_bytes)

    def _limit(self, memory_bytes: int) -> None:
        self.history.limit(int(EXPOSURES_SHARE * memory_bytes))
        self.checkpoints.limit(int(STATES_SHARE * memory_bytes))

    def finish(self) -> Finished:
        """The trajectories as of the last computed frame."""
        while self.catching_up:
            self.catch_up()
        return self.playback.finish()

    def finished_within(self, timeout_s: float) -> Finished | None:
        """The trajectories as of the last computed frame, while the worker is busy; None where that takes longer.

        Also None during a replay: only the worker may replay frames, and it would take too long.
        """
        if self.catching_up:
            return None
        found: list[Finished] = []
        finishing = Thread(target=lambda: found.append(self.playback.finish()), name="finish", daemon=True)
        finishing.start()
        finishing.join(timeout_s)
        return found[0] if found else None

    def doing(self, source: str) -> str:
        """Returns a phrase about the work when a frame takes long."""
        if not source.startswith("sim:"):
            return "computing" if self.history else "compiling, then computing"
        return "rendering and computing" if self.history else "building the scene, then"

    @property
    def live(self) -> bool:
        """Returns whether a live source still records frames."""
        return self.playback.sequence.grow is not None

    def stop(self) -> None:
        """Ends the recording of a live source and releases its camera. The frames so far are kept."""
        if self.playback.sequence.stop is not None:
            self.playback.sequence.stop()


def _fulfil(coming: Future[Stepped], step: Callable[[], Stepped]) -> None:
    try:
        coming.set_result(step())
    except BaseException as fault:  # it is raised again where the result is read
        coming.set_exception(fault)
