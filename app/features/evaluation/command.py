"""`ispom evaluate`: compares estimates with a reference, in numbers that come with their protocol."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import combinations

import numpy as np

from ispom.errors import InputError
from ispom.evaluation.audit.auditor import Question, audit
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.finding import Finding
from ispom.evaluation.comparison import Comparison, compare
from ispom.evaluation.trajectory_error import MIN_POSES, associate
from ispom.io.kitti import read_times
from ispom.io.poses.dialect import TrajectoryFile
from ispom.io.poses.recognised import read_trajectory
from ispom.types import Trajectory

from ...engine.outputs import json_of, require_own, write_file
from .audit import Audit, odd_one
from .evaluated import (
    Evaluated,
    Evaluation,
    Pairs,
    constant_rotation,
    distinct_names,
    pairs_by_name,
    protocol_of,
    repeated_note,
)
from .options import Evaluate
from .output import CSV_HEAD, JSON_HEAD, LATEX_HEAD, csv_text, latex_text, print_table
from .values import delta_of, spans_of
from .written import written

MAX_DIFFERENCE_S = 3600.0
"""Poses whose times differ by more than this are never of the same moment."""
MOST_PAIRED = 6
"""Largest number of trajectories of which all pairs are audited, which takes a second or more for each pair."""


def evaluate(options: Evaluate) -> int:
    """Compares, prints and writes the numbers. Raises InputError where that is not possible."""
    _check(options)
    found = evaluation(options)
    protocol, items = found.protocol, found.items
    print_table(protocol, items, found.notes)
    if options.json is not None:
        write_file(options.json, json_of(written(found)), JSON_HEAD)
    if options.csv is not None:
        write_file(options.csv, csv_text(protocol, items), CSV_HEAD)
    if options.latex is not None:
        write_file(options.latex, latex_text(protocol, items), LATEX_HEAD)
    if options.plots is not None:
        from .plots import PlotStyle, write_plots  # brings matplotlib

        alignment = f"alignment {options.alignment}"
        style = PlotStyle(options.plot_format, alignment, found.reference.timed, options.runs, options.colour_by)
        write_plots(options.plots, items, style)
    return 0


def evaluation(options: Evaluate) -> Evaluation:
    """Compares and audits. Raises InputError for a mistake in the options or the files, and for too few poses."""
    _check_values(options)
    times_ns = read_times(options.times) if options.times else None
    given = _given(options)
    reference = _of_reference(read_trajectory(options.reference, times_ns), given, options)
    read = [read_trajectory(path, times_ns) for path in options.estimates]
    names = distinct_names([file.path for file in read])
    files = [_of_estimate(file, given, options) for file in read]
    items, audits = list[Evaluated](), list[Audit]()
    for name, file in zip(names, files, strict=True):
        compared = Compared(file, reference, options)
        findings = tuple(audit(compared.question)) if options.audit or options.body == "auto" else ()
        audits.append(Audit(name, findings, given, options.alignment, reference.timed))
        found, note = compared.with_body(findings) if options.body == "auto" else (compared, "")
        items.append(Evaluated(name, found.file, found.comparison(audits[-1]), reference, note))
        if note:  # what is left once the body is the same
            audits[-1] = replace(audits[-1], findings=tuple(audit(found.question)) if options.audit else ())
    notes = [*reference.notes, *(note for file in files for note in file.notes)]
    notes += repeated_note(str(options.reference), reference)
    notes += [note for item in items for note in item.notes(options.alignment)]
    if options.audit:
        notes += [sentence for each in audits for sentence in each.sentences]
        notes += _odd_one(reference, files, [str(options.reference), *names], audits, options)
    protocol = protocol_of(reference, files, options)
    return Evaluation(reference, protocol, items, notes, audits if options.audit else None)


def _check(options: Evaluate) -> None:
    """Before anything is read: the plots' library, and what is in the place of the outputs."""
    if options.plots is not None and find_spec("matplotlib") is None:
        raise InputError("--plots needs Matplotlib, which is not installed: run pip install 'ispom[plots]'")
    if options.colour_by is not None and options.plots is None:
        raise InputError("--colour-by colours a plot: give --plots with a folder, too")
    _check_values(options)
    for path, head in ((options.json, JSON_HEAD), (options.csv, CSV_HEAD), (options.latex, LATEX_HEAD)):
        if path is not None:
            require_own(path, head)


def _check_values(options: Evaluate) -> None:
    if not options.estimates:
        raise InputError("no estimate was given: name at least one trajectory file after the reference")
    if not 0 <= options.max_difference_s <= MAX_DIFFERENCE_S:
        raise InputError(f"--max-difference-s must be from 0 to {MAX_DIFFERENCE_S:g}: give another value")
    if options.align_first is not None and options.align_first < 1:
        raise InputError("--align-first must be at least 1: give a number of poses")
    if not (np.isfinite(options.offset) and abs(options.offset) <= 1e12):
        raise InputError(f"--offset is {options.offset:g}: give seconds that are a number")
    if not 1e-10 <= options.clock_rate <= 1e10:
        raise InputError(f"--clock-rate is {options.clock_rate:g}: give a positive factor, such as 1.00002 or 0.001")
    delta_of(options.delta)
    spans_of(options.exclude)


