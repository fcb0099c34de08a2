"""What a feature does in the worker's thread in addition to its commands, and stores there in addition to its state."""

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
    """One of each subclass lives as long as the session. All of it is called in the worker's thread."""

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
        """Another run is on the screen, from its first frame on, or one that is over."""

    def leave(self, run: CurrentRun | None) -> None:
        """This run is about to leave the screen."""

    def keep(self, before: State) -> None:
        """Another source takes the place of the run on the screen, which was in this state: keeps what should stay."""

    def computed(self, event: Stepped) -> None:
        """The run on the screen has computed another frame."""

    def check(self, command: Command) -> None:
        """Raises InputError for a command that is not possible now."""

    def loss(self) -> list[str]:
        """What would be lost if the run were closed now, as parts of a sentence."""
        return []

    @property
    def kept_branches(self) -> frozenset[int]:
        """Numbers of the branches of the run that are kept, for example in a recording; 0 is the first run."""
        return frozenset()

    def watch(self) -> None:
        """A little of the work that goes on without commands."""

    def failed(self) -> None:
        """A command, or the run, failed."""

    def close(self) -> None:
        """The session ends."""

    def close_now(self) -> None:
        """The session ends while the worker is busy: closes what must not be lost. Called in another thread."""
