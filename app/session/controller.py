"""What the worker does with each command, and between them. Used in the worker's thread alone."""

from __future__ import annotations

import logging
from os.path import abspath
from pathlib import PurePath

import numpy as np

from ispom.errors import InputError
from ispom.methods import Config
from ispom.sequences.address import without_secrets

from ..engine.options import SourceOptions
from ..features.bookmarks.service import BookmarkDesk
from ..features.branches.service import BranchDesk
from ..features.breakpoints import moves as break_points
from ..features.events import moves as event_moves
from ..features.flicker import flicker
from ..features.integration import integration
from ..features.lessons.commands import Learn, TurnTo
from ..features.lessons.lesson import Asked
from ..features.lessons.library import Library
from ..features.lessons.service import LessonDesk
from ..features.plots import plotting
from ..features.recording.library import Shelf
from ..features.recording.service import RecordingDesk
from ..features.sensitivity.service import EffectDesk
from ..features.sweep.commands import CancelSweep, RunSweep, ShowSwept
from ..features.sweep.service import SweepDesk
from ..features.tracks import selecting
from . import commands as do
from . import moves
from .accuracy import AccuracyDesk
from .closing import loss
from .compiling import Compiling
from .current_run import CurrentRun
from .player import Player
from .sources.known import Known, run_name
from .sources.opening import SourceOpener, stored_at
from .sources.recent import RecentSources
from .state import Flicked, NoticeAdded, Opening, OpeningFailed, Question, Restored, Resumed, changed
from .store import Store
from .viewers import Viewers

log = logging.getLogger(__name__)
IDLE_S = 0.5
RECORDING_S = 0.05
"""How often recordings and viewers are looked at while nothing else happens: without, and with a recording."""


