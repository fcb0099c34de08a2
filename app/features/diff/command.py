"""`ispom diff`: the first exposure at which two runs differ, and in what."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from ispom.errors import InputError, printable
from ispom.io.files import exists
from ispom.types import Frame

from ...engine.differences.compare import Divergence, divergences
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import MARKER
from .final import final_divergences
from .folder import run_rows
from .options import Diff
from .settings import Setting, differing
from .text import lines, shown

APART = 1
"""The exit code where the runs differ; 0 where they do not."""


def diff(options: Diff) -> int:
    """Compares, prints, and gives the exit code; InputError where a folder holds no run, or they share no method."""
    if not 0 <= options.tolerance < math.inf:
        raise InputError(f"--tolerance is {options.tolerance}: give 0 or a positive number")
    if options.count < 1:
        raise InputError(f"--count is {options.count}: give 1 or more")
    a, b = options.run_a.expanduser(), options.run_b.expanduser()
    runs = read_run_file(a), read_run_file(b)
    methods = tuple(method for method in runs[0].config if method in runs[1].config)
    if not methods:
        raise InputError(f"{a} and {b} have no method in common: give runs of the same methods")
    settings = differing(*runs, methods)
    apart, seen, first = 0, frozenset[str](), list[Divergence]()
    for divergence in _found(a, b, methods, (runs[0].frame, runs[1].frame), options.tolerance):
        apart += divergence.exposure is not None
        news, seen = divergence.without(seen), seen | divergence.names
        if news is not None and (len(first) < options.count or news.exposure is None):
            first.append(news)
    if options.json:
        report = {"alike": not first, "runs": [str(a), str(b)], "methods": methods, "tolerance": options.tolerance}
        report |= {"settings": [asdict(s) for s in settings], "apart": apart, "first": [asdict(d) for d in first]}
        sys.stdout.write(json.dumps(report, indent=2) + "\n")
    else:
        text = [*_notes(a, b, settings), *_text(first, apart, methods)]
        sys.stdout.write("".join(f"{printable(line)}\n" for line in text))
    return APART if first else 0


def _found(
    a: Path, b: Path, methods: tuple[str, ...], frames: tuple[Frame, Frame], tolerance: float
) -> Iterator[Divergence]:
    with run_rows(a) as left, run_rows(b) as right:
        yield from divergences(left, right, methods, tolerance)
    if frames[0] == frames[1]:
        yield from final_divergences(a, b, methods, frames[0], tolerance)


def _notes(a: Path, b: Path, settings: list[Setting]) -> Iterator[str]:
    for folder in (a, b):
        if exists(folder / MARKER):
            yield f"{folder} is not complete: what there is of it is compared"
    yield from (f"setting {s.name}: {shown(s.a)} | {shown(s.b)}" for s in settings)


def _text(first: list[Divergence], apart: int, methods: tuple[str, ...]) -> Iterator[str]:
    for divergence in first:
        yield from lines(divergence)
    of = ", ".join(methods)
    yield f"apart at {apart} exposures: {of}" if first else f"alike: {of}"
