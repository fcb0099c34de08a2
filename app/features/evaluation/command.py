"""`ispom evaluate`: compares estimates with a reference, in numbers that come with their protocol."""

from __future__ import annotations

from importlib.util import find_spec

from ispom.errors import InputError
from ispom.evaluation.comparison import Comparison, compare
from ispom.evaluation.trajectory_error import MIN_POSES, associate
from ispom.io.kitti import read_times
from ispom.io.poses.dialect import TrajectoryFile
from ispom.io.poses.recognised import read_trajectory

from ...engine.outputs import require_own, write_file
from .evaluated import Evaluated, distinct_names, pairs_by_name, protocol_of, repeated_note
from .options import Evaluate
from .output import CSV_HEAD, JSON_HEAD, csv_text, json_text, print_table

MAX_DIFFERENCE_S = 3600.0
"""Poses whose times differ by more than this are never of the same moment."""


def evaluate(options: Evaluate) -> int:
    """Compares, prints and writes the numbers. Raises InputError where that is not possible."""
    if options.plots is not None and find_spec("matplotlib") is None:
        raise InputError("--plots needs Matplotlib, which is not installed: run pip install 'ispom[plots]'")
    if not options.estimates:
        raise InputError("no estimate was given: name at least one trajectory file after the reference")
    if options.delta < 1 or not 0 <= options.max_difference_s <= MAX_DIFFERENCE_S:
        raise InputError(
            f"--delta must be at least 1 and --max-difference-s from 0 to {MAX_DIFFERENCE_S:g}: give other values"
        )
    for path, head in ((options.json, JSON_HEAD), (options.csv, CSV_HEAD)):
        if path is not None:
            require_own(path, head)
    times_ns = read_times(options.times) if options.times else None
    reference = read_trajectory(options.reference, times_ns)
    files = [read_trajectory(path, times_ns) for path in options.estimates]
    names = distinct_names([file.path for file in files])
    items = [Evaluated(n, f, _compare(f, reference, options), reference) for n, f in zip(names, files, strict=True)]
    protocol = protocol_of(reference, files, options)
    notes = [*reference.notes, *(note for file in files for note in file.notes)]
    notes += repeated_note(str(options.reference), reference)
    notes += [note for item in items for note in item.notes(options.alignment)]
    print_table(protocol, items, notes)
    if options.json is not None:
        write_file(options.json, json_text(reference, protocol, items, notes), JSON_HEAD)
    if options.csv is not None:
        write_file(options.csv, csv_text(protocol, items), CSV_HEAD)
    if options.plots is not None:
        from .plots import write_plots  # brings matplotlib

        write_plots(options.plots, options.plot_format, items, f"alignment {options.alignment}", reference.timed)
    return 0


def _compare(file: TrajectoryFile, reference: TrajectoryFile, options: Evaluate) -> Comparison:
    own, other = file.trajectory, reference.trajectory
    if file.timed != reference.timed:
        raise InputError(
            f"of {file.path} and {reference.path} only one has times: give those of the other one's rows by --times"
        )
    if file.timed:
        pairs = associate(own, other, round(options.max_difference_s * 1e9))
    elif (by_name := pairs_by_name(file, reference)) is not None:
        pairs = by_name
    elif len(own) == len(other):
        pairs = own, other
    elif file.numbered and reference.numbered:
        pairs = associate(own, other, 0)
    else:
        raise InputError(
            f"{file.path} has {len(own)} rows, {reference.path} {len(other)}, and files without times are compared row "
            "by row: give files of the same length, or TUM files"
        )
    if len(pairs[0]) < MIN_POSES:
        raise InputError(
            f"{file.path} has {len(pairs[0])} poses within {options.max_difference_s:g} s of one of {reference.path}, "
            f"fewer than {MIN_POSES}: give files of the same recording, or a larger --max-difference-s"
        )
    return compare(own, other, pairs, options.alignment, options.delta)
