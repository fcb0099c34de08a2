"""What the screen shows, as one frozen value, and how events change it. No viewer, thread or file in here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.methods import Config, possible_methods
from ispom.types import Guess

from ..engine.conditions.parser import Expression
from ..engine.events import Bookmark, Finished, Opened
from ..engine.external_trajectories.placed import Beside
from ..engine.history.held import Held
from ..engine.history.record import ExposureRecord, MethodStatus
from ..engine.inspection.colouring import Colouring
from ..engine.model.tally import Tally
from ..engine.options import SourceOptions
from ..features.branches.branches import FIRST, Branch
from ..features.branches.comparison import Comparison
from ..features.events.commands import NextEvent
from ..features.flicker.flicker import Flicker
from ..features.integration.integration import Integration
from ..features.lessons.learning import Learning
from ..features.plots.plotting import DEFAULT_PLOTS
from ..features.sensitivity.service import Effect
from ..features.sweep.sweep import Sweep

MAX_NOTICES = 5
Look = Literal["track", "tracks", "lifetimes", "key frames", "residuals", "geometry"]


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
class Recording:
    """The recording that is being written."""

    name: str
    size_bytes: int
    written: int
    """Exposures in the file so far."""
    closing: bool = False


@dataclass(frozen=True)
class Kept:
    """A finished run, or a recording alone, in the recordings folder."""

    name: str
    """The run's folder or the recording, in the recordings folder: opened for review."""
    size_bytes: int
    recording: str = ""
    """Its .rrd, in the recordings folder; empty for a run without one."""
    picture: str = ""
    """A small one, in the recordings folder; empty for none."""
    source: str = ""
    """Of the images, as a person knows it; empty where nothing says."""
    exposures: int = 0
    duration_s: float = 0.0
    note: str = ""
    """A person's own."""


@dataclass(frozen=True)
class Loop:
    """The exposures between which playing goes round."""

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
    """All that is on the screen, apart from what each viewer draws of the history."""

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
    possible: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    config: Config = field(default_factory=Config)
    run: int = 0
    """Counts runs; viewers start afresh when it changes."""
    recording_id: str = ""
    """Of the run, in the viewers."""
    total: int = 0
    computed: int = 0
    """Exposures computed."""
    start_ns: int = 0
    """The first exposure's time."""
    displayed: ExposureRecord | None = None
    """The exposure that is shown."""
    playing: bool = False
    speed: float | None = 1.0
    """Times the recorded time; None for as fast as possible."""
    branches: tuple[Branch, ...] = ()
    """Of the source, since its run was started; the first is that run."""
    branch: int = 0
    """The number of the one that is shown."""
    beside: tuple[Beside, ...] = ()
    """Trajectories of other programs over the same source."""
    beside_errors: Mapping[str, TrajectoryError] = field(default_factory=dict)
    """Their errors by name, over the exposures that are computed."""
    comparison: Comparison | None = None
    """Of two branches."""
    plots: tuple[str, ...] = DEFAULT_PLOTS
    """The quantities that the time dock plots, METHOD.KEY, or KEY for all methods."""
    flicker: Flicker | None = None
    """Two methods or branches of which one is drawn at a time; None for all as usual."""
    integration: Integration | None = None
    """The integration that is looked at step by step."""
    effect: Effect | None = None
    """What an error of the calibration would do."""
    sweep: Sweep | None = None
    """The one that was begun last, of whatever source."""
    lesson: Learning | None = None
    """The lesson that is on, and where it is."""
    progress: Mapping[str, int] = field(default_factory=dict)
    """By lesson: the steps whose answer was revealed."""
    question: Question | None = None
    """What is to be answered before the run is closed for another one."""
    loop: Loop | None = None
    until: Expression | NextEvent | None = None
    """The condition, or the event, that a run goes on towards."""
    marked: Expression | None = None
    """The condition that was asked for last: where it holds is marked on the time axis."""
    bookmarks: tuple[Bookmark, ...] = ()
    """Of the source's exposures, in their order."""
    target: int | None = None
    """The exposure that a seek is computing towards."""
    ended: bool = False
    """Whether every exposure was computed."""
    activity: Activity | None = None
    recording: Recording | None = None
    recordings: tuple[Kept, ...] = ()
    unfinished: tuple[str, ...] = ()
    """Recordings that a stopped app left unfinished; none that is being written."""
    source_options: SourceOptions = field(default_factory=SourceOptions)
    """How the source was opened."""
    recent: tuple[str, ...] = ()
    """Sources that were opened, newest first."""
    compiling: str = ""
    """What is compiled in the background, and for how long still; empty while nothing is."""
    hidden: frozenset[str] = frozenset()
    """Layers and methods that are not drawn."""
    selected: str = ""
    """What is looked at closely, as app/inspect/selection.py writes it: `track:monocular:181`; empty for nothing."""
    colour_by: Colouring = "state"
    """What the colours of tracks mean."""
    camera: str = ""
    """Whose picture is looked at; empty for the first that the rig has."""
    look: Look = "track"
    """What the Look tab shows below the picture."""
    notices: tuple[Notice, ...] = ()
    notice_count: int = 0
    """Notices so far, those no longer shown included."""

    @property
    def index(self) -> int:
        """Of the exposure that is shown; -1 for none yet."""
        return self.displayed.index if self.displayed else -1

    @property
    def time_s(self) -> float:
        """Of the exposure that is shown, since the first one."""
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
    """One more exposure is in the history."""

    record: ExposureRecord
    tally: Tally
    """Of the branch, this exposure included."""
    held: Held = Held()
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
    """Another exposure of the history is shown."""

    record: ExposureRecord


