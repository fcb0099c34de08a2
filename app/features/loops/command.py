"""`ispom loops`: runs, collects the candidates, asks what if, and writes the page and loops.json."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from itertools import chain
from pathlib import Path

import msgspec

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.estimators.modern.trials import collecting_trials
from ispom.io.files import confined, exists
from ispom.io.whole import write_parts
from ispom.methods import chosen_methods, with_dependencies
from ispom.stop import check_stop
from ispom.types import Trajectory

from ...engine.outputs import claim_folder
from ...engine.playback import Builder, Playback
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import RUN
from ...engine.signals import terminable
from ...session.review.stored import stored_source
from ..headless.console import compile_first, progress
from .candidate import METHODS, Candidate, WhatIf
from .docket import Docket
from .options import Loops
from .page import write_page
from .text import lines
from .truth import errors_ate, judged_trial, with_truth
from .what_if import Question, Recent, accepted_in, answer, question_of

PAGE, ALL = "index.html", "loops.json"


@dataclass(frozen=True, eq=False)
class Collected:
    """A run to its end, and its candidates."""

    docket: Docket
    final: Mapping[str, Trajectory]
    recent: Recent


def loops(options: Loops, builder: Builder = build) -> int:
    """Returns 0. Raises InputError where the run cannot be repeated, or for a question about no candidate of it."""
    claim_folder(options.out, "loops")
    with ExitStack() as stack:
        signals = stack.enter_context(terminable())
        playback = opened(options, builder, stack)
        questions = [question_of(text, len(playback.sequence)) for text in options.what_if]
        compile_first(playback.methods, playback.config)
        docket = stack.enter_context(Docket(playback.sequence, options.most))
        total = len(playback.sequence) * (1 + len(questions)) - sum(each.start for each in questions)
        with progress(total) as advance:
            found = collected(playback, docket, questions, advance)
            what_if = tuple(answer(each, playback, found.recent, found.final, advance) for each in questions)
        signals.check()
        units_m = {name: unit for name, (_, unit) in errors_ate(playback, found.final).items()}
        shown = [(judged_trial(one, playback.sequence, units_m), one) for one in docket.shown()]
        name = options.run
        write_page(options.out / PAGE, name, playback.sequence, shown, what_if, docket)
        every = (with_truth(each, playback.sequence, units_m) for each in docket.candidates())
        _write_all(options.out / ALL, name, playback, docket, what_if, every)
        text = lines([each for each, _ in shown], what_if, docket, playback.truth is not None)
    sys.stdout.write("\n".join(map(printable, [*text, str(options.out / PAGE)])) + "\n")
    return 0


def opened(options: Loops, builder: Builder, stack: ExitStack) -> Playback:
    """The run again, or a source; files stay as confined as its run's are, until the stack is closed."""
    folder = Path(options.run).expanduser()
    if exists(folder / RUN):
        if options.methods or options.variant or fields(options.settings):
            raise InputError(f"{options.run} is a run, which has its own methods and settings: make a fork with others")
        run = read_run_file(folder)
        stored = stored_source(folder, run, options.source)
        stack.enter_context(confined(stored.places))
        return Playback(stored.open(), with_dependencies(run.methods), run.configs(), builder, run.earlier)
    if options.source is not None:
        raise InputError(f"{options.run} is no run: give a folder that `ispom run` wrote with --source")
    sequence = options.open(options.run)
    if sequence.grow is not None:
        raise InputError(f"{options.run} is live, and cannot be run again: record it first")
    methods = chosen_methods(options.methods, sequence.rig, options.variant or "modern")
    return Playback(sequence, with_dependencies(methods), options.config, builder)


def collected(playback: Playback, docket: Docket, questions: list[Question], advance: Callable[[], None]) -> Collected:
    """Runs to the end. Each of the questions gets the state before its frames, and its candidate."""
    if not set(playback.methods) & set(METHODS.values()):
        known = " or ".join(METHODS.values())
        raise InputError(f"none of {', '.join(playback.methods)} looks for places seen before: run {known}")
    recent = Recent(min((each.start for each in questions), default=len(playback.sequence)))
    while playback.more():
        check_stop()
        for each in questions:
            if each.start == playback.position:
                each.snapshot = playback.snapshot
        with collecting_trials() as trials:
            event = playback.step()
        some = list(trials.values())
        docket.add(some)
        recent.add(event.index, event.steps, accepted_in(playback, some))
        advance()
    docket.finish()
    final = playback.finish().trajectories
    for each in questions:
        each.found = _asked_about(each, docket)
    return Collected(docket, final, recent)


def _asked_about(question: Question, docket: Docket) -> Candidate | None:
    """The first candidate of a question, among those that are kept."""
    pairs = {f"{first}-{then}" for first, then in question.pairs}
    some = [each for each in docket.candidates() if each.pair in pairs]
    # A loop or a join can be decided otherwise; a relocalisation of the same images cannot.
    return min(some, key=lambda each: (each.kind == "relocalisation", each.then_ns), default=None)


def _write_all(
    path: Path,
    name: str,
    playback: Playback,
    docket: Docket,
    what_if: tuple[WhatIf, ...],
    every: Iterable[Candidate],
) -> None:
    """loops.json, one candidate at a time."""
    head = {
        "source": name,
        "methods": playback.methods,
        "frames": len(playback.sequence),
        "counts": dict(sorted(docket.counts.items())),
        "decided_by": dict(docket.decided_by.most_common()),
        "what_if": what_if,
    }
    rows = (b",\n" * (i > 0) + msgspec.json.encode(each) for i, each in enumerate(every))
    write_parts(path, chain([msgspec.json.encode(head)[:-1] + b',"candidates":[\n'], rows, [b"\n]}\n"]))
