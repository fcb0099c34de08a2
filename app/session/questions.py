"""The question to a person before a command closes a run that would be lost, and the answer."""

from __future__ import annotations

from ispom.sequences.address import is_address, is_device

from .commands import Command, Confirm, Restart
from .services import Services
from .state import Question
from .store import Store


class Questions:
    """Shows at most one question at a time; it is dropped when another run is shown."""

    def __init__(self, store: Store, services: Services) -> None:
        self._store, self._services = store, services
        self._pending: Command | None = None
        """The command that waits for an answer."""
        self._count = 0

    def asks(self, command: Command, what: str) -> bool:
        """Shows a question if the command would lose something, and returns whether it did. `what` is the beginning of
        the sentence: it names what closes the run."""
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
        """Closes the question. Returns its command if the answer is yes, else None."""
        question, command = self._store.state.question, self._pending
        if question is None or command is None or answer.number != question.number:
            return None
        self._store.set(question=None)
        self._pending = None
        return command if answer.yes else None

    def _loss(self, *, live: bool, kept: bool) -> list[str]:
        """Returns phrases about what is lost if the run is closed, without what is stored or can be computed again.
        `live`: includes a live run; `kept`: the forks are kept in the table of runs, so they are not lost."""
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
