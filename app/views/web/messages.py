"""What our page and the server say to each other: the state as JSON, and commands."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Protocol, Union

import msgspec

from ispom.methods import method as registered

from ...engine.frame_record import ERROR, LIVE_ERROR, FrameRecord
from ...engine.verdict import WAITING
from ...presentation import colours
from ...presentation.texts import ALIGNED, PROVISIONAL, length
from ...session.actions import actions
from ...session.branches.state import Branches
from ...session.commands import Command, Factor, Message
from ...session.people import People, Person
from ...session.registry import load_features
from ...session.sources.folders import run_name
from ...session.state import State, covered

if TYPE_CHECKING:
    from ...session.session import Session

Frame = Annotated[int, msgspec.Meta(ge=0)]
STATUS = {
    "waiting": "no frame for this method yet",
    "initialising": "no pose yet",
    "tracking": "tracking (this does not mean that it is accurate)",
    "lost": "no pose at this frame",
}
OWN_UNIT = "A single camera has no metric scale: its path is scaled by the first segment between stereo poses."


class PageLink(Protocol):
    """A page, as what it says to the server finds it. In the loop of the server."""

    session: Session
    people: People
    person: Person

    def see(self, pane: Pane) -> None:
        """The page has its left pane so."""
        ...

    def look_at(self, place: LookAt) -> None:
        """The page is at a place of its own, if it does not control the session."""
        ...

    def follow(self) -> None:
        """The page shows what the session shows, and nothing of its own."""
        ...

    def ready(self, message: Ready) -> None:
        """The viewer of the page can take a frame."""
        ...

    def ring(self) -> None:
        """All pages look at what there is to show now."""
        ...


class PageMessage(Message, frozen=True):
    """What a page says to the server rather than to the session, from whomever it comes."""

    from_page: ClassVar[bool] = True

    def heard(self, page: PageLink) -> None:
        """Does what the page asks for, in the loop of the server."""
        raise NotImplementedError(type(self).__name__)


class Pane(PageMessage, frozen=True):
    """How a page has its left pane."""

    tab: str = ""
    """Which of the panel's tabs is open."""

    def heard(self, page: PageLink) -> None:
        page.see(self)


class Ready(PageMessage, frozen=True):
    """The viewer of a page has taken in what it was given of the run, and can take a frame."""

    run: Annotated[str, msgspec.Meta(max_length=100)] = ""
    """Whose frames it has; empty for none."""
    serial: Frame = 0
    """The number of the last message that it has taken in."""

    def heard(self, page: PageLink) -> None:
        page.ready(self)


class LookAt(PageMessage, frozen=True):
    """Where a page is that looks around while somebody else controls the session: what of it is its own."""

    index: Frame | msgspec.UnsetType = msgspec.UNSET
    playing: bool | msgspec.UnsetType = msgspec.UNSET
    loop: tuple[Frame, Frame | None] | msgspec.UnsetType | None = msgspec.UNSET
    speed: Factor | msgspec.UnsetType | None = msgspec.UNSET

    def heard(self, page: PageLink) -> None:
        page.look_at(self)


class Follow(PageMessage, frozen=True):
    """The page shows again what the session shows, and nothing of its own."""

    def heard(self, page: PageLink) -> None:
        page.follow()


class TakeControl(PageMessage, frozen=True):
    """Who is in control from now on."""

    to: int | None = None
    """The number of a person; None for the one who sends this."""

    def heard(self, page: PageLink) -> None:
        if self.to is None:
            page.people.take_over(page.person)
        else:
            page.people.hand_over(page.person, self.to)


def keys() -> list[dict[str, Any]]:
    """What the page listens to, and lists: each action with the command that it sends."""
    return [
        {"name": a.name, "key": a.key, "label": a.label, "hint": a.hint, "command": msgspec.to_builtins(a.command)}
        for a in actions()
    ]


