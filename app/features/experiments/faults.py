"""`ispom experiment faults`: known faults on any recording, and what the methods and the doctor make of them.

The folder holds `rows.jsonl`, a line for each case, and `faults.md`, the table. The same folder goes on: cases that it
has are not computed again, and several commands may add to it.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rich.console import Console

import ispom.evaluation.doctor as rules
from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.metrics import path_errors
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.io.whole import write_whole
from ispom.methods import Config, default_methods, method, named_methods, require_sensors
from ispom.simulation.scenario.kinds import KINDS, FaultKind, kind_of_words, with_fault
from ispom.stop import check_stop
from ispom.types import FRAME_KINDS, Status
from ispom.types import Sequence as Recording

from ...engine.options import SourceOptions
from ...engine.outputs import claim_folder
from ...engine.playback import Builder
from ...engine.run_folder.run_folder import locked
from ...engine.signals import terminable
from .fault_table import markdown, merged
from .options import Experiment
from .plan_file import seeds_of

FAULTS, COMMAND = "faults", "experiment faults"
ROWS, TABLE = "rows.jsonl", "faults.md"
FRAMES = 45
"""Frames of the main camera in a stretch, as the doctor examines them."""
NAMES = frozenset({
    "source", "seed", "stretch", "first", "last", "kind", "right", "simulated", "rules", "failure", "causes", "silent",
    "answer", "strengths", "figures", "methods",
})  # fmt: skip
"""What each row has."""
SIGMA = "_sigma"
"""After the name of a figure: its standard deviation."""


@dataclass(frozen=True)
class Case:
    """A fault on a stretch of a recording."""

    source: str
    seed: int
    stretch: str
    """FIRST-LAST, or K/N of N that are even along the recording."""
    name: str
    """Of the kind, with the settings that were given."""
    kind: FaultKind

    @property
    def simulated(self) -> bool:
        return self.source.startswith("sim:")

    @property
    def key(self) -> tuple[Any, ...]:
        return self.source, self.seed, self.stretch, self.name


def faults(options: Experiment, builder: Builder = build) -> int:
    """Computes the cases that are missing, writes rows and table, and prints the table.

    Raises InputError for what is wrong with the options or the folder. A signal ends it; what was computed is written.
    """
    cases = list(cases_of(options))
    claim_folder(options.out, COMMAND)
    with locked(options.out), terminable():
        rows, now = read_rows(options.out / ROWS), rules_hash()
        if any(row["rules"] != now for row in rows):
            raise InputError(f"{options.out} holds rows of other rules of the doctor: give a new --out")
        try:
            _complete(options, cases, rows, builder)
        finally:
            text = markdown(rows, now)
            write_whole(options.out / TABLE, text)
            if options.table is not None:
                write_whole(options.table, merged(options.table, text))
    sys.stdout.write(printable_lines(text))
    return 0


def cases_of(options: Experiment) -> Iterator[Case]:
    """Yields the cases: all faults on one seed and stretch before the next, so that a part of them says much.

    Of sources that are no simulations, the first seed only. Raises InputError where an option is wrong.
    """
    if options.shard or options.merge or options.recordings or options.workers or options.scheduler:
        raise InputError("faults takes none of --shard, --merge, --recordings, --workers and --scheduler: leave it out")
    sources = (*options.more, *options.sources)
    if not sources:
        raise InputError("faults are put onto a recording: give one, as in `ispom experiment faults sim:tiny`")
    seeds = seeds_of("--seeds", options.seeds if options.seeds is not None else "0")
    given = options.fault or tuple(KINDS)
    kinds = {name: kind_of_words(name) for name in given}
    for seed in seeds:
        for source in sources:
            if not source.startswith("sim:") and seed != seeds[0]:
                continue
            for stretch in _stretches(options.stretches):
                yield from (Case(source, seed, stretch, name, kind) for name, kind in kinds.items())


def _stretches(text: str) -> list[str]:
    if re.fullmatch(r"[1-9][0-9]{0,3}", text):
        return [f"{k + 1}/{text}" for k in range(int(text))]
    words = [word.strip() for word in text.split(",")]
    for word in words:
        found = re.fullmatch(r"([0-9]{1,9})-([0-9]{1,9})", word)
        if found is None or int(found[1]) >= int(found[2]):
            raise InputError(f"--stretches is {text[:60]!r}: give frames such as 0-44,105-149, or a number such as 3")
    return words


def _complete(options: Experiment, cases: Sequence[Case], rows: list[dict[str, Any]], builder: Builder) -> None:
    """Adds the rows that are missing, each written as it comes."""
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    kept = {_key(row): row for row in rows}
    done = {key for key, row in kept.items() if options.doctor_only or row["methods"] is not None}
    opened: dict[tuple[str, int], Recording] = {}
    left = [case for case in cases if case.key not in done]
    for number, case in enumerate(left):
        check_stop()
        row = row_of(case, options, opened, builder)
        if row is None:
            if options.fault:
                console.print(printable(f"{case.source}: {case.name} does not suit this recording: left out"))
            continue
        kept[case.key] = row
        rows[:] = kept.values()
        write_whole(options.out / ROWS, "".join(json.dumps(each) + "\n" for each in rows))
        said = row["failure"] or ", ".join(row["causes"][:3]) or "no cause"
        place = f"{case.source} seed {case.seed}, {row['first']}-{row['last']}"
        console.print(printable(f"[{number + 1}/{len(left)}] {case.name}, {place}: {said}"))


def row_of(
    case: Case, options: Experiment, opened: dict[tuple[str, int], Recording], builder: Builder
) -> dict[str, Any] | None:
    """Returns what became of a case; None where the fault does not suit the recording.

    What is wrong with the source raises InputError; what a method or the doctor fails on is in the row.
    """
    address = case.kind.address(case.source, case.seed) if case.simulated else case.source
    key = (address, case.seed)
    if key not in opened:
        if len(opened) > 1:
            opened.clear()
        opened[key] = SourceOptions(seed=case.seed, max_exposures=options.max_exposures).open(address)
    whole = opened[key]
    if not case.kind.applies_to(whole.rig, case.simulated):
        return None
    first, last = _range(whole, case)
    row = {
        "source": case.source, "seed": case.seed, "stretch": case.stretch, "first": first, "last": last,
        "kind": case.name, "right": list(case.kind.suspects), "simulated": case.simulated, "rules": rules_hash(),
        "failure": None, "causes": [], "silent": [], "answer": "", "strengths": {}, "figures": {}, "methods": None,
    }  # fmt: skip
    try:
        sequence = with_fault(whole.part(first, last), case.kind, case.seed)
        seen = examination(sequence, 0, len(sequence) - 1)
        found = diagnose(seen, advance=lambda _: check_stop() is None)
        row |= {
            "causes": [each.suspect.key for each in found.causes],
            "silent": [*found.silent, *(each.suspect.key for each in found.undecided)],
            "answer": found.answer,
            "strengths": {each.suspect.key: round(each.finding.strength, 3) for each in found.ranked},
            "figures": _figures(case.kind, whole, found),
        }
        if not options.doctor_only:
            row["methods"] = methods_of(sequence, options.methods, builder)
    except Exception as error:
        row["failure"] = printable(str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}")
    return row


def _range(whole: Recording, case: Case) -> tuple[int, int]:
    """Returns the first and the last measurement of the stretch."""
    if "-" in case.stretch:
        first, last = map(int, case.stretch.split("-"))
        if first >= len(whole) - 1:
            raise InputError(f"--stretches has {case.stretch}, but {case.source} has {len(whole)} frames: give others")
        return first, min(last, len(whole) - 1)
    main = "video" if whole.rig.video is not None else "stereo"
    own = [i for i, kind in enumerate(whole.kinds) if kind == main]
    if len(own) < 4:
        raise InputError(f"{case.source} has {len(own)} {main} frames, and the doctor needs 4: give a longer one")
    number, count = map(int, case.stretch.split("/"))
    room = max(0, len(own) - FRAMES)
    start = round(room * (number - 1) / max(1, count - 1))
    return own[start], own[min(start + FRAMES, len(own)) - 1]


def _figures(kind: FaultKind, whole: Recording, found: Diagnosis) -> dict[str, dict[str, float | None]]:
    """Returns, of the suspect that is right, each figure with what it should be, and its standard deviation."""
    fault = kind.made(whole.rig)
    if kind.figures is None or fault is None:
        return {}
    for each in found.causes:
        if each.suspect.key in kind.suspects:
            values, figures = each.finding.values, dict[str, dict[str, float | None]]()
            for name, stated in kind.figures(fault).items():
                if name in values:
                    figures[name] = {"said": values[name], "right": stated, "sigma": values.get(name + SIGMA)}
            return figures
    return {}


def methods_of(sequence: Recording, asked: Sequence[str], builder: Builder) -> dict[str, dict[str, Any]]:
    """Returns of each method: frames, those that are located, and its error where there is truth; or its failure."""
    names = named_methods(asked, sequence.rig) or default_methods(sequence.rig)
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        try:
            require_sensors([name], sequence.rig)
            found[name] = _played(sequence, name, builder)
        except InputError as error:
            found[name] = {"frames": 0, "located": 0, "ate_m": None, "failure": printable(str(error))}
    return found


def _played(sequence: Recording, name: str, builder: Builder) -> dict[str, Any]:
    ensemble = builder(Config(), (name,), sequence.rig)
    state, frames, located = ensemble.start(), 0, 0
    for i in range(len(sequence)):
        check_stop()
        state, steps = ensemble.step(state, sequence[i])
        if sequence.kinds[i] in FRAME_KINDS:
            frames += len(steps)
            located += sum(step.status == Status.TRACKING for step in steps)
    ate_m = None
    path = ensemble.finish(state)[name]
    if sequence.truth is not None and located:
        ate_m = path_errors(path, sequence.truth, sequence.rig, method(name).unit == "metric")["ate_m"]
    return {"frames": frames, "located": located, "ate_m": ate_m, "failure": None}


def read_rows(file: Path) -> list[dict[str, Any]]:
    """Returns the rows of a folder, with what is right to say today. Raises InputError where they are damaged."""
    if not exists(file):
        return []
    try:
        rows: list[Any] = [json.loads(line) for line in read_text(file).splitlines()]
    except ValueError:
        rows = [None]
    if not all(isinstance(row, dict) and row.keys() >= NAMES for row in rows):
        raise InputError(f"{file} is damaged: remove it, or give a new --out")
    return [row | {"right": list(kind_of_words(row["kind"]).suspects)} for row in rows]


@cache
def rules_hash() -> str:
    """Returns what names the rules of the doctor: 12 digits of the hash of its files."""
    folder, digest = Path(rules.__path__[0]), hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        digest.update(file.relative_to(folder).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


def printable_lines(text: str) -> str:
    """Returns the text for a terminal."""
    return "\n".join(map(printable, text.splitlines())) + "\n"


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["source"], row["seed"], row["stretch"], row["kind"]
