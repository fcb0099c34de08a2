"""What a person may ask of the session. Callbacks only put these in its queue; the worker does the work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.methods import Config

from ..engine.inspection.colouring import Colouring
from ..engine.options import SourceOptions
from ..features.events.commands import StepToEvent
from ..features.flicker.flicker import Side
from ..features.lessons.commands import OfLessons
from ..features.sweep.commands import OfSweeps
from .state import Look


@dataclass(frozen=True)
class Play:
    """Play, pause, or (None) whichever it is not doing."""

    on: bool | None = None


@dataclass(frozen=True)
class StepBy:
    """Pause, and move by this many exposures."""

    count: int


@dataclass(frozen=True)
class StepTo:
    """Pause, and show the nearest exposure of this kind: a stereo exposure, or one at which a running method made a key
    frame. Forwards, what is not computed yet is computed up to there."""

    kind: Literal["stereo", "key_frame"]
    forwards: bool = True


@dataclass(frozen=True)
class GoToEnd:
    """Pause, and show the newest computed exposure."""


@dataclass(frozen=True)
class LoopEdge:
    """Playing goes round between two exposures: the one that is shown becomes its first or its last."""

    edge: Literal["start", "end"]


@dataclass(frozen=True)
class NoLoop:
    """Playing goes on to the end again."""


@dataclass(frozen=True)
class Seek:
    """Pause, and show this exposure; what is not computed yet is computed up to there. The newest seek wins."""

    index: int


@dataclass(frozen=True)
class Speed:
    """Playing speed as a multiple of the recorded time; None for as fast as possible."""

    factor: float | None


@dataclass(frozen=True)
class Restart:
    """Start the run again from the first exposure, with these methods and settings."""

    methods: tuple[str, ...]
    config: Config


@dataclass(frozen=True)
class Fork:
    """At the exposure that is shown: run on from that exact state with these methods and settings, as a branch beside
    the run, which is kept."""

    methods: tuple[str, ...]
    config: Config
    name: str = ""
    """Of the branch; empty for a made-up one."""


@dataclass(frozen=True)
class ShowBranch:
    """Show another branch, at the same exposure."""

    number: int


@dataclass(frozen=True)
class RenameBranch:
    number: int
    name: str


@dataclass(frozen=True)
class HideBranch:
    """Draw a branch beside the shown one, or not."""

    number: int
    hidden: bool


@dataclass(frozen=True)
class DeleteBranch:
    """Forget a branch that is not shown. Those forked from it stay."""

    number: int


@dataclass(frozen=True)
class CompareBranch:
    """Look for the first differences between the branch that is shown and another one."""

    number: int


@dataclass(frozen=True)
class CompareRuns:
    """Show one run and compare it with another one. Those of the recordings folder are opened for that."""

    a: str
    """As the runs table has it: `live:` and the number of a branch, or a name in the recordings folder."""
    b: str


@dataclass(frozen=True)
class Predict:
    """What this error of the calibration would do to the run that is shown, as far as it is computed."""

    wrong: Perturbation


@dataclass(frozen=True)
class RunPerturbed:
    """Run it again from the first exposure, as a branch, with the error that was predicted last."""


@dataclass(frozen=True)
class PutBookmark:
    """Mark the exposure that is shown; None keeps the note that is there."""

    note: str | None = None


@dataclass(frozen=True)
class ToggleBookmark:
    """Mark the exposure that is shown; where it has a mark without a note, remove that."""


@dataclass(frozen=True)
class RemoveBookmark:
    exposure: int


@dataclass(frozen=True)
class PutNote:
    """Keep a note with one of the runs and recordings of the list; an empty one removes it."""

    name: str
    """As the list has it."""
    note: str


@dataclass(frozen=True)
class FlickerBetween:
    """Draw one of two sides at a time, the first of them now."""

    a: Side
    b: Side


@dataclass(frozen=True)
class Flick:
    """Draw the other side of the flicker; without one, begin it between the usual two."""


@dataclass(frozen=True)
class StopFlicker:
    """Draw all as usual."""


@dataclass(frozen=True)
class ShowIntegration:
    """Look at how a method's latest fit came about, from its first stage on; without a name, no longer."""

    method: str


