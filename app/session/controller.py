"""The worker's job: it executes commands, advances the run on the screen, and calls the services of features. Only the
worker's thread uses it."""

from __future__ import annotations

import logging
from typing import TypeVar

from ispom.errors import InputError

from ..engine.events import Stepped
from .commands import Command, Confirm
from .compiling import Compiling
from .current_run import CurrentRun
from .on_screen import OnScreen, internal
from .player import Player
from .questions import Questions
from .service import Service
from .services import Services
from .setup import SessionSetup
from .state import NoticeAdded, State, changed
from .store import Store
from .viewers import Viewers

log = logging.getLogger(__name__)
IDLE_S = 0.5
BUSY_S = 0.05
"""How often services are looked at while nothing else happens: usually, and while one of them is busy."""

S = TypeVar("S", bound=Service)
T = TypeVar("T")


class Controller:
    """The `session` of commands and services. `store` has the state, `player` moves through the run, and `screen` shows
    another run."""

    def __init__(self, store: Store, viewers: Viewers, setup: SessionSetup) -> None:
        self.store, self.setup = store, setup
        self._viewers = viewers
        self._compiling = Compiling(store, setup.compiling)
        self._services = Services()
        self._questions = Questions(store, self._services)
        self.player = Player(store, viewers, self._compiling, self._computed)
        self.screen = OnScreen(store, self.player, self._services, viewers, self._compiling, setup)
        self._extras: dict[type, object] = {type(extra): extra for extra in setup.extras}

    def add(self, *services: Service) -> None:
        """Adds services; they are called from now on."""
        self._services.add(*services)

    def extra(self, kind: type[T]) -> T:
        """Returns the value of this type with which the session was set up, or else a new one."""
        found = self._extras.get(kind)
        if found is None:
            found = self._extras[kind] = kind()
        return found  # type: ignore[return-value]

    def service(self, kind: type[S]) -> S:
        return self._services.of(kind)

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
        return self._services.kept_branches

    def begin(self) -> None:
        try:
            for service in self._services:
                service.begin()
        finally:
            if self.setup.source:
                self.screen.open(self.setup.source, None)
        if self.setup.autoplay:
            self.screen.play_on()

    def obey(self, command: Command) -> None:
        """Executes a command. If it closes the run and something would be lost, a person must confirm it first.

        InputError if it is not possible.
        """
        if isinstance(command, Confirm):
            confirmed = self._questions.answered(command)
            if confirmed is not None:
                confirmed.execute(self)
            return
        for service in self._services:
            service.check(command)
        what = command.closing(self)
        if not (what and self._questions.asks(command, what)):
            command.execute(self)

    def turn(self) -> None:
        """Advances the run, even if a service fails."""
        try:
            self.player.advance()
        finally:
            try:
                for service in self._services:
                    service.watch()
            finally:
                self._viewers.look_at(self.state.index)
                self._viewers.check()
                self._compiling.watch()

    def patience_s(self) -> float:
        if any(service.impatient for service in self._services):
            return 0.0
        busy = any(service.busy for service in self._services)
        return self.player.patience_s(BUSY_S if busy else IDLE_S)

    def failed(self, fault: Exception) -> None:
        """Pauses and shows why: a mistake of the user by its sentence, anything else as a fault of the program."""
        if not isinstance(fault, InputError):
            log.error("the session worker failed", exc_info=fault)
        reason = str(fault) if isinstance(fault, InputError) else internal(fault)
        self.store.emit(changed(playing=False, target=None, activity=None), NoticeAdded(reason))
        for service in self._services:
            service.failed()

    def end(self) -> None:
        if self.run is not None:
            self.run.stop()
        for service in self._services:
            service.leave(self.run)
        for service in self._services:
            service.close()

    def close_now(self) -> None:
        """Closes files that must not be lost, while the worker is busy. Another thread calls it."""
        for service in self._services:
            service.close_now()

    def _computed(self, event: Stepped) -> None:
        for service in self._services:
            service.computed(event)
