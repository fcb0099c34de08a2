"""Commands that every session knows. Those of a feature are in `features/NAME/commands.py`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import msgspec

from ispom.methods import Config
from ispom.sequences.address import without_secrets

from ..engine.options import SourceOptions
from . import moves
from .state import Event, NoticeAdded, State, changed

if TYPE_CHECKING:
    from .controller import Controller
    from .current_run import CurrentRun


Factor = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
"""Speed as a multiple of the recorded time."""


def _snake_case(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class Message(msgspec.Struct, frozen=True, tag_field="do", tag=_snake_case, forbid_unknown_fields=True):
    """A message that a page can send as JSON: `{"do": "step_by", "count": 1}` is `StepBy(1)`."""

    from_page: ClassVar[bool] = False
    """Whether a page may send it. Other messages come from the controls and from the program itself."""


class Command(Message, frozen=True):
    """A request of a person to the session. It is queued when it is posted, and the worker executes it."""

    in_lessons: ClassVar[bool] = False
    """Whether it is allowed while a question of a lesson is open, whatever it changes."""
    keeps: ClassVar[bool] = False
    """Whether a run that it closes is kept in the table of runs, with its forks."""
    newest_only: ClassVar[bool] = False
    """Whether it is discarded when another command of its kind follows: a slider sends many."""

    only_looks: ClassVar[bool] = False
    """Whether a page that does not control the session may execute it for itself, because it changes nothing of the
    run."""

    def look(self, state: State, run: CurrentRun) -> tuple[Event, ...]:
        """Returns the changes to features for such a page, which shows `state`. InputError where it is not possible."""
        raise NotImplementedError(type(self).__name__)

    def execute(self, session: Controller) -> None:
        """Executes the command, in the worker's thread. InputError where it is not possible."""
        raise NotImplementedError(type(self).__name__)

    def closing(self, session: Controller) -> str:
        """Returns the beginning of a sentence about the command if it closes the run, else an empty text. A person must
        confirm it first if something would be lost."""
        return ""


class PageCommand(Command, frozen=True):
    """A command that a page may send."""

    from_page: ClassVar[bool] = True


class Play(PageCommand, frozen=True):
    """Play, pause, or (None) whichever it is not doing."""

    on: bool | None = None

    def execute(self, session: Controller) -> None:
        session.player.move(*moves.play(session.state, session.run, self.on))


class StepBy(PageCommand, frozen=True):
    """Pause, and move by this many frames."""

    count: int

    def execute(self, session: Controller) -> None:
        session.player.move(*moves.step(session.state, session.run, self.count))


class StepTo(PageCommand, frozen=True):
    """Pause, and show the nearest frame of this kind: a stereo frame, or one at which a running method made a keyframe.
    Forwards, computes all frames up to it first."""

    kind: Literal["stereo", "key_frame"]
    forwards: bool = True

    def execute(self, session: Controller) -> None:
        session.player.move(*moves.step_to(session.state, session.run, self.kind, forwards=self.forwards))


class GoToEnd(PageCommand, frozen=True):
    """Pause, and show the newest computed frame."""

    def execute(self, session: Controller) -> None:
        session.player.move(*moves.to_end(session.run))


class LoopEdge(PageCommand, frozen=True):
    """Playing goes round between two frames: the one that is shown becomes its first or its last."""

    edge: Literal["start", "end"]

    def execute(self, session: Controller) -> None:
        session.store.emit(*moves.loop_edge(session.state, self.edge))


class SetLoop(PageCommand, frozen=True):
    """Playing goes round between two frames."""

    start: int
    end: int | None = None
    """None: the last one of the source."""

    def execute(self, session: Controller) -> None:
        session.store.emit(*moves.set_loop(session.state, self.start, self.end))


class NoLoop(PageCommand, frozen=True):
    """Playing goes on to the end again."""

    def execute(self, session: Controller) -> None:
        session.store.set(loop=None)


class Seek(PageCommand, frozen=True):
    """Pause, and show this frame; computes all frames up to it first. The newest seek wins."""

    index: int
    newest_only: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.player.move(*moves.seek(session.run, self.index))


class Speed(PageCommand, frozen=True):
    """Playing speed as a multiple of the recorded time; None for as fast as possible."""

    factor: Factor | None

    def execute(self, session: Controller) -> None:
        session.player.move(changed(speed=self.factor))


class Restart(Command, frozen=True):
    """Start the run again from the first frame, with these methods and settings."""

    methods: tuple[str, ...]
    config: Config

    def execute(self, session: Controller) -> None:
        session.screen.restart(self.methods, self.config)

    def closing(self, session: Controller) -> str:
        return "Starting again from the first frame"


class Open(Command, frozen=True):
    """Open another source, and play it: `sim:NAME`, an address, or a path."""

    source: str
    options: SourceOptions | None = None
    """None: as in the command line."""
    keeps: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        if session.screen.open(self.source, self.options):
            session.screen.play_on()

    def closing(self, session: Controller) -> str:
        return f"Opening {without_secrets(self.source)}"


class Confirm(PageCommand, frozen=True):
    """The answer to the question whether the run may be closed, by its number."""

    number: int
    yes: bool


class Notify(Command, frozen=True):
    """Show a fault to the person."""

    text: str
    in_lessons: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.store.emit(NoticeAdded(self.text))


class Shutdown(Command, frozen=True):
    """Close the recording and end the worker."""


Moves = Play | StepBy | StepTo | Seek | GoToEnd | LoopEdge | SetLoop | NoLoop | Speed