@dataclass(frozen=True)
class StepIntegration:
    """So many stages on."""

    by: int


@dataclass(frozen=True)
class Open:
    """Open another source, and play it: `sim:NAME`, an address, or a path."""

    source: str
    options: SourceOptions | None = None
    """None: as the command line said."""


@dataclass(frozen=True)
class OpenNamed:
    """Open the run of this name, where it is one that is known here (sources/known.py). A name, never a path."""

    name: str


@dataclass(frozen=True)
class Confirm:
    """The answer to the question whether the run may be closed (closing.py), by its number."""

    number: int
    yes: bool


@dataclass(frozen=True)
class Record:
    """Record the run, from its first exposure on, under this name (a name, never a path); empty for a made-up one."""

    name: str


@dataclass(frozen=True)
class StopRecording:
    """Write what is left, and close the file."""


@dataclass(frozen=True)
class RepairRecordings:
    """Finish the recordings that a stopped app left unfinished: they get their index, and their name."""


@dataclass(frozen=True)
class Hide:
    """Draw all but these layers and methods."""

    names: frozenset[str]


@dataclass(frozen=True)
class Select:
    """Look closely at a track or a key frame, as app/inspect/selection.py writes it; empty for nothing."""

    what: str


@dataclass(frozen=True)
class Pick:
    """Select the track that is nearest to a pixel of a camera's image at an exposure."""

    camera: str
    index: int
    u: float
    v: float


@dataclass(frozen=True)
class ColourBy:
    """What the colours of tracks mean, in all images."""

    what: Colouring


@dataclass(frozen=True)
class LookAt:
    """What the Look tab shows: the picture of a camera, and one of its panels; None leaves either as it is."""

    panel: Look | None = None
    camera: str | None = None


@dataclass(frozen=True)
class Notify:
    """Tell the person of a fault."""

    text: str


@dataclass(frozen=True)
class Shutdown:
    """Close the recording and end the worker."""


@dataclass(frozen=True)
class RunUntil:
    """Run on, as fast as possible, until this condition holds at an exposure after the one that is shown."""

    condition: str


@dataclass(frozen=True)
class FindMatch:
    """Show the next (or, backwards, the previous) of the computed exposures at which this condition holds."""

    condition: str
    forwards: bool = True


@dataclass(frozen=True)
class Plot:
    """Plot a quantity over the frames, or stop plotting it."""

    name: str
    """METHOD.KEY, or the KEY of Steps for all methods."""


@dataclass(frozen=True)
class SetPlots:
    """Plot just these quantities; None for the usual ones."""

    names: tuple[str, ...] | None


Moves = Play | StepBy | StepTo | StepToEvent | Seek | GoToEnd | LoopEdge | NoLoop | Speed
OfLook = Select | Pick | ColourBy | LookAt
OfBranches = Fork | ShowBranch | RenameBranch | HideBranch | DeleteBranch | CompareBranch | CompareRuns
OfCalibration = Predict | RunPerturbed
OfViews = FlickerBetween | Flick | StopFlicker | ShowIntegration | StepIntegration
Command = (
    Moves
    | OfViews
    | RunUntil
    | FindMatch
    | Plot
    | SetPlots
    | Restart
    | OfBranches
    | OfCalibration
    | OfLessons
    | OfSweeps
    | OfLook
    | PutBookmark
    | ToggleBookmark
    | RemoveBookmark
    | Open
    | OpenNamed
    | Confirm
    | Record
    | StopRecording
    | RepairRecordings
    | PutNote
    | Hide
    | Notify
    | Shutdown
)