def message_of(state: State) -> dict[str, Any]:
    """What the page shows, and what the Rerun viewer is to show."""
    covers = state.covers
    state = covered(state)
    found = {
        "source": state.source,
        "name": state.name or state.source,
        "address": {"run": run_name(state.source)},
        "notes": state.notes,
        "guess": None if state.guess is None else round(100 * state.guess.sigma, 1),
        "phase": state.phase,
        "failure": state.failure,
        "run": state.run,
        "recording_id": state.recording_id,
        "total": state.total,
        "computed": state.computed,
        "index": state.index,
        "time_s": round(state.time_s, 3),
        "playing": state.playing,
        "speed": state.speed,
        "loop": [state.loop.start, state.loop.end] if state.loop else None,
        "target": state.target,
        "ended": state.ended,
        "origin": None if state.recorded is None else "recorded" if state.index in state.recorded else "live",
        "activity": state.activity.text if state.activity else None,
        "activity_since": state.activity.since_s if state.activity else None,
        "compiling": state.compiling,
        "methods": [] if covers else [_method(method, state) for method in state.methods],
        "question": None
        if state.question is None
        else {"number": state.question.number, "text": state.question.text, "yes": state.question.yes},
        "notices": [{"number": n.number, "text": n.text, "kind": n.kind} for n in state.notices],
    }
    for value in state.features.values():
        found["address"] |= value.address()
        found |= value.page(state)
    return found


def own_view(local: State, state: State) -> dict[str, Any] | None:
    """What a page that looks around by itself shows otherwise than the session; None where it follows."""
    if local is state:
        return None
    shared = message_of(state)
    return {name: value for name, value in message_of(local).items() if value != shared[name]}


def _method(method: str, state: State) -> dict[str, Any]:
    """How it does, in the word of its card, and (another thing) its error: the ATE of the table of branches, where
    there is a truth."""
    now, label = state.statuses.get(method), colours.label(method)
    status = str(now.status) if now else "waiting"
    word = now.word if now is not None and now.word else WAITING
    hint, error = [f"{label}: {word}: {STATUS[status]}."], ""
    shown = next((b for b in state[Branches].all if b.number == state[Branches].shown), None)
    if shown is not None and (known := shown.measured.errors.get(method)) is not None:
        error, how = length(known.ate_m), ALIGNED[known.alignment]
        hint.append(f"ATE: {error} from the ground truth over {len(known.estimate)} poses, as known now, {how}.")
        curve = shown.measured.curves.get(method)
        here = FrameRecord(method, state.displayed, curve) if state.displayed is not None else None
        if here is not None and here.error_m is not None:
            hint.append(f"{ERROR.label} at this frame: {length(here.error_m)}, {here.aligned}, as known now.")
    if now is not None and now.provisional:
        error = error or PROVISIONAL
        hint.append("Its pose at this frame is provisional: it is not metric yet.")
    if now is not None and now.error_m is not None:
        hint.append(f"{LIVE_ERROR.label} at this frame: {length(now.error_m)}, by the pose as given then, not aligned.")
        hint += [OWN_UNIT] if registered(method).unit == "own" else []
    return {
        "name": method,
        "label": label,
        "colour": colours.css(colours.of(method)),
        "status": status,
        "word": word,
        "severity": str(now.severity) if now is not None else "provisional",
        "error": error,
        "hint": "\n".join(hint),
    }


@cache
def _decoder() -> msgspec.json.Decoder[Any]:
    def kinds(kind: type[Message]) -> list[type[Message]]:
        return [kind, *(each for sub in kind.__subclasses__() for each in kinds(sub))]

    load_features()
    sendable = tuple(kind for kind in kinds(Message) if kind.from_page and not kind.__subclasses__())
    return msgspec.json.Decoder(Union[sendable])  # noqa: UP007


def command_of(text: str) -> Command | PageMessage | None:
    """What a page's message says; None for anything that is not understood."""
    try:
        return _decoder().decode(text)
    except (msgspec.DecodeError, RecursionError, UnicodeError):
        return None
