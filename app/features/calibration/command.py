"""`ispom calibrate`: images in, a rig out, and in words how good it is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ispom.calibration.calibrate import calibrate as solve
from ispom.calibration.filmed.choose import best_frames, near
from ispom.calibration.filmed.detecting import detected, moving_views, require_target
from ispom.calibration.filmed.images import Source, open_sources, own_clock, paired
from ispom.calibration.filmed.live import camera_frames, filmed, is_camera
from ispom.calibration.filmed.simulated import is_simulated, simulated, truth_words
from ispom.calibration.motion.combine import clock_of, verdict_of
from ispom.calibration.result import Calibration, Redo, Views
from ispom.calibration.targets.layouts import parse_target
from ispom.calibration.targets.target import Target
from ispom.errors import InputError, printable
from ispom.methods import Config
from ispom.stop import check_stop
from ispom.types import Image

from ...engine.outputs import require_own, write_file
from ...engine.signals import Signals, terminable
from ..headless.console import compile_first
from .from_tracks import lens_from_motion, print_lens
from .numbers import JSON_HEAD, failed_text, numbers_text, redo_text
from .options import Calibrate
from .report import GENERATOR, page
from .saved import convert, require_writable, save
from .target import print_target
from .words import printed

REDO = 1
MOST_WITHIN_S = 120.0
NEAR_S = 0.3
"""Images of the video within this time before and after a pair determine the pose of the camera between them."""


def calibrate(options: Calibrate) -> int:
    """Calibrates, prints and writes; Raises InputError where the images or the target are not as stated."""
    if options.what == "convert":
        return convert(options)
    if options.what == "target":
        return print_target(options)
    with terminable() as signals:
        return _calibrate(options, signals)


def _calibrate(options: Calibrate, signals: Signals) -> int:
    if options.from_motion:
        return _from_motion(options)
    if options.target is None:
        raise InputError(
            "--target is missing: say what was filmed, such as chessboard:9x6:0.0242, or give --from-motion"
        )
    target = parse_target(options.target)
    if options.max_views < 3:
        raise InputError(f"--max-views is {options.max_views}: give 3 or more")
    _require_range(options)
    _require_outputs(options)
    made = simulated(options.what, options.images[0], target) if is_simulated(options.images) else None
    sources = made.sources if made is not None else _opened(options, target, signals)
    for note in (note for source in sources for note in source.notes):
        sys.stderr.write(printable(f"note: {note}") + "\n")
    all_sources = sources
    sources = _chosen(all_sources, options)
    views = detected(target, sources, _bar)
    require_target(target, sources, views)
    try:
        found = _solved(target, views, options, moving_views(target, all_sources, sources, _bar))
    except Redo as redo:
        sys.stdout.write(printable(f"redo: {redo}") + "\n")
        if options.json is not None:
            write_file(options.json, redo_text(target, views, str(redo)), JSON_HEAD)
        return REDO
    _write(found, options)
    if made is not None:
        sys.stdout.write("".join(f"{line}\n" for line in truth_words(found, made.truth)))
    return REDO if found.verdict.level == "redo" else 0


def _from_motion(options: Calibrate) -> int:
    """Without a target."""
    from ispom.calibration.motion.recorded import USED, moved_rig, recording_of  # brings the estimators

    from . import motion_report

    if options.what == "stereo":
        raise InputError("--from-motion is for `ispom calibrate video` and `rig`: stereo needs a --target")
    if options.target is not None:
        raise InputError("--target and --from-motion are both given: leave one out")
    _require_range(options)
    _require_outputs(options)
    try:
        if options.what == "video":
            judged, lines = lens_from_motion(options)
            print_lens(judged, lines)
            _print_written(options, judged.level != "redo")
            return REDO if judged.level == "redo" else 0
        sequence = recording_of(options.images)
        compile_first(USED, Config())
        found = moved_rig(sequence, options.images[0], options.clock_within, _bar)
    except Redo as redo:
        sys.stdout.write(printable(f"redo: {redo}") + "\n")
        if options.json is not None:
            write_file(options.json, failed_text(str(redo)), JSON_HEAD)
        return REDO
    verdict = verdict_of(found.rough, found.found)
    if options.json is not None:
        write_file(options.json, motion_report.numbers_text(found, verdict), JSON_HEAD)
    if options.report is not None:
        write_file(options.report, motion_report.page(found, verdict), GENERATOR)
    sys.stdout.write(motion_report.printed(found, verdict))
    if options.out is not None and verdict.level != "redo":
        about = f"{verdict.level}, from the motion in {found.sequence.name}"
        save(found.rig, clock_of(found.found), about, options.out, options.format)
    _print_written(options, verdict.level != "redo")
    return REDO if verdict.level == "redo" else 0


def _print_written(options: Calibrate, written: bool) -> None:
    if options.out is not None:
        message = f"written: {options.out}" if written else f"{options.out} is not written: film again"
        sys.stdout.write(printable(message) + "\n")


def _require_range(options: Calibrate) -> None:
    if not 0 <= options.clock_within <= MOST_WITHIN_S:
        raise InputError(f"--clock-within is {options.clock_within:g}: give 0 to {MOST_WITHIN_S:g} seconds")


def _opened(options: Calibrate, target: Target, signals: Signals) -> tuple[Source, ...]:
    """Images and films, or what is filmed now."""
    if not is_camera(options.images):
        return open_sources(options.what, options.images)
    name = str(options.images[0])
    if options.what != "video":
        raise InputError(f"{name} is one camera: film with it as video, or give the images of all cameras")
    with camera_frames(name) as read, Console(file=sys.stderr).status("filming; Ctrl-C ends it") as status:

        def read_on() -> Image | None:
            if signals.take_interrupt():
                raise KeyboardInterrupt
            check_stop()
            return read()

        def show(advice: str) -> None:
            status.update(f"{advice} (Ctrl-C: enough)")

        return (filmed(target, name, read_on, show, options.max_views),)


def _solved(target: Target, views: tuple[Views, ...], options: Calibrate, around: Views | None) -> Calibration:
    """The pair first: it is the frame of the rig."""
    order = sorted(views, key=lambda each: each.name == "video")
    with Console(file=sys.stderr).status("solving") as status:

        def progress(doing: str) -> None:
            status.update(doing)
            check_stop()

        return solve(target, tuple(order), options.model, options.joint, progress, options.clock_within, around)


def _chosen(sources: tuple[Source, ...], options: Calibrate) -> tuple[Source, ...]:
    """Images of one number at the same time, not too many; of a video with a clock of its own, all that may be near."""
    if own_clock(sources):
        video, *pair = sources
        left, right = _best(paired(tuple(pair)), options)
        return near(video, left, options.clock_within + NEAR_S), left, right
    return _best(paired(sources), options)


def _best(sources: tuple[Source, ...], options: Calibrate) -> tuple[Source, ...]:
    with _bar("choosing frames", None) as step:
        index = best_frames(next(iter(sources)), options.max_views, step)
    return tuple(source.select(index) for source in sources)


def _require_outputs(options: Calibrate) -> None:
    """Raises InputError for a mistake before minutes of work."""
    if options.report is not None:
        if options.report.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--report is {options.report}: give a file name that ends in .html")
        require_own(options.report, GENERATOR)
    if options.json is not None:
        require_own(options.json, JSON_HEAD)
    if options.out is not None:
        require_writable(options.out, options.format)


def _write(found: Calibration, options: Calibrate) -> None:
    """Writes the files of the options, and prints the verdict."""
    written = found.verdict.level != "redo"
    if options.out is not None and written:
        about = f"{found.verdict.level}, reprojection error {found.solution.rms_px:.3f} px"
        save(found.rig, found.clock, about, options.out, options.format)
    if options.json is not None:
        write_file(options.json, numbers_text(found), JSON_HEAD)
    if options.report is not None:
        write_file(options.report, page(found), GENERATOR)
    sys.stdout.write(printed(found))
    _print_written(options, written)


@contextmanager
def _bar(what: str, total: int | None) -> Iterator[Callable[[], None]]:
    """A line on the terminal, and what moves it on by one; where standard error is no terminal there is none.

    What moves it raises what ends the command, as `check_stop`.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(file=sys.stderr)
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as shown:
        task = shown.add_task(what, total=total)

        def advance() -> None:
            shown.advance(task)
            check_stop()

        yield advance
