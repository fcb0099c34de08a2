"""The part of a feature that works in the worker's thread, in addition to its commands and its state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..engine.events import Stepped
from .commands import Command
from .current_run import CurrentRun
from .state import State
from .store import Store

if TYPE_CHECKING:
    from .controller import Controller


class Service:
    """Base of services. One object of each subclass lives as long as the session; the worker's thread calls it."""

    place = 0
    """Services are called in the order of their places."""

    def __init__(self, session: Controller) -> None:
        self.session = session

    @property
    def store(self) -> Store:
        return self.session.store

    @property
    def state(self) -> State:
        return self.session.store.state

    @property
    def run(self) -> CurrentRun | None:
        """The run that is on the screen."""
        return self.session.run

    @property
    def busy(self) -> bool:
        """Whether `watch` should be called again soon."""
        return False

    @property
    def impatient(self) -> bool:
        """Whether `watch` should be called again at once."""
        return False

    def begin(self) -> None:
        """Called once, before the first source is opened."""

    def opened(self, run: CurrentRun) -> None:
        """Called when another run is on the screen, which begins or is over."""

    def leave(self, run: CurrentRun | None) -> None:
        """Called before this run leaves the screen."""

    def keep(self, before: State) -> None:
        """Called before another source replaces the run on the screen, which has this state: keeps what should stay."""

    def computed(self, event: Stepped) -> None:
        """Called when the run on the screen has computed a frame."""

    def check(self, command: Command) -> None:
        """Raises InputError for a command that is not possible now."""

    def loss(self) -> list[str]:
        """Returns parts of a sentence about what would be lost if the run were closed now."""
        return []

    @property
    def kept_branches(self) -> frozenset[int]:
        """Numbers of the branches of the run that are kept, for example in a recording; 0 is the first run."""
        return frozenset()

    def watch(self) -> None:
        """Does a little of the work that needs no command."""

    def failed(self) -> None:
        """Called when a command or the run failed."""

    def close(self) -> None:
        """Called at the end of the session."""

    def close_now(self) -> None:
        """Called in another thread when the session ends while the worker is busy: closes what must not be lost."""