class Controller:
    """The worker's job: one run on the screen, and what is recorded of it and of those before."""

    def __init__(
        self,
        store: Store,
        player: Player,
        recordings: RecordingDesk,
        viewers: Viewers,
        compiling: Compiling,
        branches: BranchDesk,
        *,
        opener: SourceOpener,
        first: do.Open,
        autoplay: bool,
        methods: tuple[str, ...] | None,
        history_bytes: int,
        recent: RecentSources,
        lessons: Library,
    ) -> None:
        """`first` is opened unless its source is empty; `methods` None means the usual ones of each source."""
        self._store, self._player, self._viewers = store, player, viewers
        self._shelf, self._known = Shelf(store, recordings), Known(recordings.folder)
        self._bookmarks, self._effects = BookmarkDesk(store, recordings.folder), EffectDesk()
        self._sweeps = SweepDesk(store, recordings.folder)
        self._accuracy = AccuracyDesk(store, branches.run)
        self._compiling, self._branches, self._opener, self._recent = compiling, branches, opener, recent
        self._first, self._autoplay, self._usual = first, autoplay, store.state.source_options
        self._wanted, self._history_bytes = methods, history_bytes
        self._config = store.state.config
        """As the app was started: what was changed since belongs to the run in which it was."""
        self._pending: do.Command | None = None
        """What the question on the screen is about."""
        self._questions = 0
        self._recorded = set[int]()
        """Branches of the run on the screen that are, or were, recorded."""
        self._lessons = LessonDesk(
            store, lessons, self._obey, self._open_asked, self._run_beside, lambda: self._player.run
        )

    def begin(self) -> None:
        try:
            self._shelf.show()
        finally:
            if self._first.source:
                self._open(self._first.source, self._first.options)
        if self._autoplay:
            self._play_on()

    def obey(self, command: do.Command) -> None:
        """InputError where it cannot be done. What would lose branches is asked about first."""
        if isinstance(command, do.OpenNamed | do.CompareRuns | do.PutNote):
            self._shelf.show()  # another process may have finished a run
        if isinstance(command, do.Confirm):
            self._confirm(command)
            return
        if not isinstance(command, do.OfLessons):
            self._lessons.require_allowed(command)
        if (lost := self._lost_by(command)) is None:
            self._carry_out(command)
        else:
            self._questions += 1
            self._pending = command
            what, yes = lost
            self._store.set(question=Question(self._questions, what, yes))

    def _confirm(self, answer: do.Confirm) -> None:
        """Carries out what was asked about, or forgets it."""
        question, command = self._store.state.question, self._pending
        if question is None or command is None or answer.number != question.number:
            return
        self._store.set(question=None)
        self._pending = None
        if answer.yes:
            self._carry_out(command)

    def _carry_out(self, command: do.Command) -> None:
        if isinstance(command, do.OfLessons):
            self._lessons.obey(command)
        else:
            self._obey(command)

    def _lost_by(self, command: do.Command) -> tuple[str, str] | None:
        """What is asked before a command, and what agrees to it; None where nothing is lost by it."""
        recorded = self._recorded
        match command:
            case do.Open(source):
                what, yes = f"Opening {without_secrets(source)}", "Close and open"
            case do.OpenNamed(name):
                what, yes = f"Opening {run_name(self._known.source(name, self._store.state))}", "Close and open"
            case do.CompareRuns(a, b) if self._branch_of(a) is None and self._branch_of(b) is None:
                what, yes = f"Comparing {a} and {b}", "Close and compare"
            case do.Restart():
                what, yes, recorded = "Starting again from the first frame", "Close and restart", {0, *recorded}
            case Learn() | TurnTo() if self._lessons.opens_a_run(command):
                what, yes = "The lesson", "Close and go on"
            case _:
                return None
        lost = loss(self._store.state, recorded)
        if not lost:
            return None
        return f"{what} closes {lost}. Nothing else keeps this: stay and record it first (Record), or let it go.", yes

    def _obey(self, command: do.Command) -> None:
        store, player = self._store, self._player
        match command:
            case do.Play(on):
                player.move(*moves.play(store.state, player.run, on))
            case do.StepBy(count):
                player.move(*moves.step(store.state, player.run, count))
            case do.Seek(index):
                player.move(*moves.seek(player.run, index))
            case do.StepTo(kind, forwards):
                player.move(*moves.step_to(store.state, player.run, kind, forwards=forwards))
            case do.StepToEvent(forwards, alarming):
                player.move(*event_moves.to_event(store.state, player.run, forwards=forwards, alarming=alarming))
            case do.GoToEnd():
                player.move(*moves.to_end(player.run))
            case do.LoopEdge(edge):
                store.emit(*moves.loop_edge(store.state, edge))
            case do.NoLoop():
                store.set(loop=None)
            case do.RunUntil(condition):
                player.move(*break_points.run_until(store.state, player.run, condition))
            case do.FindMatch(condition, forwards):
                player.move(*break_points.find(store.state, player.run, condition, forwards=forwards))
            case do.Plot(name):
                store.set(plots=plotting.toggled(store.state.plots, player.run, name))
            case do.SetPlots(names):
                store.set(plots=plotting.chosen(player.run, names))
            case do.Speed(factor):
                player.move(changed(speed=factor))
            case do.Restart(methods, config):
                self._restart(methods, config)
            case do.Fork(methods, config, name):
                self._show(*self._branches.fork(methods, config, name))
                store.set(playing=True)
            case do.ShowBranch(number):
                self._show(*self._branches.show(number))
            case do.RenameBranch(number, name):
                self._branches.rename(number, name)
            case do.HideBranch(number, hidden):
                self._branches.hide(number, hidden)
            case do.DeleteBranch(number):
                self._branches.delete(number)
            case do.CompareBranch(number):
                self._branches.compare(number)
            case do.CompareRuns(a, b):
                self._compare_runs(a, b)
            case do.Predict(wrong):
                self._effects.predict(store, player.run, wrong)
            case do.RunPerturbed():
                again, name = self._effects.perturbed(store.state, player.run, self._history_bytes)
                self._show(*self._branches.add(again, name, 0, (name,)))
                self._effects.began(store, again)
                store.set(playing=True)
            case RunSweep():
                self._sweeps.begin(command, player.run)
            case CancelSweep():
                self._sweeps.cancel()
            case ShowSwept(place):
                self._show_swept(place)
            case do.FlickerBetween(a, b):
                store.set(flicker=flicker.between(self._branches.sides, a, b))
            case do.Flick() if store.state.flicker is None:
                store.set(flicker=flicker.usual(self._branches.sides, store.state.branch))
            case do.Flick():
                store.emit(Flicked())
            case do.StopFlicker():
                store.set(flicker=None)
            case do.ShowIntegration(method):
                store.set(integration=integration.shown(store.state, player.run, method))
            case do.StepIntegration(by):
                store.set(integration=integration.moved(store.state, player.run, by))
            case do.Open(source, options):
                if self._open(source, options):
                    self._play_on()
            case do.OpenNamed(name):
                if self._open(self._known.source(name, store.state), None):
                    self._play_on()
            case do.PutBookmark(note):
                self._bookmarks.put(note)
            case do.ToggleBookmark():
                self._bookmarks.toggle()
            case do.RemoveBookmark(exposure):
                self._bookmarks.remove(exposure)
            case do.Record(name):
                self._shelf.record(name, player.run)
                self._recorded.add(store.state.branch)
            case do.StopRecording():
                self._shelf.stop(player.run)
            case do.PutNote(name, note):
                self._shelf.put_note(name, note)
            case do.RepairRecordings():
                self._shelf.repair()
            case do.Hide(names):
                store.set(hidden=names)
            case do.Select(what):
                store.set(selected=selecting.selected(what))
            case do.Pick():
                store.set(selected=selecting.picked(player.run, command))
            case do.ColourBy(what):
                store.set(colour_by=what)
            case do.LookAt(panel, camera):
                store.set(look=panel or store.state.look, camera=store.state.camera if camera is None else camera)
            case do.Notify(text):
                store.emit(NoticeAdded(text))

    def turn(self) -> None:
        """Advances the run, whatever becomes of what goes on beside it."""
        try:
            self._player.advance()
            self._lessons.turn()
        finally:
            self._branches.compare_on()
            self._effects.watch(self._store)
            self._accuracy.watch()
            self._viewers.look_at(self._store.state.index)
            self._viewers.check()
            self._compiling.watch()
            self._shelf.watch()
            if self._sweeps.watch():
                self._shelf.show()

    def patience_s(self) -> float:
        if self._branches.comparing or self._lessons.busy:
            return 0.0
        busy = self._shelf.busy or self._sweeps.busy
        return self._player.patience_s(RECORDING_S if busy else IDLE_S)

    def failed(self, fault: Exception) -> None:
        """Pauses and says why: a user's mistake in its own sentence, anything else as what it is, a fault of ours."""
        if not isinstance(fault, InputError):
            log.error("the session worker failed", exc_info=fault)
        self._pause(str(fault) if isinstance(fault, InputError) else _internal(fault))
        self._lessons.failed()

    def end(self) -> None:
        if self._player.run is not None:
            self._player.run.stop()
        self._sweeps.close()
        self._shelf.stop(self._player.run)
        self._shelf.close()

    def _pause(self, reason: str) -> None:
        self._store.emit(changed(playing=False, target=None, activity=None), NoticeAdded(reason))

    def _open(self, source: str, options: SourceOptions | None) -> bool:
        """Opens another source, and says whether it did; where that fails, the one before stays as it was."""
        if not source:
            raise InputError("no source is given: type a path, or choose one of the list")
        before, run, shown = self._store.state, self._player.run, without_secrets(source)
        if run is not None and run.live and shown == before.source:
            run.stop()  # a camera has to be let go before it can be opened again
        self._store.emit(Opening(shown))
        self._store.busy(f"opening {shown}")
        try:
            found = self._opener.stored(source, self._history_bytes)
            if found is None:
                asked = source, options, self._wanted, self._config
                playback = self._opener.playback(*asked, strict=run is None, progress=self._store.busy)
                found = CurrentRun(playback, self._history_bytes)
        except Exception as fault:
            if before.phase in ("ready", "empty"):
                self._store.emit(Restored(before))
                raise
            if isinstance(fault, InputError):
                log.error("%s", fault)  # on the terminal, where the source was given
                self._store.emit(OpeningFailed(str(fault)))
            else:
                log.exception("opening %s failed", shown)
                self._store.emit(OpeningFailed(_internal(fault)))
            return False
        if run is not None:
            run.stop()
        self._begin(found)
        recent = self._recent.add(source)
        self._store.set(source_options=options or self._usual, recent=recent)
        return True

    def _open_asked(self, asked: Asked) -> CurrentRun:
        """The run that a step of a lesson asks for, on the screen."""
        found = self._run_of(asked)
        if self._player.run is not None:
            self._player.run.stop()
        self._store.emit(Opening(asked.source))
        self._begin(found)
        self._store.set(source_options=self._usual)
        return found

    def _run_beside(self, asked: Asked, name: str) -> CurrentRun:
        """Another one, as a branch."""
        found = self._run_of(asked)
        self._show(*self._branches.add(found, name, 0, (name,), reproducible=True))
        return found

    def _show_swept(self, place: int) -> None:
        """A value's run, as it was computed, as a branch; one that is a branch already is shown again."""
        path, name, change = self._sweeps.folder(place, self._player.run)
        known = next((b.number for b in self._store.state.branches if b.name == name), None)
        if known is not None:
            self._show(*self._branches.show(known))
            return
        stored = stored_at(str(path), self._opener.opener, self._opener.builder)
        if stored is None:
            raise InputError(f"{path} holds no run any more: run the sweep again")
        found = CurrentRun.of_stored(stored, self._history_bytes)
        self._show(*self._branches.add(found, name, 0, (change,), reproducible=True))

    def _compare_runs(self, a: str, b: str) -> None:
        """InputError where they are of different sources, or one of them cannot be opened."""
        named = {kept.name: kept.source for kept in self._store.state.recordings}
        if a in named and b in named and named[a] != named[b]:
            raise InputError(f"{a} is a run on {named[a]}, and {b} on {named[b]}: choose two runs on one source")
        numbers = [self._branch_of(key) for key in (a, b)]
        if numbers == [None, None]:
            self._open(self._known.source(a, self._store.state), None)
            numbers[0] = 0
        shown, other = (self._with_recorded(key) if n is None else n for key, n in zip((a, b), numbers, strict=True))
        self._show(*self._branches.show(shown))
        self._branches.compare(other)

    def _branch_of(self, key: str) -> int | None:
        """The number of the branch that a row of the runs table is; None where it is to be read from its folder.

        InputError for a branch that was deleted.
        """
        kind, _, number = key.partition(":")
        if kind == "live":
            if not number.isdecimal() or self._branches.run(int(number)) is None:
                raise InputError("this run is not in the session any more: choose another one")
            return int(number)
        path = abspath(self._known.folder / key)
        runs = ((b.number, self._branches.run(b.number)) for b in self._store.state.branches)
        return next((n for n, run in runs if run and run.stored and abspath(run.stored.path) == path), None)

    def _with_recorded(self, name: str) -> int:
        """The number of the branch that a run of the recordings folder becomes."""
        found = self._opener.stored(self._known.source(name, self._store.state), self._history_bytes)
        run = self._player.run
        if found is None or run is None:
            raise InputError(f"{name} holds no run: choose another one")
        times_ns = [each.playback.sequence.times_ns[: len(found.history)] for each in (run, found)]
        if not np.array_equal(*times_ns):
            raise InputError(f"{name} has other frames than the run that is shown: choose two runs on one source")
        self._branches.add(found, PurePath(name).name, 0, (), reproducible=True)
        return self._store.state.branches[-1].number

    def _run_of(self, asked: Asked) -> CurrentRun:
        wanted = asked.source, None, asked.methods, asked.config
        playback = self._opener.playback(*wanted, strict=True, progress=self._store.busy)
        return CurrentRun(playback, self._history_bytes)

    def _restart(self, methods: tuple[str, ...], config: Config) -> None:
        if self._player.run is None:
            raise InputError("there is nothing to run yet: open a source first")
        self._player.run.require_source()
        playback = self._opener.again(self._player.run.playback, methods, config)
        self._store.emit(Opening(self._store.state.source))
        self._begin(CurrentRun(playback, self._history_bytes))
        self._store.set(playing=True)

    def _begin(self, run: CurrentRun) -> None:
        """The run that is on the screen from now on; one that is over is shown at its end."""
        self._shelf.stop(self._player.run)
        playback, self._player.run = run.playback, run
        self._recorded, self._pending = set(), None
        if not run.done:
            self._compiling.begin(playback)
        self._branches.begin(run)
        if playback.sequence.prepare is not None and run.stored is None:
            playback.sequence.prepare(0)
        self._view(run)
        self._player.move(run.opened)
        if run.stored is not None:
            self._player.move(*self._branches.reviewed())
            if run.stored.unavailable:
                self._store.emit(NoticeAdded(run.stored.unavailable, "info"))
        elif not run.done:
            self._compiling.explain()
        self._bookmarks.begin(run, self._store.state.source)

    def _play_on(self) -> None:
        """A run that was opened plays by itself; one that is over waits to be looked at."""
        if self._player.run is not None and self._player.run.stored is None:
            self._store.set(playing=True)

    def _show(self, run: CurrentRun, resumed: Resumed) -> None:
        """Another branch, from now on."""
        self._shelf.stop(self._player.run)
        self._player.run = run
        self._compiling.begin(run.playback)
        self._view(run)
        self._player.move(changed(playing=False), resumed)

    def _view(self, run: CurrentRun) -> None:
        """In the viewers from now on; one that was read, as it was recorded."""
        self._viewers.open(run.opened, run.history, run.stored.recording if run.stored is not None else None)


def _internal(fault: Exception) -> str:
    return f"internal fault, please report it: {type(fault).__name__}: {fault}"
