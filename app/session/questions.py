"""The question before something is lost: what a command would close, and the person's answer."""

from __future__ import annotations

from ispom.sequences.address import is_address, is_device

from .commands import Command, Confirm, Restart
from .services import Services
from .state import Question
from .store import Store


class Questions:
    """One at a time is on the screen; another run forgets it."""

    def __init__(self, store: Store, services: Services) -> None:
        self._store, self._services = store, services
        self._pending: Command | None = None
        """What the question on the screen is about."""
        self._count = 0

    def asks(self, command: Command, what: str) -> bool:
        """Asks where the command would lose something, and returns whether it did. `what` closes the run, as the
        beginning of a sentence."""
        lost = self._loss(live=not isinstance(command, Restart), kept=command.keeps)
        if lost:
            self._count += 1
            self._pending = command
            text = (
                f"{what} closes {' and '.join(lost)}. Nothing else keeps this: stay and record it first, or discard it."
            )
            self._store.set(question=Question(self._count, text, "Close and go on"))
        return bool(lost)

    def answered(self, answer: Confirm) -> Command | None:
        """Closes the question; the command that it was about, where that is to be carried out."""
        question, command = self._store.state.question, self._pending
        if question is None or command is None or answer.number != question.number:
            return None
        self._store.set(question=None)
        self._pending = None
        return command if answer.yes else None

    def _loss(self, *, live: bool, kept: bool) -> list[str]:
        """What would be lost if the run were closed; nothing that is kept elsewhere or can be had again. A live run is
        counted only if asked for, and forks only where they are not `kept` in the table of runs."""
        state = self._store.state
        lost = [] if kept else [each for service in self._services for each in service.loss()]
        if (
            live
            and state.computed
            and 0 not in self._services.kept_branches
            and (is_device(state.source) or is_address(state.source))
        ):
            lost.append(f"the live run of {state.source}")
        return lost