@dataclass(frozen=True)
class Flicked:
    """The other side of the flicker is drawn."""


@dataclass(frozen=True)
class NoticeAdded:
    """Something that a person must know of."""

    text: str
    kind: Literal["info", "error"] = "error"


@dataclass(frozen=True)
class Changed:
    """Plain fields took new values (see _CHANGEABLE); total and notes those of a live source."""

    values: Mapping[str, object]


Progress = Computed | Displayed | Finished
Event = Opening | OpeningFailed | Restored | Opened | Resumed | Progress | Flicked | NoticeAdded | Changed
_CHANGEABLE = {"playing", "speed", "target", "activity", "compiling", "recording", "recordings", "hidden", "recent"}
_CHANGEABLE |= {"selected", "colour_by", "camera", "look", "plots"}
_CHANGEABLE |= {"lesson", "progress", "beside_errors", "question"}
_CHANGEABLE |= {"unfinished", "bookmarks", "flicker", "integration", "effect", "sweep"}
_CHANGEABLE |= {"source_options", "total", "notes", "branches", "until", "loop", "marked", "comparison"}


def changed(**values: object) -> Changed:
    """The event that sets these fields; KeyError for one that only other events may set."""
    if unknown := values.keys() - _CHANGEABLE:
        raise KeyError(f"not changeable: {sorted(unknown)}")
    return Changed(values)


def reduce(state: State, event: Event) -> State:
    """The state after an event."""
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
                branches=(),
                branch=0,
                comparison=None,
                flicker=None,
                integration=None,
                effect=None,
                question=None,
                loop=None,
                marked=None,
                selected="",
                camera="",
            )
        case OpeningFailed(reason):
            failed = replace(state, phase="failed", failure=reason, playing=False, activity=None)
            return reduce(failed, NoticeAdded(reason))
        case Restored(before):
            return before
        case Opened(sequence, methods, config, _, recording_id, beside):
            return replace(
                state,
                phase="ready",
                name=sequence.name,
                notes=sequence.notes,
                guess=sequence.guess,
                possible=possible_methods(sequence.rig),
                methods=methods,
                config=config,
                run=state.run + 1,
                branches=state.branches or (Branch(0, FIRST),),
                recording_id=recording_id,
                beside=beside,
                total=len(sequence),
                start_ns=int(sequence.times_ns[0]) if len(sequence) else 0,
                activity=None,
            )
        case Resumed(opened, branch, computed, displayed, ended):
            shown = replace(state, branch=branch, computed=computed, displayed=displayed, ended=ended, target=None)
            return reduce(shown, opened)
        case Computed(record, tally, held):
            computed = record.index + 1
            branches = _with_branch(state, computed=computed, tally=tally, held=held)
            return replace(state, displayed=record, computed=computed, branches=branches)
        case Displayed(record):
            return replace(state, displayed=record)
        case Finished():
            return replace(state, ended=True, playing=state.playing and state.loop is not None)
        case Flicked():
            return replace(state, flicker=state.flicker and state.flicker.turned)
        case NoticeAdded(text, kind):
            notice = Notice(state.notice_count + 1, text, kind)
            return replace(state, notice_count=notice.number, notices=(*state.notices, notice)[-MAX_NOTICES:])
        case Changed(values):
            if "target" in values:  # another move: what the one before looked for is not looked for any more
                values = {"until": None, **values}
            return replace(state, **values)  # type: ignore[arg-type]


def _with_branch(state: State, **values: Any) -> tuple[Branch, ...]:
    """The branches, with new values of the one that is shown."""
    return tuple(replace(b, **values) if b.number == state.branch else b for b in state.branches)
