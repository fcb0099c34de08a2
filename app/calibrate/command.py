"""`ispom calibrate`: images in, a rig out, and in words how good it is."""

from __future__ import annotations

import sys

from rich.console import Console

from ispom.calibration.calibrate import calibrate as solve
from ispom.calibration.calibrate import require_found
from ispom.calibration.detection.hint import hint
from ispom.calibration.result import Calibration, Redo, Views
from ispom.calibration.targets import Target, parse_target
from ispom.errors import InputError, UnreadableImage, printable

from ..outputs import require_own, write_file
from .choose import best_frames, near
from .detecting import bar, detected
from .images import Source, open_sources, own_clock, paired
from .numbers import JSON_HEAD, numbers_text, redo_text
from .options import Calibrate
from .report import GENERATOR, page
from .saved import require_writable, save
from .words import printed

REDO = 1
MOST_WITHIN_S = 120.0
NEAR_S = 0.3
"""Images of the video so much earlier and later than a pair say where the camera was between them."""


def calibrate(options: Calibrate) -> int:
    """Calibrates, prints and writes; InputError where the images or the target are not what they are said to be."""
    target = parse_target(options.target)
    if options.max_views < 3:
        raise InputError(f"--max-views is {options.max_views}: give 3 or more")
    if not 0 <= options.clock_within <= MOST_WITHIN_S:
        raise InputError(f"--clock-within is {options.clock_within:g}: give 0 to {MOST_WITHIN_S:g} seconds")
    _require_outputs(options)
    sources = _chosen(open_sources(options.what, options.images), options)
    views = detected(target, sources)
    for each, source in zip(views, sources, strict=True):
        if all(found.reason for found in each.detections):
            require_found(each, _hint(target, source))
    try:
        found = _solved(target, views, options)
    except Redo as redo:
        sys.stdout.write(printable(f"redo: {redo}") + "\n")
        if options.json is not None:
            write_file(options.json, redo_text(target, views, str(redo)), JSON_HEAD)
        return REDO
    _write(found, options)
    return REDO if found.verdict.level == "redo" else 0


def _solved(target: Target, views: tuple[Views, ...], options: Calibrate) -> Calibration:
    """The pair first: it is the frame of the rig."""
    order = sorted(views, key=lambda each: each.name == "video")
    with Console(file=sys.stderr).status("solving") as status:
        return solve(target, tuple(order), options.model, options.joint, status.update, options.clock_within)


def _chosen(sources: tuple[Source, ...], options: Calibrate) -> tuple[Source, ...]:
    """Images of one number at the same time, not too many; of a video with a clock of its own, all that may be near."""
    if own_clock(sources):
        video, *pair = sources
        left, right = _best(paired(tuple(pair)), options)
        return near(video, left, options.clock_within + NEAR_S), left, right
    return _best(paired(sources), options)


def _best(sources: tuple[Source, ...], options: Calibrate) -> tuple[Source, ...]:
    with bar("choosing frames", None) as step:
        index = best_frames(next(iter(sources)), options.max_views, step)
    return tuple(source.select(index) for source in sources)


def _hint(target: Target, source: Source) -> str:
    """By up to three images."""
    for i in sorted({0, len(source) // 2, len(source) - 1}):
        try:
            if said := hint(target, source.read(i)):
                return said
        except UnreadableImage:
            continue
    return ""


def _require_outputs(options: Calibrate) -> None:
    """A mistake is told before minutes of work."""
    if options.report is not None:
        if options.report.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--report is {options.report}: give a file name that ends in .html")
        require_own(options.report, GENERATOR)
    if options.json is not None:
        require_own(options.json, JSON_HEAD)
    if options.out is not None:
        require_writable(options.out, options.format)


def _write(found: Calibration, options: Calibrate) -> None:
    """What is asked, and the verdict on standard output."""
    written = False
    if options.out is not None and found.verdict.level != "redo":
        save(found, options.out, options.format)
        written = True
    if options.json is not None:
        write_file(options.json, numbers_text(found), JSON_HEAD)
    if options.report is not None:
        write_file(options.report, page(found), GENERATOR)
    sys.stdout.write(printed(found))
    if options.out is not None:
        said = f"written: {options.out}" if written else f"{options.out} is not written: film again"
        sys.stdout.write(printable(said) + "\n")
