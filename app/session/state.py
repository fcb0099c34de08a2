"""What the screen shows, as one frozen value, and how events change it. No viewer, thread or file in here.

The core is in `State`; each feature keeps a value of its own in it, a `FeatureState`, and changes it by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, Self, TypedDict, TypeVar, Unpack

from ispom.methods import Config, possible_methods
from ispom.types import Guess

from ..engine.events import Finished, Opened
from ..engine.history.history import HistoryUsage
from ..engine.history.record import ExposureRecord, MethodStatus
from ..engine.model.run_model import Tally
from ..engine.options import SourceOptions
from .goals import Goal

MAX_NOTICES = 5


class FeatureState:
    """What one feature keeps in the state: subclasses are frozen dataclasses whose fields all have defaults."""

    def reduce(self, event: Event) -> Self:
        """The value after an event. By default, another source begins with the defaults."""
        return type(self)() if isinstance(event, Opening) else self

    def page(self, state: State) -> Mapping[str, Any]:
        """What the page's scripts get to know of it, as JSON values by name."""
        return {}

    def address(self) -> Mapping[str, Any]:
        """What the page's address says of it, by name of the part."""
        return {}

    @property
    def in_the_way(self) -> frozenset[str]:
        """Layers that the views do not show, for they hide what this feature shows."""
        return frozenset()

    @property
    def covers(self) -> bool:
        """Whether numbers, checks and settings are hidden from people, for they would answer an open question."""
        return False

    def cover(self, state: State) -> State:
        """The state with its core as people may see it. Called where this feature covers it."""
        return state

    def covered(self) -> Self:
        """The value as people may see it while another feature covers numbers, checks and settings."""
        return self


F = TypeVar("F", bound=FeatureState)


@dataclass(frozen=True)
class Notice:
    """A message to the person."""

    number: int
    text: str
    kind: Literal["info", "error"] = "error"


@dataclass(frozen=True)
class Question:
    """Whether a command that closes the run, and loses something with it, shall be carried out."""

    number: int
    """An answer names it: one that comes late answers no other question."""
    text: str
    yes: str
    """What the button says that carries it out."""


@dataclass(frozen=True)
class Loop:
    """The frames between which playing goes round."""

    start: int = 0
    end: int | None = None
    """None: the last one of the source."""


@dataclass(frozen=True)
class Activity:
    """Something under way that may take long: what, and since when (time.monotonic)."""

    text: str
    since_s: float


@dataclass(frozen=True, eq=False)
class State:
    """All that is on the screen, except what each viewer draws of the history."""

    source: str
    phase: Literal["empty", "opening", "ready", "failed"] = "opening"
    """`empty`: the app was started without a source, and none was opened since."""
    failure: str = ""
    """Why the source could not be opened, where it is `failed`."""
    name: str = ""
    """Of the sequence, as a person knows it."""
    notes: tuple[str, ...] = ()
    guess: Guess | None = None
    """Of a video camera without a calibration."""
    cameras: tuple[str, ...] = ()
    """Names of the cameras besides the video camera and the pair."""
    possible: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    config: Config = field(default_factory=Config)
    run: int = 0
    """Counts runs; viewers start again when it changes."""
    recording_id: str = ""
    """Of the run, in the viewers."""
    total: int = 0
    computed: int = 0
    """Frames computed."""
    start_ns: int = 0
    """The first frame's time."""
    displayed: ExposureRecord | None = None
    """The frame that is shown."""
    playing: bool = False
    speed: float | None = 1.0
    """Times the recorded time; None for as fast as possible."""
    question: Question | None = None
    """What is to be answered before the run is closed for another one."""
    loop: Loop | None = None
    until: Goal | None = None
    """What a run goes on towards."""
    target: int | None = None
    """The frame that a seek is computing towards."""
    ended: bool = False
    """Whether every frame was computed."""
    recorded: range | None = None
    """Frames that are known from a recording only, of a run that began with one; None for other runs."""
    activity: Activity | None = None
    source_options: SourceOptions = field(default_factory=SourceOptions)
    """How the source was opened."""
    recent: tuple[str, ...] = ()
    """Sources that were opened, newest first."""
    compiling: str = ""
    """What is compiled in the background, and for how long still; empty while nothing is."""
    notices: tuple[Notice, ...] = ()
    notice_count: int = 0
    """Notices so far, those no longer shown included."""
    features: Mapping[type[FeatureState], FeatureState] = field(
        default_factory=lambda: {kind: kind() for kind in FeatureState.__subclasses__()}
    )
    """What the features keep, by kind."""

    def __getitem__(self, kind: type[F]) -> F:
        """What a feature keeps: `state[Bookmarks].marks`."""
        found = self.features.get(kind)
        return kind() if found is None else found  # type: ignore[return-value]

    def having(self, *values: FeatureState) -> State:
        """The state with these values of features."""
        return replace(self, features={**self.features, **{type(value): value for value in values}})

    @property
    def covers(self) -> bool:
        """Whether numbers, checks and settings are hidden from people: see `covered`."""
        return any(value.covers for value in self.features.values())

    @property
    def index(self) -> int:
        """Of the frame that is shown; -1 for none yet."""
        return self.displayed.index if self.displayed else -1

    @property
    def time_s(self) -> float:
        """Of the frame that is shown, since the first one."""
        return (self.displayed.time_ns - self.start_ns) * 1e-9 if self.displayed else 0.0

    @property
    def statuses(self) -> Mapping[str, MethodStatus]:
        return self.displayed.statuses if self.displayed else MappingProxyType({})


