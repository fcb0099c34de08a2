"""The command: searches, writes the clip, runs it once more from its folder, and prints what was tried."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console

from ispom.ensemble import build
from ispom.errors import InputError, counted, printable
from ispom.io.files import confined, exists, expanded, is_folder
from ispom.io.whole import write_whole
from ispom.methods import with_dependencies
from ispom.sequences.recorded_sensors import NONE
from ispom.stop import check_stop
from ispom.types import Sequence

from ...engine.options import SourceOptions
from ...engine.playback import Builder
from ...engine.run_events.event import RunEvent
from ...engine.run_folder.run_file import versions
from ...engine.run_folder.statistics import ImagesDigest
from ...engine.signals import terminable
from ...presentation import colours
from ..headless.console import compile_first
from ..headless.words import run_words
from .cut import cut, frame_times
from .expected import EXPECTED, Event, Expected, Part, read_expected
from .options import Shrink
from .search import Clip, spans
from .subject import Found, Order, Subject, search, subject_of
from .trial import Bench, Outcome
from .write import SENSOR_FILE, has_sensors, require_empty, write_recording, zipped

NOT_AGAIN = 1
"""Exit code where the failure does not happen again."""
COMMAND, README = "command.txt", "README.md"


def shrink(options: Shrink, builder: Builder = build) -> int:
    """Shrinks, or verifies, and returns the exit code. Raises InputError for a mistake of the user."""
    for name, value, least in (("trials", options.trials, 1), ("near", options.near, 0)):
        if value < least:
            raise InputError(f"--{name} is {value}: give {least} or more")
    if options.verify:
        return verify(options, builder)
    archive = options.out.with_name(f"{options.out.name}.zip")
    if options.zip and (exists(archive) or archive.is_symlink()):
        raise InputError(f"{archive} exists: give another --out, or remove it first")
    subject = subject_of(options)
    order = Order(options.near, options.trials, options.private)
    require_empty(options.out)
    compile_first(subject.methods, subject.config)
    with confined(subject.places), terminable():
        with _telling() as (advance, seen):
            found = search(subject, order, builder, advance, seen)
        if found is None:
            how = " with tracks drawn in place of the images, or not at all" if options.private else ""
            _say(f"the failure does not happen again{how}: no clip is written")
            return NOT_AGAIN
        expected = None
        try:
            expected = _written(options, subject, found)
        finally:
            if expected is None:
                _empty(options.out)
    if expected is None:
        _say("the failure does not happen when the written clip is run: it is removed again")
        return NOT_AGAIN
    if options.zip:
        write_whole(archive, zipped(options.out))
    _say(*_summary(options.out, expected))
    return 0


def verify(options: Shrink, builder: Builder = build) -> int:
    """Says whether the expected event happens in a clip."""
    folder = expanded(options.run)
    if not exists(folder) or not is_folder(folder):
        raise InputError(f"{options.run} is no folder: give one that `ispom shrink` wrote")
    expected = read_expected(folder)
    with confined((folder,)), terminable():
        config, sequence = expected.configs(), _opened(folder)
        compile_first(expected.methods, config)
        bench = Bench(sequence, config, builder, expected.failure, check_stop)
        event = bench.found(sequence, expected.methods)
        notes = [] if _digest(sequence) == expected.images_sha256 else ["the images are not those of the clip"]
    others = [f"{name} {was}" for name, was in expected.versions.items() if versions().get(name) != was]
    notes += [f"it happened with {', '.join(others)}"] if others else []
    _say(*(f"note: {note}" for note in notes))
    if event is None:
        _say(f"not there: {_of_event(expected.event)}")
        return NOT_AGAIN
    _say(f"there: frame {event.frame}: {_named(event.method)}{event.sentence}")
    return 0


def _written(options: Shrink, subject: Subject, found: Found) -> Expected | None:
    """Writes the clip; None where its event does not happen in what is written."""
    bench, clip = found.bench, found.shrunk.clip
    write_recording(options.out, cut(bench.whole, clip))
    sequence = _opened(options.out)
    event = bench.found(sequence, clip.methods)
    if event is None:
        return None
    expected = _expected(options, subject, found, event, _digest(sequence))
    words = run_words(".", expected.methods, expected.config, expected.external)
    words += ["--sensors", SENSOR_FILE] if has_sensors(options.out) else []
    write_whole(options.out / COMMAND, f"{shlex.join(words)}\n")
    write_whole(options.out / README, _readme(expected, shlex.join(words)))
    write_whole(options.out / EXPECTED, expected.text)
    return expected


def _empty(folder: Path) -> None:
    """Removes what was written to a folder that was empty."""
    for left in folder.iterdir():
        shutil.rmtree(left) if left.is_dir() else left.unlink()


def _expected(options: Shrink, subject: Subject, found: Found, event: RunEvent, digest: str) -> Expected:
    clip, failure = found.shrunk.clip, found.bench.failure
    happened = Event(
        event.kind, event.method, event.cause, str(event.severity), event.sentence, event.frame, event.time_ns,
        int(np.searchsorted(frame_times(subject.sequence), event.time_ns)), found.recorded_frame, failure.from_ns,
        failure.until_ns,
    )  # fmt: skip
    part = Part(clip.frames, found.whole.count, clip.halvings, clip.cameras)
    config = {name: asdict(subject.config.of(name)) for name in with_dependencies(clip.methods)}
    return Expected(
        happened, part, clip.methods, config, subject.external, "" if options.private else subject.sequence.name,
        options.private, len(found.shrunk.trials), found.shrunk.complete, digest, versions(),
    )  # fmt: skip


def _opened(folder: Path) -> Sequence:
    """A clip, with the other sensors that it names."""
    return SourceOptions(sensors=folder / SENSOR_FILE if has_sensors(folder) else NONE).opened(str(folder))


def _digest(sequence: Sequence) -> str:
    found = ImagesDigest()
    for i in range(len(sequence)):
        check_stop()
        found.add(sequence.load(i))
    return found.hexdigest()


@contextmanager
def _telling() -> Iterator[tuple[Callable[[], None], Callable[[Clip, Outcome], None]]]:
    """Gives what is called at each frame, and what prints each trial as soon as it is over."""
    console, count = Console(stderr=True), 0
    with console.status("running the whole recording") as status:

        def seen(clip: Clip, outcome: Outcome) -> None:
            nonlocal count
            count += 1
            _say(f"{count:4d}  {outcome:8}  {clip.words()}")
            if console.is_terminal:
                status.update(f"after trial {count}")

        yield check_stop, seen


def _say(*lines: str) -> None:
    for line in lines:
        sys.stdout.write(f"{printable(line)}\n")
    sys.stdout.flush()


def _named(method: str) -> str:
    return f"{colours.label(method)}: " if method else ""


def _of_event(event: Event) -> str:
    cause = f" by the check {event.cause}" if event.cause else ""
    return f"{event.kind} of {event.method or 'the recording'}{cause}, at frame {event.frame}"


def _summary(folder: Path, expected: Expected) -> Iterator[str]:
    event, part = expected.event, expected.part
    yield f"{_named(event.method)}{event.sentence}"
    size = "" if part.halvings == 0 else f", images of 1/{2**part.halvings} of their width"
    yield f"{len(part.frames)} of {counted(part.of_frames, 'frame')} ({spans(part.frames)}){size}"
    if expected.complete:
        yield "without any single frame, method or camera, or with smaller images, the event is gone"
    else:
        yield f"all {expected.trials} trials are used up: more --trials may find a smaller clip"
    yield f"in {folder}: `ispom shrink --verify {shlex.quote(str(folder))}` says whether it happens"


def _readme(expected: Expected, command: str) -> str:
    event, part = expected.event, expected.part
    images = "tracked points, drawn in place of the images" if expected.private else "the pixels of the recording"
    if part.halvings:
        images += f", at 1/{2**part.halvings} of their width and height"
    cameras = " and ".join(part.cameras)
    whole = f" of {expected.recording}" if expected.recording else ""
    lines = [
        "# A failure in a small clip",
        "",
        f"Expected: {printable(event.sentence)}",
        "",
        f"- event: {_of_event(event)} of this clip ({event.time_ns / 1e9:.9f} s), frame {event.recorded_frame} of the "
        "recording",
        f"- clip: {len(part.frames)} of {part.of_frames} frames ({cameras}){printable(whole)}",
        f"- images: PNG, {images}; times in seconds in `*.txt`, calibration in `rig.yaml`",
        "",
        "```sh",
        "ispom shrink --verify .",
        "```",
        "",
        f"The exit code is 0 where the event happens, 1 where it does not. The run itself: `{printable(command)}`",
        "",
        f"`{EXPECTED}` has all figures, settings and versions.",
        "",
    ]
    return "\n".join(lines)
