"""The run on the screen, and how it is replaced. Only the worker's thread uses it."""

from __future__ import annotations

import logging

from ispom.errors import InputError
from ispom.methods import Config
from ispom.sequences.address import without_secrets

from ..engine.options import SourceOptions
from .compiling import Compiling
from .current_run import CurrentRun
from .player import Player
from .services import Services
from .setup import SessionSetup
from .sources.opening import SourceOpener
from .state import NoticeAdded, Opening, OpeningFailed, Restored, Resumed, State, changed
from .store import Store
from .viewers import Viewers

log = logging.getLogger(__name__)


class OnScreen:
    """Opens sources and starts runs. It notifies services of each run that it shows or removes."""

    def __init__(
        self,
        store: Store,
        player: Player,
        services: Services,
        viewers: Viewers,
        compiling: Compiling,
        setup: SessionSetup,
    ) -> None:
        self._store, self._player, self._services = store, player, services
        self._viewers, self._compiling, self._setup = viewers, compiling, setup
        self.opener = SourceOpener(
            setup.opener,
            setup.builder,
            setup.variant,
            setup.trajectory_options,
            setup.folders,
            setup.source,
            setup.beginnings,
            setup.compare_images,
        )

    @property
    def run(self) -> CurrentRun | None:
        return self._player.run

    def open(self, source: str, options: SourceOptions | None) -> bool:
        """Opens another source, and returns whether it did; if that fails, the one before is left unchanged."""
        if not source:
            raise InputError("no source is given: type a path, or choose one of the list")
        before, run, shown = self._store.state, self.run, without_secrets(source)
        if run is not None and run.live and shown == before.source:
            run.stop()  # a camera must be released before it can be opened again
        self._store.emit(Opening(shown))
        self._store.busy(f"opening {shown}")
        try:
            found = self.opener.stored(source, self._setup.history_bytes)
            if found is None:
                setup, used = self._setup, options or self._setup.source_options
                computed = self.computed_run(source, options, setup.methods, setup.config, strict=run is None)
                found = self.opener.begun(computed.playback, source, used, setup.history_bytes) or computed
        except Exception as fault:
            if before.phase in ("ready", "empty"):
                self._store.emit(Restored(before))
                raise
            if isinstance(fault, InputError):
                log.error("%s", fault)  # on the terminal, where the source was given
                self._store.emit(OpeningFailed(str(fault)))
            else:
                log.exception("opening %s failed", shown)
                self._store.emit(OpeningFailed(internal(fault)))
            return False
        if run is not None:
            run.stop()
        self._keep(before)
        self.put(found)
        self._store.set(source_options=options or self._setup.source_options, recent=self._setup.recent.add(source))
        return True

    def show_again(self, run: CurrentRun, source: str, options: SourceOptions) -> None:
        """Shows a run of a closed source again, with the options with which it was opened."""
        if self.run is not None:
            self.run.stop()
        self._keep(self._store.state)
        self._store.emit(Opening(source))
        self.put(run)
        self._store.set(source_options=options)

    def open_run(self, run: CurrentRun, source: str, *, keep: bool) -> None:
        """Puts a run of another source on the screen; the one before stays in the table of runs if it is to be kept."""
        if self.run is not None:
            self.run.stop()
        if keep:
            self._keep(self._store.state)
        self._store.emit(Opening(source))
        self.put(run)
        self._store.set(source_options=self._setup.source_options)

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
        opened = self.opener.playback(source, options, methods, config, strict=strict, progress=self._store.busy)
        return CurrentRun(opened, self._setup.history_bytes)

    def restart(self, methods: tuple[str, ...], config: Config) -> None:
        """Starts the run on the screen again from its first frame. InputError if there is none."""
        if self.run is None:
            raise InputError("there is nothing to run yet: open a source first")
        self.run.require_source()
        playback = self.opener.again(self.run.playback, methods, config)
        self._store.emit(Opening(self._store.state.source))
        self.put(CurrentRun(playback, self._setup.history_bytes))
        self._store.set(playing=True)

    def put(self, run: CurrentRun) -> None:
        """Puts a run on the screen. A run that is over is shown at its end."""
        self._leave()
        playback, self._player.run = run.playback, run
        if not run.done or (run.stored is not None and not run.stored.unavailable):  # it may be forked or diagnosed
            self._compiling.begin(playback)
        if playback.sequence.prepare is not None and run.stored is None and not run.recorded_frames:
            playback.sequence.prepare(0)
        self._view(run)
        self._player.move(run.opened)
        if run.stored is not None and run.stored.unavailable:
            self._store.emit(NoticeAdded(run.stored.unavailable, "info"))
        for service in self._services:
            service.opened(run)

    def show(self, run: CurrentRun, resumed: Resumed) -> None:
        """Shows another branch of the run on the screen."""
        self._leave()
        self._player.run = run
        self._compiling.begin(run.playback)
        self._view(run)
        self._player.move(changed(playing=False), resumed)

    def play_on(self) -> None:
        """Starts to play a run that is computed here. A stored run does not play by itself."""
        if self.run is not None and self.run.stored is None:
            self._store.set(playing=True)

    def _keep(self, before: State) -> None:
        for service in self._services:
            service.keep(before)

    def _leave(self) -> None:
        for service in self._services:
            service.leave(self.run)

    def _view(self, run: CurrentRun) -> None:
        """Shows a run in the viewers; for a stored run they show its recording."""
        stored, beginning = run.stored, run.recorded.path if run.recorded is not None and run.recorded_frames else None
        self._viewers.open(run.opened, run.history, stored.recording if stored is not None else None, beginning)


def internal(fault: Exception) -> str:
    return f"internal fault, please report it: {type(fault).__name__}: {fault}"
