"""`ispom grade`: runs, points, and what to look at."""

from __future__ import annotations

import hashlib
import secrets
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from ispom.errors import InputError, printable
from ispom.io.files import exists, expanded, is_folder
from ispom.sequences.address import MAX_SEED

from ...engine.outputs import json_text, require_own, write_file
from ...engine.signals import terminable
from .measure import Measured, measured
from .options import Grade
from .points import LABELS, Result, Stage, graded, total
from .process import Failure, Limits, SubmissionProcess, hidden_memory

JSON_HEAD = '"graded_by"'
"""How the JSON begins: by this it is known as ours."""
MOST_RUNS = 100
MOST_SECONDS, MOST_GB = 86400, 4096
FROM_INPUT = "-"
MOST_LETTERS = 1000
"""Most letters of a key."""


def grade(options: Grade) -> int:
    """Prints the points of each method. Raises InputError for wrong options, and where the package has no method."""
    if not 1 <= options.runs <= MOST_RUNS:
        raise InputError(f"--runs is {options.runs}, give a value from 1 to {MOST_RUNS}")
    if not options.source.startswith("sim:") or "#" in options.source:
        raise InputError(f"--source is {options.source[:40]!r}: give a simulation without a seed, such as sim:tiny")
    if options.json is not None:
        require_own(options.json, JSON_HEAD)
    if not 1 <= options.seconds <= MOST_SECONDS:
        raise InputError(f"--seconds is {options.seconds:g}, give a value from 1 to {MOST_SECONDS}")
    if not 0.5 <= options.memory_gb <= MOST_GB:
        raise InputError(f"--memory-gb is {options.memory_gb:g}, give a value from 0.5 to {MOST_GB}")
    limits, folder = Limits(options.seconds, options.memory_gb), expanded(options.package)
    package = str(folder.resolve()) if exists(folder) and is_folder(folder) else options.package
    key = _key(options.key)
    report: dict[str, Any] = {
        "graded_by": "ispom grade",
        "package": options.package,
        "source": options.source,
        "methods": {},
    }
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    with terminable() as signals, hidden_memory():
        for name in _methods(package, options.methods, limits):
            broken = _broken_contract(package, name, limits) if options.contract else None
            runs = []
            for seed in seeds(key, options.runs):
                console.print(f"{name}: run {len(runs) + 1} of {options.runs}")
                runs.append(measured(package, name, options.source, seed, options.max_exposures, limits))
                signals.check()
            stages = graded(runs)
            _print_grade(name, options.source, runs, stages, options.contract, broken)
            report["methods"][name] = _entry(runs, stages, broken)
    if options.key is None:
        _print(f"--key {key} repeats this grade")
    if options.json is not None:
        write_file(options.json, json_text(report, 1), JSON_HEAD)
    return 0


def seeds(key: str, count: int) -> list[int]:
    """Returns seeds that nobody guesses who does not know the key."""
    digests = [hashlib.sha256(f"{key}/{i}".encode()).digest() for i in range(count)]
    return [int.from_bytes(digest[:8], "big") % (MAX_SEED + 1) for digest in digests]


def _key(given: str | None) -> str:
    if given != FROM_INPUT:
        return given or secrets.token_hex(4)
    key = sys.stdin.readline(MOST_LETTERS).strip()
    if not key:
        raise InputError("--key - found no word on standard input: give one line with the key there")
    return key


def _methods(package: str, chosen: tuple[str, ...], limits: Limits) -> tuple[str, ...]:
    """Returns the names of a package's methods. Raises InputError where there are none, or loading fails."""
    try:
        with SubmissionProcess(package, chosen, limits) as submission:
            return tuple(submission.methods)
    except Failure as fault:
        raise InputError(f"{package} cannot be loaded: it {fault}") from None


def _broken_contract(package: str, name: str, limits: Limits) -> str | None:
    """Returns the first violation as a sentence; None where there is none."""
    try:
        with SubmissionProcess(package, (name,), limits) as submission:
            return submission.broken_contract(name)
    except Failure as fault:
        return f"it {fault}"


def _print_grade(
    name: str,
    source: str,
    runs: Sequence[Measured],
    stages: Sequence[tuple[Stage, list[Result]]],
    contract: bool,
    broken: str | None,
) -> None:
    _print(f"\n{name}: {total(stages):.0f} of {_most(stages)} points")
    if contract:
        _print("contract: kept" if broken is None else f"contract: broken: {broken}")
    for run in runs:
        if run.failure is not None:
            _print(f"seed {run.seed}: no points: {run.failure}")
        for value, least in run.too_good.items():
            _print(
                f"seed {run.seed}: TOO GOOD: {LABELS[value]} is {run.values[value]:.2g}, and the noise of the images "
                f"allows {least:.2g}: read the code"
            )
    for stage, results in stages:
        earned, most = sum(r.points for r in results), sum(r.part.points for r in results)
        _print(f"{stage.name:<14} {earned:5.1f} of {most}")
        for result in results:
            value = "none" if result.value is None else f"{result.value:.3g} {result.part.unit}".rstrip()
            limits = f"{result.part.full:g} earns all, {result.part.zero:g} nothing"
            _print(f"    {result.part.label}: {value} ({limits}): {result.points:.1f} of {result.part.points}")
            if result.points < 0.9 * result.part.points:
                _print(f"        {result.part.look}")
                if result.worst is not None:
                    seed, frame = result.worst
                    _print(f"        Worst at frame {frame}: ispom app '{source}#{seed}' --methods {name}")


def _most(stages: Sequence[tuple[Stage, list[Result]]]) -> int:
    return sum(result.part.points for _, results in stages for result in results)


def _entry(
    runs: Sequence[Measured], stages: Sequence[tuple[Stage, list[Result]]], broken: str | None
) -> dict[str, Any]:
    return {
        "points": round(total(stages), 2),
        "stages": {stage.name: round(sum(r.points for r in results), 2) for stage, results in stages},
        "values": {r.part.key: r.value for _, results in stages for r in results},
        "contract": broken,
        "runs": [{"seed": run.seed, "values": dict(run.values), "failure": run.failure} for run in runs],
        "too_good": [{"seed": run.seed, "least": dict(run.too_good)} for run in runs if run.too_good],
    }


def _print(line: str) -> None:
    sys.stdout.write("\n".join(map(printable, line.split("\n"))) + "\n")