@dataclass(frozen=True)
class Opening:
    """A source is being opened, or (the same source again) its run started again."""

    source: str


@dataclass(frozen=True)
class OpeningFailed:
    reason: str


@dataclass(frozen=True, eq=False)
class Restored:
    """What was begun is given up: all is as it was before."""

    before: State


@dataclass(frozen=True, eq=False)
class Computed:
    """One more frame is in the history."""

    record: ExposureRecord
    tally: Tally
    """Of the branch, this frame included."""
    history_usage: HistoryUsage = HistoryUsage()
    """Of the branch."""


@dataclass(frozen=True, eq=False)
class Resumed:
    """Another branch is shown, as far as it came."""

    opened: Opened
    branch: int
    computed: int
    displayed: ExposureRecord | None
    ended: bool


@dataclass(frozen=True, eq=False)
class Displayed:
    """Another frame of the history is shown."""

    record: ExposureRecord


@dataclass(frozen=True)
class NoticeAdded:
    """Something that a person must know of."""

    text: str
    kind: Literal["info", "error"] = "error"


@dataclass(frozen=True, eq=False)
class FeatureChanged:
    """A feature keeps another value."""

    value: FeatureState


class CoreValues(TypedDict, total=False):
    """Fields of the core that take new values as they are; `total` and `notes` are those of a live source."""

    playing: bool
    speed: float | None
    target: int | None
    until: Goal | None
    loop: Loop | None
    activity: Activity | None
    compiling: str
    question: Question | None
    source_options: SourceOptions
    recent: tuple[str, ...]
    recorded: range | None
    total: int
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Changed:
    """Fields of the core took new values."""

    values: CoreValues


Progress = Computed | Displayed | Finished
Event = Opening | OpeningFailed | Restored | Opened | Resumed | Progress | NoticeAdded | Changed | FeatureChanged


def covered(state: State) -> State:
    """The state as people may see it: while a question is open, nothing in it gives the answer away."""
    covering = next((value for value in state.features.values() if value.covers), None)
    if covering is None:
        return state
    return replace(covering.cover(state), features={kind: value.covered() for kind, value in state.features.items()})


def changed(**values: Unpack[CoreValues]) -> Changed:
    """The event that sets these fields."""
    return Changed(values)


def reduce(state: State, event: Event) -> State:
    """The state after an event."""
    if isinstance(event, Restored):
        return event.before
    state = _core(state, event)
    if isinstance(event, FeatureChanged):
        return state.having(event.value)
    features = {kind: value.reduce(event) for kind, value in state.features.items()}
    unchanged = all(features[kind] is value for kind, value in state.features.items())
    return state if unchanged else replace(state, features=features)


def _core(state: State, event: Event) -> State:
    match event:
        case Opening(source):
            return replace(
                state,
                source=source,
                phase="opening",
                playing=False,
                target=None,
                ended=False,
                displayed=None,
                computed=0,
                recorded=None,
                question=None,
                loop=None,
            )
        case OpeningFailed(reason):
            failed = replace(state, phase="failed", failure=reason, playing=False, activity=None)
            return _core(failed, NoticeAdded(reason))
        case Opened(sequence, methods, config, _, recording_id):
            return replace(
                state,
                phase="ready",
                name=sequence.name,
                notes=sequence.notes,
                guess=sequence.guess,
                cameras=tuple(sequence.rig.cameras),
                possible=possible_methods(sequence.rig),
                methods=methods,
                config=config,
                run=state.run + 1,
                recording_id=recording_id,
                total=len(sequence),
                start_ns=int(sequence.times_ns[0]) if len(sequence) else 0,
                activity=None,
            )
        case Resumed(opened, _, computed, displayed, ended):
            shown = replace(state, computed=computed, displayed=displayed, ended=ended, target=None)
            return _core(shown, opened)
        case Computed(record):
            return replace(state, displayed=record, computed=record.index + 1)
        case Displayed(record):
            return replace(state, displayed=record)
        case Finished():
            return replace(state, ended=True, playing=state.playing and state.loop is not None)
        case NoticeAdded(text, kind):
            notice = Notice(state.notice_count + 1, text, kind)
            return replace(state, notice_count=notice.number, notices=(*state.notices, notice)[-MAX_NOTICES:])
        case Changed(values):
            # Another move: what the one before looked for is not looked for any more.
            values = {"until": None, **values} if "target" in values else dict(values)
            return replace(state, **values)  # type: ignore[arg-type]
        case _:
            return state
