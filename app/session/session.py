"""The session as other threads use it: they post commands and read states. It has one run at a time."""

from __future__ import annotations

from ispom.sequences.address import without_secrets

from ..engine.events import Opened
from ..engine.history.history import History
from ..engine.history.series import Series
from ..engine.model.run_model import RunModel
from .commands import Command
from .controller import Controller, S, T
from .current_run import CurrentRun
from .registry import load_features, services
from .setup import SessionSetup
from .state import NoticeAdded, State
from .store import Store
from .viewers import EventSink, Viewers
from .worker import Worker


class Session:
    """`post` and `state` are for any thread, and neither ever waits."""

    def __init__(self, setup: SessionSetup, live: EventSink | None = None) -> None:
        """`live` gets the events of the run, and shows them."""
        self.folders, self.recordings_dir = setup.folders, setup.recordings
        load_features()
        self._store = Store(
            State(
                without_secrets(setup.source),
                phase="opening" if setup.source else "empty",
                config=setup.config,
                source_options=setup.source_options,
                recent=setup.recent.names,
            )
        )
        self.changes = self._store.changes
        """Called, in the worker's thread, at each new state."""
        viewers = Viewers(live, lambda text: self._store.emit(NoticeAdded(text)))
        self._controller = Controller(self._store, viewers, setup)
        self._controller.add(*(kind(self._controller) for kind in services()))
        self._worker = Worker(self._controller)

    def start(self) -> None:
        self._worker.start()

    def post(self, command: Command) -> None:
        """Queues a command; its effect appears in `state`."""
        self._worker.post(command)

    @property
    def state(self) -> State:
        return self._store.state

    @property
    def run(self) -> CurrentRun | None:
        """Returns the run on the screen. Each start makes another object, so read it once and use that."""
        return self._controller.run

    def service(self, kind: type[S]) -> S:
        """Returns a feature's service. Only the worker's thread may call its methods, unless they say otherwise."""
        return self._controller.service(kind)

    def extra(self, kind: type[T]) -> T:
        """The value of this type that the session was given, or else a new one."""
        return self._controller.extra(kind)

    @property
    def history(self) -> History:
        """Of the run that is on the screen; empty before the first."""
        return self.run.history if self.run is not None else History()

    @property
    def series(self) -> Series | None:
        """The quantities of the run that is on the screen."""
        return self.run.series if self.run is not None else None

    @property
    def opened(self) -> Opened | None:
        return self.run.opened if self.run is not None else None

    def known_at(self, index: int) -> RunModel:
        """What was known after frame `index` of the run that is on the screen."""
        return self.run.known_at(index) if self.run is not None else RunModel.start(())

    def close(self, timeout_s: float) -> bool:
        """Closes the recordings, including final trajectories, and ends the worker.

        Returns False if the worker is too busy. The computed frames are recorded even then, within about a second more.
        """
        if self._worker.close(timeout_s):
            return True
        self._controller.close_now()
        return False
