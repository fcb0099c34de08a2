"""One clip, in whatever process: run by `ispom run`'s own way, diagnosed by the doctor, written as a row."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Sequence as Several
from dataclasses import dataclass
from pathlib import Path

import msgspec

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.io.files import confined, exists
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links
from ispom.methods import method as registered
from ispom.plausibility.doubt import Doubt
from ispom.stop import check_stop
from ispom.types import FRAME_KINDS, Sequence, main_image

from ...engine.playback import Builder
from ...engine.run_events.event import RunEvent
from ...engine.run_events.stretch import events_in, stretch_of
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import MARKER, METRICS, is_incomplete
from ...engine.run_folder.thumbnail import jpeg
from ..doctor.command import opened
from ..doctor.job import examine
from ..doctor.options import FRAMES, Doctor
from ..doctor.origin import Origin
from ..headless.command import LEAST_FRAMES, NO_MOTION, played_into
from ..headless.console import silent
from ..headless.job import Job
from ..headless.options import Run as Options
from ..headless.suspicions import NOTHING, asked, suspected
from .advice import group_of, of_diagnosis, of_events, of_located
from .clips import Clip, stamp
from .row import Action, Group, Row, write_row

WIDTH_PX, QUALITY = 320, 70
"""Width and JPEG quality of the image of a frame: a hundred of them make a page of some 2 MB."""


@dataclass(frozen=True)
class Order:
    """What is done with every clip."""

    folder: str
    methods: tuple[str, ...] = ()
    """Empty: all default ones that a clip has the cameras for."""
    max_exposures: int | None = None
    doctor: bool = True
    seconds: float = 60.0
    """Of an examination."""


@dataclass(frozen=True)
class Done:
    """A clip whose row is written."""

    run: Clip
    failure: str | None
    """The sentence of one that cannot be opened."""


def execute(order: Order, clip: Clip, out: Path, recording: bool = False, builder: Builder = build) -> Done:
    """Writes the row of a clip that is computed now. What goes wrong with it is in the row; only a signal is raised."""
    before = stamp(clip)
    try:
        row = _row(order, clip, out, builder)
    except InputError as error:
        row = unopened(clip, str(error))
    except Exception as error:
        row = unopened(clip, f"{type(error).__name__}: {error}")
    write_row(out, clip, msgspec.structs.replace(row, stamp=before))
    return Done(clip, row.cause if row.group == Group.UNOPENED else None)


def failed(clip: Clip, why: str) -> Done:
    """What stands for a clip that no worker could compute; it has no row."""
    return Done(clip, why)


def unopened(clip: Clip, why: str) -> Row:
    """Returns the row of a clip that cannot be run."""
    return Row(str(clip), Group.UNOPENED, cause=shown_cause(why, clip), action=Action.CORRECT)


def shown_cause(sentence: str, clip: Clip) -> str:
    """Returns the sentence with the clip's name in place of its path, and a capital letter."""
    text = printable(sentence.replace(clip.source, clip.name))
    return text if text.startswith(clip.name) else text[:1].upper() + text[1:]


def _row(order: Order, clip: Clip, out: Path, builder: Builder) -> Row:
    if clip.problem:
        raise InputError(clip.problem)
    if clip.is_run:
        return _of_run(order, clip, Path(clip.source), clip.source, [], None, builder)
    folder = out / clip.folder
    require_no_links(out, folder / "any")
    if exists(folder):  # of a clip that was changed, or of a command that was killed
        shutil.rmtree(folder)
    options = Options(
        source=clip.source, out=folder, recording=False, methods=order.methods, max_exposures=order.max_exposures
    )
    with confined((Path(order.folder),)):
        sequence = options.open(clip.source)
    said, quick, why = [str(note) for note in sequence.notes if isinstance(note, Doubt)], NOTHING, None
    try:
        job = played_into(options, sequence, builder, progress=silent)
        if order.doctor and not _alarming(job) and len(job.seen.film) >= LEAST_FRAMES:
            more, quick = suspected(job)
            said += more
    except InputError as error:
        if NO_MOTION not in str(error):
            raise
        why = str(error)
    return _of_run(order, clip, folder, clip.folder.as_posix(), said, why, builder, quick)


def _alarming(job: Job) -> bool:
    return any(event.severity.alarming for event in job.events.log.events)