def _given(options: Evaluate) -> Correction:
    return Correction(
        options.conventions,
        options.reference_conventions,
        None,
        options.clock_rate,
        options.offset,
        excluded_s=spans_of(options.exclude),
    )


def _of_estimate(file: TrajectoryFile, given: Correction, options: Evaluate) -> TrajectoryFile:
    has_rotations = file.has_rotations and not options.positions_only
    return replace(file, trajectory=given.of_estimate(file.trajectory), has_rotations=has_rotations)


def _of_reference(file: TrajectoryFile, given: Correction, options: Evaluate) -> TrajectoryFile:
    has_rotations = file.has_rotations and not options.positions_only
    moved = replace(file, trajectory=given.of_reference(file.trajectory), has_rotations=has_rotations)
    if not len(moved.trajectory):
        raise InputError(f"--exclude leaves no pose of {file.path}: give shorter stretches")
    return moved


@dataclass(frozen=True, eq=False)
class Compared:
    """One estimate and the reference, as the options correct them."""

    file: TrajectoryFile
    reference: TrajectoryFile
    options: Evaluate

    @property
    def _by_name(self) -> Pairs | None:
        return None if self.file.timed else pairs_by_name(self.file, self.reference)

    @property
    def question(self) -> Question:
        file, reference, by_name = self.file, self.reference, self._by_name
        if file.timed != reference.timed:
            raise InputError(
                f"of {file.path} and {reference.path} only one has times: give those of the other one's rows by --times"
            )

        def pairs(own: Trajectory, other: Trajectory, max_difference_s: float | None) -> Pairs:
            if by_name is not None:
                changed = replace(file, trajectory=own), replace(reference, trajectory=other)
                return pairs_by_name(*changed) or by_name
            most = self.options.max_difference_s if max_difference_s is None else max_difference_s
            return associate(own, other, round(most * 1e9) if file.timed else 0)

        both = (file.trajectory, reference.trajectory)
        turns = [
            f.has_rotations and not constant_rotation(a, b) for f, a, b in ((file, *both), (reference, *both[::-1]))
        ]
        return Question(
            *both,
            pairs,
            self.options.alignment,
            file.timed,
            by_name is not None,
            (turns[0], turns[1]),
            delta_of(self.options.delta),
            self.options.align_first,
        )

    def with_body(self, findings: tuple[Finding, ...]) -> tuple[Compared, str]:
        """Returns it for the estimate's poses moved to the reference's body, and a sentence about that."""
        body = findings[-1].correction.body if findings else None
        if body is None:
            return self, ""
        moved = replace(self.file, trajectory=self.file.trajectory.moved(right=body))
        arm, turn = (", ".join(f"{x:.4f}" for x in values) for values in (body.translation, body.xyzw))
        note = f"moved to the reference's body, which is at ({arm}) with the quaternion x, y, z, w ({turn})"
        return replace(self, file=moved), note

    def comparison(self, found: Audit) -> Comparison:
        """Raises InputError with too few pairs of poses, with what the audit found."""
        own, other = self.file.trajectory, self.reference.trajectory
        pairs = self._pairs(found)
        if len(pairs[0]) < MIN_POSES:
            raise InputError(
                f"{self.file.path} has {len(pairs[0])} poses within {self.options.max_difference_s:g} s of one of "
                f"{self.reference.path}, fewer than {MIN_POSES}: {_advice(found)}"
                "give files of the same recording, or a larger --max-difference-s"
            )
        options = self.options
        return compare(own, other, pairs, options.alignment, delta_of(options.delta), options.align_first)

    def _pairs(self, found: Audit) -> Pairs:
        file, reference, question = self.file, self.reference, self.question
        own, other = file.trajectory, reference.trajectory
        numbered = file.numbered and reference.numbered
        if file.timed or question.paired or numbered or self.options.offset or self.options.exclude:
            return question.associated(own, other, None)
        if len(own) == len(other):
            return own, other
        raise InputError(
            f"{file.path} has {len(own)} rows, {reference.path} {len(other)}, and files without times are compared row "
            f"by row: {_advice(found)}give files of the same length, or TUM files"
        )


def _advice(found: Audit) -> str:
    return f"the audit suggests that {found.sentence(found.findings[0])}; else " if found.findings else ""


def _odd_one(
    reference: TrajectoryFile, files: list[TrajectoryFile], names: list[str], audits: list[Audit], options: Evaluate
) -> list[str]:
    """Which of at least three trajectories disagrees with all others."""
    wrong = any(each.findings for each in audits)
    if not wrong or not 2 <= len(files) < MOST_PAIRED:
        return []
    found = {(0, i): each.findings for i, each in enumerate(audits, 1)}
    for i, j in combinations(range(len(files)), 2):
        found[i + 1, j + 1] = tuple(audit(Compared(files[j], files[i], options).question))
    sentence = odd_one(names, found)
    return [sentence] if sentence else []
