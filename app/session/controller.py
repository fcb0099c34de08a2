"""The worker's job: one run on the screen, and what the features do with it. Used in the worker's thread alone."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TypeVar

from ispom.errors import InputError
from ispom.methods import Config
from ispom.sequences.address import is_address, is_device, without_secrets

from ..engine.events import Stepped
from ..engine.options import SourceOptions
from .commands import Command, Confirm, Open, Restart
from .compiling import Compiling
from .current_run import CurrentRun
from .player import Player
from .service import Service
from .sources.folders import RecentSources
from .sources.opening import SourceOpener
from .state import NoticeAdded, Opening, OpeningFailed, Question, Restored, Resumed, State, changed
from .store import Store
from .viewers import Viewers

log = logging.getLogger(__name__)
IDLE_S = 0.5
BUSY_S = 0.05
"""How often services are looked at while nothing else happens: usually, and while one of them is busy."""

S = TypeVar("S", bound=Service)
T = TypeVar("T")


class Controller:
    """Handlers of commands and services get it as their `session`."""

    def __init__(
        self,
        store: Store,
        player: Player,
        viewers: Viewers,
        compiling: Compiling,
        *,
        opener: SourceOpener,
        first: Open,
        autoplay: bool,
        methods: tuple[str, ...] | None,
        history_bytes: int,
        recent: RecentSources,
        recordings: Path,
        extras: tuple[object, ...] = (),
    ) -> None:
        """`first` is opened unless its source is empty; `methods` None means the usual ones of each source;
        `recordings` is the folder of runs and recordings; `extras` are values that services look up by their type."""
        self.store, self.player, self.opener = store, player, opener
        self.recordings, self.history_bytes = recordings, history_bytes
        self._viewers, self._compiling, self._recent = viewers, compiling, recent
        self._first, self._autoplay, self._methods = first, autoplay, methods
        self._usual_options, self._config = store.state.source_options, store.state.config
        """As the app was started: what was changed since belongs to the run in which it was."""
        self._services: dict[type[Service], Service] = {}
        self._pending: Command | None = None
        """What the question on the screen is about."""
        self._questions = 0
        self._extras: dict[type, object] = {type(extra): extra for extra in extras}
        player.computed = self._computed

    def add(self, *services: Service) -> None:
        """Services take part from now on."""
        self._services |= {type(service): service for service in sorted(services, key=lambda each: each.place)}

    def extra(self, kind: type[T]) -> T:
        """The value of this type that the session was given, or else a new one."""
        found = self._extras.get(kind)
        if found is None:
            found = self._extras[kind] = kind()
        return found  # type: ignore[return-value]

    def service(self, kind: type[S]) -> S:
        return self._services[kind]  # type: ignore[return-value]

    @property
    def state(self) -> State:
        return self.store.state

    @property
    def run(self) -> CurrentRun | None:
        """The run that is on the screen."""
        return self.player.run

    @property
    def kept_branches(self) -> frozenset[int]:
        """Numbers of the branches that a service keeps elsewhere, for example in a recording."""
        return frozenset().union(*(service.kept_branches for service in self._services.values()))

    def begin(self) -> None:
        try:
            for service in self._services.values():
                service.begin()
        finally:
            if self._first.source:
                self.open(self._first.source, self._first.options)
        if self._autoplay:
            self.play_on()

    def obey(self, command: Command) -> None:
        """Carries a command out, or asks first if it would close the run and something would be lost with it.

        InputError if it is not possible.
        """
        if isinstance(command, Confirm):
            self._confirm(command)
            return
        for service in self._services.values():
            service.check(command)
        what = command.closing(self)
        lost = self._loss(live=not isinstance(command, Restart), kept=command.keeps) if what else []
        if lost:
            self._questions += 1
            self._pending = command
            text = (
                f"{what} closes {' and '.join(lost)}. Nothing else keeps this: stay and record it first, or discard it."
            )
            self.store.set(question=Question(self._questions, text, "Close and go on"))
        else:
            command.execute(self)

    def open(self, source: str, options: SourceOptions | None) -> bool:
        """Opens another source, and returns whether it did; if that fails, the one before is left unchanged."""
        if not source:
            raise InputError("no source is given: type a path, or choose one of the list")
        before, run, shown = self.state, self.run, without_secrets(source)
        if run is not None and run.live and shown == before.source:
            run.stop()  # a camera has to be let go before it can be opened again
        self.store.emit(Opening(shown))
        self.store.busy(f"opening {shown}")
        try:
            found = self.opener.stored(source, self.history_bytes)
            if found is None:
                computed = self.computed_run(source, options, self._methods, self._config, strict=run is None)
                used = options or self._usual_options
                found = self.opener.begun(computed.playback, source, used, self.history_bytes) or computed
        except Exception as fault:
            if before.phase in ("ready", "empty"):
                self.store.emit(Restored(before))
                raise
            if isinstance(fault, InputError):
                log.error("%s", fault)  # on the terminal, where the source was given
                self.store.emit(OpeningFailed(str(fault)))
            else:
                log.exception("opening %s failed", shown)
                self.store.emit(OpeningFailed(_internal(fault)))
            return False
        if run is not None:
            run.stop()
        self._keep(before)
        self.put_on_screen(found)
        self.store.set(source_options=options or self._usual_options, recent=self._recent.add(source))
        return True

    def show_again(self, run: CurrentRun, source: str, options: SourceOptions) -> None:
        """Puts a run of a source that was closed on the screen, as it was opened then."""
        if self.run is not None:
            self.run.stop()
        self._keep(self.state)
        self.store.emit(Opening(source))
        self.put_on_screen(run)
        self.store.set(source_options=options)

    def open_run(self, run: CurrentRun, source: str) -> None:
        """Puts a run of another source on the screen."""
        if self.run is not None:
            self.run.stop()
        self.store.emit(Opening(source))
        self.put_on_screen(run)
        self.store.set(source_options=self._usual_options)

    def computed_run(
        self,
        source: str,
        options: SourceOptions | None,
        methods: tuple[str, ...] | None,
        config: Config,
        *,
        strict: bool = True,
    ) -> CurrentRun:
        """A run that is to be computed. InputError as `SourceOpener.playback`."""
        opened = self.opener.playback(source, options, methods, config, strict=strict, progress=self.store.busy)
        return CurrentRun(opened, self.history_bytes)

    def restart(self, methods: tuple[str, ...], config: Config) -> None:
        """The run on the screen again, from its first frame on. InputError if there is none."""
        if self.run is None:
            raise InputError("there is nothing to run yet: open a source first")
        self.run.require_source()
        playback = self.opener.again(self.run.playback, methods, config)
        self.store.emit(Opening(self.state.source))
        self.put_on_screen(CurrentRun(playback, self.history_bytes))
        self.store.set(playing=True)

    def put_on_screen(self, run: CurrentRun) -> None:
        """The run that is on the screen from now on; one that is over is shown at its end."""
        self._leave()
        playback, self.player.run = run.playback, run
        self._pending = None
        if not run.done or (run.stored is not None and not run.stored.unavailable):  # it may be forked or diagnosed
            self._compiling.begin(playback)
        if playback.sequence.prepare is not None and run.stored is None and not run.recorded_frames:
            playback.sequence.prepare(0)
        self._view(run)
        self.player.move(run.opened)
        if run.stored is not None and run.stored.unavailable:
            self.store.emit(NoticeAdded(run.stored.unavailable, "info"))
        for service in self._services.values():
            service.opened(run)

    def show(self, run: CurrentRun, resumed: Resumed) -> None:
        """Another branch of the run on the screen, from now on."""
        self._leave()
        self.player.run = run
        self._compiling.begin(run.playback)
        self._view(run)
        self.player.move(changed(playing=False), resumed)

    def play_on(self) -> None:
        """A run that was opened plays by itself; one that is over waits to be looked at."""
        if self.run is not None and self.run.stored is None:
            self.store.set(playing=True)

    def turn(self) -> None:
        """Advances the run, whatever becomes of the services' work."""
        try:
            self.player.advance()
        finally:
            try:
                for service in self._services.values():
                    service.watch()
            finally:
                self._viewers.look_at(self.state.index)
                self._viewers.check()
                self._compiling.watch()

    def patience_s(self) -> float:
        if any(service.impatient for service in self._services.values()):
            return 0.0
        busy = any(service.busy for service in self._services.values())
        return self.player.patience_s(BUSY_S if busy else IDLE_S)

    def failed(self, fault: Exception) -> None:
        """Pauses and says why: a user's mistake in its own sentence, anything else as a fault of the program."""
        if not isinstance(fault, InputError):
            log.error("the session worker failed", exc_info=fault)
        reason = str(fault) if isinstance(fault, InputError) else _internal(fault)
        self.store.emit(changed(playing=False, target=None, activity=None), NoticeAdded(reason))
        for service in self._services.values():
            service.failed()

    def end(self) -> None:
        if self.run is not None:
            self.run.stop()
        self._leave()
        for service in self._services.values():
            service.close()

    def close_now(self) -> None:
        """Closes what must not be lost, from another thread, while the worker is busy."""
        for service in self._services.values():
            service.close_now()

    def _confirm(self, answer: Confirm) -> None:
        """Carries out what the question was about, or forgets it."""
        question, command = self.state.question, self._pending
        if question is None or command is None or answer.number != question.number:
            return
        self.store.set(question=None)
        self._pending = None
        if answer.yes:
            command.execute(self)

    def _loss(self, *, live: bool, kept: bool) -> list[str]:
        """What would be lost if the run were closed; nothing that is kept elsewhere or can be had again. A live run is
        counted only if asked for, and forks only where they are not `kept` in the table of runs."""
        lost = [] if kept else [each for service in self._services.values() for each in service.loss()]
        if (
            live
            and self.state.computed
            and 0 not in self.kept_branches
            and (is_device(self.state.source) or is_address(self.state.source))
        ):
            lost.append(f"the live run of {self.state.source}")
        return lost

    def _computed(self, event: Stepped) -> None:
        for service in self._services.values():
            service.computed(event)

    def _keep(self, before: State) -> None:
        for service in self._services.values():
            service.keep(before)

    def _leave(self) -> None:
        for service in self._services.values():
            service.leave(self.run)

    def _view(self, run: CurrentRun) -> None:
        """In the viewers from now on; one that was read, as it was recorded."""
        stored, beginning = run.stored, run.recorded.path if run.recorded is not None and run.recorded_frames else None
        self._viewers.open(run.opened, run.history, stored.recording if stored is not None else None, beginning)


def _internal(fault: Exception) -> str:
    return f"internal fault, please report it: {type(fault).__name__}: {fault}"