def _of_run(
    order: Order,
    clip: Clip,
    folder: Path,
    place: str,
    said: list[str],
    no_motion: str | None,
    builder: Builder,
    quick: Diagnosis = NOTHING,
) -> Row:
    """The row of a run that is in a folder. `said`: what is known against its recording; `no_motion`: why no method
    found a motion; `quick`: what the doctor says of a run without trouble."""
    run = read_run_file(folder)
    complete = not is_incomplete(folder)
    if not complete and no_motion is None:
        reason = (read_text(folder / MARKER).strip().splitlines() or ["no reason is given"])[0]
        if NO_MOTION not in reason:
            raise InputError(f"{clip.source} holds a run that is not complete ({reason}): run it again")
        no_motion = reason
    events, sequence, problem = events_in(folder), None, ""
    try:
        sequence = opened(Doctor(run=folder), run)
    except InputError as error:
        problem = str(error)
    alarming = [event for event in events if event.severity.alarming]
    if clip.is_run and sequence is not None:
        said = [str(note) for note in sequence.notes if isinstance(note, Doubt)]
        quick = asked(sequence, []) if order.doctor and not alarming else NOTHING
    located = _located(folder, run)
    values: dict[str, object] = {"frames": sum(run.exposures.values()), **of_located(located)}
    troubled = bool(alarming) or no_motion is not None or "cause" in values
    values |= of_events(events, values["frames"])  # type: ignore[arg-type]
    if no_motion is not None:
        values |= {"cause": no_motion, "action": Action.LOOK}
    if troubled and order.doctor and sequence is not None:
        try:
            values |= of_diagnosis(_examined(order, folder, run, sequence, events, complete, builder))
        except InputError as error:
            problem = str(error)
    elif quick.causes:
        values |= of_diagnosis(quick)
    if said and not values.get("suspect"):  # it says more than that nothing explains it
        values |= {"cause": said[0], "action": Action.CORRECT, "advice": ""}
    if problem and not values.get("advice"):
        values["advice"] = f"No diagnosis: {problem}"
    doubted = bool(said or quick.causes or troubled)
    row = Row(
        str(clip),
        group_of(events, no_motion is None and 0.0 not in located.values(), doubted),
        run=place,
        complete=complete,
    )
    values["cause"] = shown_cause(str(values.get("cause", "")), clip)
    row = msgspec.structs.replace(row, located_percent=located, **values)
    return row if sequence is None else _with_picture(row, sequence)


def _examined(
    order: Order,
    folder: Path,
    run: RunFile,
    sequence: Sequence,
    events: Several[RunEvent],
    complete: bool,
    builder: Builder,
) -> Diagnosis:
    """What `ispom doctor` says of the run; a run without an end is not rerun."""
    stretch = stretch_of(sequence, None, FRAMES, events)
    origin = Origin.of_folder(folder, run, sequence, builder) if complete else None
    return examine(sequence, stretch, order.seconds, lambda progress: check_stop(), origin=origin)


def _located(folder: Path, run: RunFile) -> dict[str, float | None]:
    """By method, the share of its frames that is located [%]; None where it had no frame. A method that never took a
    step, as where a clip ends before it could begin, has located none."""
    if not exists(folder / METRICS):
        return {}
    found = json.loads(read_text(folder / METRICS)).get("methods", {})
    shares: dict[str, float | None] = {}
    for name in run.methods:
        frames = sum(run.exposures.get(kind, 0) for kind in registered(name).sensors)
        located = found.get(name, {}).get("located", 0)
        shares[name] = round(100 * located / frames, 1) if frames and isinstance(located, int | float) else None
    return shares


def _with_picture(row: Row, sequence: Sequence) -> Row:
    """With the image of the frame to look at, the middle one where none is worse; without where it cannot be read."""
    own = [i for i, kind in enumerate(sequence.kinds) if kind in FRAME_KINDS]
    wanted = row.frame if row.frame is not None else len(sequence) // 2
    frame = min(own, key=lambda i: abs(i - wanted))
    row = msgspec.structs.replace(row, frame=frame)
    try:
        shown = main_image(sequence[frame])
    except InputError:
        return row
    if shown is None:
        return row
    return msgspec.structs.replace(row, image=base64.b64encode(jpeg(shown[1], QUALITY, WIDTH_PX)).decode())
