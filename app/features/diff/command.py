"""`ispom diff`: the first frame at which two runs differ, and in what."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ispom.errors import InputError, printable
from ispom.io.files import exists
from ispom.io.trajectories import read_tum
from ispom.types import FrameName, Trajectory

from ...engine.differences.compare import (
    ORIENTATION,
    Difference,
    Divergence,
    MethodRow,
    distance,
    divergences,
    further,
    in_order,
    stored_pose,
)
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import MARKER, trajectory_file
from ...engine.run_folder.step_reader import StoredStep, stored_steps
from .options import Diff
from .text import lines, shown

WRITTEN = ("recording", "methods")
"""Options that say what is written, not what is computed."""


@dataclass(frozen=True)
class Setting:
    """One that is not the same; None where a run has none of this name."""

    name: str
    a: Any
    b: Any


def differing(a: RunFile, b: RunFile, methods: tuple[str, ...]) -> list[Setting]:
    """Source, options, images, settings of these methods, and versions."""
    left, right = _flat(a, methods), _flat(b, methods)
    pairs = ((name, left.get(name), right.get(name)) for name in dict.fromkeys((*left, *right)))
    return [Setting(name, x, y) for name, x, y in pairs if x != y]


def _flat(run: RunFile, methods: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {"source": run.source, "sequence": run.sequence}
    found |= {name: value for name, value in run.options.items() if name not in WRITTEN}
    found["images_sha256"] = run.images_sha256
    for method in methods:
        found |= dict(_leaves(method, run.config.get(method)))
    return {**found, **machine_of(run)}


def machine_of(run: RunFile) -> dict[str, Any]:
    """Returns versions, platform and processor of a run, by the names under which they are compared."""
    return {**dict(_leaves("versions", run.versions)), "platform": run.platform, "processor": run.processor}


def _leaves(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        yield prefix, value
        return
    for name, inner in value.items():
        yield from _leaves(f"{prefix}.{name}", inner)


def final_divergences(
    a: Path, b: Path, methods: tuple[str, ...], frame: FrameName, tolerance: float
) -> Iterator[Divergence]:
    """Of each method whose final trajectories differ: the first pose that does. InputError where one is unreadable."""
    for method in methods:
        name = trajectory_file(method)
        if exists(a / name) and exists(b / name):
            poses = read_tum(a / name, frame), read_tum(b / name, frame)
            yield from _first(method, *poses, tolerance)


def _first(method: str, a: Trajectory, b: Trajectory, tolerance: float) -> Iterator[Divergence]:
    for i in range(min(len(a), len(b))):
        time_ns = int(a.times_ns[i])
        pairs = {
            "final_time_s": (time_ns / 1e9, int(b.times_ns[i]) / 1e9),
            "final_position": (tuple(a.translations[i].tolist()), tuple(b.translations[i].tolist())),
            f"final_{ORIENTATION}": (tuple(a.pose(i).xyzw.tolist()), tuple(b.pose(i).xyzw.tolist())),
        }
        found = [Difference(f"{method}.{k}", x, y, distance(k, x, y)) for k, (x, y) in pairs.items() if x != y]
        found = [difference for difference in found if further(difference, tolerance)]
        if found:
            yield Divergence(None, time_ns, tuple(found))
            return
    if len(a) != len(b):
        longer = a if len(a) > len(b) else b
        counts = Difference(f"{method}.final_poses", len(a), len(b), abs(len(a) - len(b)))
        yield Divergence(None, int(longer.times_ns[min(len(a), len(b))]), (counts,))


@contextmanager
def run_rows(folder: Path) -> Iterator[Iterator[MethodRow]]:
    """Of a run's folder, in order; InputError, also while they are read, where there are none, or not as written."""
    with stored_steps(folder) as steps:
        yield map(_row, steps)


def _row(step: StoredStep) -> MethodRow:
    values = in_order(step.values, step.decisions, stored_pose(step.values))
    return MethodRow(step.exposure, step.time_ns, step.method, values)


EXIT_DIFFERENT = 1
"""The exit code where the runs differ; 0 where they do not."""


@dataclass(frozen=True)
class Compared:
    """How two runs differ."""

    a: Path
    b: Path
    methods: tuple[str, ...]
    """That both have."""
    tolerance: float
    settings: list[Setting]
    """Those that are not the same."""
    differing_frames: int
    first: list[Divergence]
    """Each with what had not differed before."""

    @property
    def report(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "alike": not self.first,
            "runs": [str(self.a), str(self.b)],
            "methods": self.methods,
            "tolerance": self.tolerance,
            "settings": [asdict(s) for s in self.settings],
            "apart": self.differing_frames,
            "first": [asdict(d) for d in self.first],
        }


def compared(a: Path, b: Path, tolerance: float = 0.0, count: int = 3) -> Compared:
    """Compares the runs of two folders; `count` as the option. InputError where a folder holds no run, or they share no
    method."""
    runs = read_run_file(a), read_run_file(b)
    methods = tuple(method for method in runs[0].config if method in runs[1].config)
    if not methods:
        raise InputError(f"{a} and {b} have no method in common: give runs of the same methods")
    settings = differing(*runs, methods)
    differing_frames, seen, first = 0, frozenset[str](), list[Divergence]()
    for divergence in _found(a, b, methods, (runs[0].frame, runs[1].frame), tolerance):
        differing_frames += divergence.exposure is not None
        news, seen = divergence.without(seen), seen | divergence.names
        if news is not None and (len(first) < count or news.exposure is None):
            first.append(news)
    return Compared(a, b, methods, tolerance, settings, differing_frames, first)


def diff(options: Diff) -> int:
    """Compares, prints, and gives the exit code; InputError as `compared`, and for impossible options."""
    if not 0 <= options.tolerance < math.inf:
        raise InputError(f"--tolerance is {options.tolerance}: give 0 or a positive number")
    if options.count < 1:
        raise InputError(f"--count is {options.count}: give 1 or more")
    found = compared(options.run_a.expanduser(), options.run_b.expanduser(), options.tolerance, options.count)
    if options.json:
        sys.stdout.write(json.dumps(found.report, indent=2) + "\n")
    else:
        notes = _notes(found.a, found.b, found.settings)
        text = [*notes, *_text(found.first, found.differing_frames, found.methods)]
        sys.stdout.write("".join(f"{printable(line)}\n" for line in text))
    return EXIT_DIFFERENT if found.first else 0


def _found(
    a: Path, b: Path, methods: tuple[str, ...], frames: tuple[FrameName, FrameName], tolerance: float
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


def _text(first: list[Divergence], differing_frames: int, methods: tuple[str, ...]) -> Iterator[str]:
    for divergence in first:
        yield from lines(divergence)
    of = ", ".join(methods)
    yield f"apart at {differing_frames} frames: {of}" if first else f"alike: {of}"
